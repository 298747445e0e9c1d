"""A study's files: ``tables/NAME.{md,tex,csv}`` and ``figures/NAME-FIGURE[-SUFFIX].{png,pdf}``."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from sucre_bench.arrays import DataFrame
from sucre_bench.compare.documents import as_text, levels_as_text
from sucre_bench.errors import ANY_FAULT, InputError, NotApplicableError, OutputError, one_line
from sucre_bench.jobs.run_options import Study
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.text_formats import keep_traceback
from sucre_bench.reports.paper import style
from sucre_bench.reports.paper.study_results import Drawn, StudyResults
from sucre_bench.results.layout import file_name, log_path
from sucre_bench.results.rows import csv_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Where each figure is: a function of its name, which yields `Drawn` inside `style.look()`. It reads only the study's
# results and the files of the results folder.
MODULES = {
    **dict.fromkeys(("scores", "against", "validity"), "scores"),
    **dict.fromkeys(("charts", "swatches", "hue"), "charts"),
    **dict.fromkeys(("pictures", "seams"), "pictures"),
    **dict.fromkeys(("residuals", "scaling", "water"), "fits"),
}


@dataclass(frozen=True)
class Written:
    """The result of a study: its files, and notes, for example why a figure could not be drawn."""

    paths: tuple[Path, ...]
    notes: tuple[str, ...]


def write(
    study: Study,
    rows: DataFrame,
    out: Path,
    methods: Sequence[str] = (),
    datasets: Sequence[str] = (),
) -> Written:
    """Write a study's tables and figures under `out`.

    rows: of the study's methods and datasets alone, as `results.read` returns them; methods, datasets: labels in the
    order that tables and figures have them, default as they were first run. What cannot be made is a note, and costs
    nothing else. Raises OutputError where files cannot be written.
    """
    notes: list[str] = []
    paths: list[Path] = []
    rows = by_time = rows.sort_values("time", kind="stable")
    for column, given in (("method", methods), ("dataset", datasets)):
        order = list(dict.fromkeys([*given, *by_time[column]]))
        rows = rows.iloc[rows[column].map(order.index).argsort(kind="stable")]
    if not (rows["status"] == "ok").any():
        notes.append(f"{study.name}: nothing was restored, so there is nothing to show")
    else:
        named = study.metrics
        study = _applicable(study, rows, notes)
        results = StudyResults(study, rows.reset_index(drop=True), out)
        with _noting(f"{study.name}: tables", out, notes):
            if named and not study.metrics:
                raise NotApplicableError("no requested metric has a score")
            for suffix, content in _tables(results):
                path = out / "tables" / f"{study.name}.{suffix}"
                write_atomically(path, content.encode())
                paths.append(path)
        for name in study.figures:
            whole = f"{study.name}-{name}"
            with _noting(whole, out, notes), style.look():
                for suffix, figure in drawn(name, results):
                    with _noting(whole, out, notes):
                        if isinstance(figure, NotApplicableError):
                            raise figure
                        stem = "-".join(filter(None, [whole, suffix and file_name(suffix)]))
                        paths += style.save(figure, out / "figures" / stem, study.svg)
    # Nothing of an earlier time may say otherwise.
    patterns = [f"tables/{study.name}.*"]
    patterns += [
        f"figures/{study.name}-{name}{end}" for name in study.figures for end in (".*", "-*")
    ]
    for old in {path for pattern in patterns for path in out.glob(pattern)} - {*paths}:
        old.unlink()
    return Written(tuple(paths), tuple(notes))


def drawn(
    name: str, results: StudyResults
) -> Iterator[tuple[str, Figure | NotApplicableError]]:
    """Yield the figures of one kind, each with the end of its file's name, or why a dataset has none.

    Raises NotApplicableError ("why; what to do") if there is nothing to draw at all.
    """
    draw: Callable[[StudyResults], Iterator[Drawn]]
    draw = getattr(import_module(f"{__package__}.{MODULES[name]}"), name)
    for words, figure in draw(results):
        yield "-".join(filter(None, words)), figure


@contextmanager
def _noting(what: str, out: Path, notes: list[str]) -> Iterator[None]:
    """Make a note of a fault, which costs nothing else; OutputError goes on. what: the tables or the figure."""
    try:
        yield
    except OutputError:
        raise
    except (NotApplicableError, InputError) as reason:
        notes.append(f"{what}: not made, {one_line(reason)}")
    except ANY_FAULT as fault:
        keep_traceback(log_path(out), what)
        notes.append(f"{what}: failed, {one_line(fault)}; the traceback is in {log_path(out)}")


def _applicable(study: Study, rows: DataFrame, notes: list[str]) -> Study:
    """The study without metrics that nothing was scored by, and without a baseline that did not run."""
    scored = rows[rows["status"] == "ok"]
    known = {*scored["metric"], *(scored["metric"] + ":" + scored["variant"])}
    absent = [metric for metric in study.metrics if metric not in known]
    if absent:
        notes.append(f"{study.name}: no scores of {', '.join(absent)}, left out")
        study = replace(
            study, metrics=tuple(metric for metric in study.metrics if metric in known)
        )
    if study.baseline and study.baseline not in set(rows["method"]):
        notes.append(
            f"{study.name}: the baseline {study.baseline} did not run; study.baseline=METHOD names another"
        )
        study = replace(study, baseline="")
    return study


def _tables(results: StudyResults) -> Iterator[tuple[str, str]]:
    """Yield each format's suffix and text."""
    import pandas as pd

    study = results.study
    if study.along:
        # titles differ by dataset
        levels = {title: each for one in results.followed for title, each in one.tables.items()}
        records = [record for each in results.followed for record in each.records()]
        yield "md", levels_as_text(levels, "md")
        yield "tex", levels_as_text(levels, "latex")
        yield "csv", csv_text(pd.DataFrame(records), for_spreadsheets=True)
        return
    tables = results.comparisons
    csv = as_text([*results.with_baseline, *results.parts], "csv", study.spread)
    if study.baseline:
        titled = [
            replace(t, title=f"{t.title}, against {study.baseline}")
            for t in results.with_baseline
        ]
        tables = [*itertools.chain(*zip(tables, titled, strict=True))]
    tables = [*tables, *results.parts]
    yield "md", as_text(tables, "md", study.spread)
    yield "tex", as_text(tables, "latex", study.spread)
    yield "csv", csv
