"""The `study:` block of an experiment: which tables and figures to make of its rows."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from sucre_bench import plugins
from sucre_bench.degrade import Degradation
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.imaging.resizing import split_variant
from sucre_bench.plugins.options import check_values, options_of
from sucre_bench.results.layout import file_name
from sucre_bench.results.rows import COSTS, By

# Each is a module of `reports.paper.figures`.
Figure = Literal[
    "against", "between_views", "charts", "hue", "pictures", "residuals", "scaling", "scores", "seams", "swatches",
    "water",
]  # fmt: skip
FIGURES: tuple[Figure, ...] = get_args(Figure)


@dataclass(frozen=True)
class Study:
    """What is made of the rows of a sweep.

    name: of its files; metrics: "name" or "name:variant", in the order of the table's columns, all when empty; along:
    the option whose values the study follows, "degrade.NAME", "dataset.NAME" or "method.NAME"; axis: what figures call
    it, with its unit, its name when empty; baseline: the method that the others are measured against, the best when
    empty; figures: modules of `reports.paper.figures`; spread: tables show standard deviations too; svg: figures are
    written as .svg too; by: "view" or "region" adds a table for each.
    """

    name: str
    metrics: tuple[str, ...] = ()
    along: str = ""
    axis: str = ""
    baseline: str = ""
    figures: tuple[str, ...] = ()
    spread: bool = False
    svg: bool = False
    by: By = "method"

    @classmethod
    def defaults(cls) -> dict[str, Any]:
        """The options of no study, as a configuration has them."""
        values = {"name": "", **{f.name: f.default for f in fields(cls) if f.name != "name"}}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Study:
        """Read a study from a configuration. InputError for a name that is unknown, with the nearest."""
        given = {name: value for name, value in values.items() if value is not None}
        check_values("study", options_of(cls), given, "correct the value")
        lists: dict[str, Any] = {name: _words(name, given[name]) for name in ("metrics", "figures") if name in given}
        options: dict[str, Any] = {"name": "", **given, **lists}
        study = cls(**options)
        if not study.name or file_name(study.name) != study.name:
            raise InputError(f"'{study.name}' is no name for files", "study.name", "give study.name=WORD")
        for metric in study.metrics:
            _check_metric(metric)
        for figure in study.figures:
            _known("study.figures", figure, FIGURES, "figure")
        if study.along:
            _check_along(study.along)
        return study


def _words(key: str, given: Any) -> tuple[str, ...]:
    words = [given] if isinstance(given, str) else given
    if not isinstance(words, (list, tuple)) or not all(isinstance(word, str) for word in words):
        raise InputError(f"{given!r} is not a list of words", f"study.{key}", f"write study.{key}=[a,b]")
    return tuple(dict.fromkeys(words))


def _check_metric(text: str) -> None:
    name, _, variant = text.partition(":")
    if name in COSTS:
        return
    try:
        plugin = plugins.find("metric", name)
    except InputError as fault:
        raise fault.within("study.metrics") from fault
    if variant:
        _known("study.metrics", split_variant(variant)[0], plugin.variants, f"variant of {name}")


def _check_along(along: str) -> None:
    group, dot, option = along.partition(".")
    if not (dot and option and group in ("degrade", "dataset", "method")):
        raise InputError(f"'{along}' is no option", "study.along", "give degrade.NAME, dataset.NAME or method.NAME")
    if group == "degrade":
        _known("study.along", option, [f.name for f in fields(Degradation)], "option of degrade")


def _known(place: str, name: str, known: Collection[str], what: str) -> None:
    if name not in known:
        raise unknown_name(place, name, known, what)
