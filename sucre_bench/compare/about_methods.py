"""What is known of methods beside their scores.

What they were trained on, as their option `trained_on` says, and which test pictures were among it. How their pictures
differ from their publication's. What people thought of them in published studies.
"""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame
from sucre_bench.compare.model import Note
from sucre_bench.errors import SucreBenchError
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.loading.named_sets import NamedSet, Picture, found_of, named_sets, picture_of
from sucre_bench.machine.text_formats import first_few
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.results import layout
from sucre_bench.results.rows import values_of


@dataclass(frozen=True)
class About:
    """The methods of a dataset.

    notes: what each was trained on and differs in, and each published study that had several of them; photographs:
    those that return the photograph itself; is_track: whether views lie along a track: views without poses have no
    order.
    """

    notes: tuple[Note, ...]
    photographs: frozenset[str]
    is_track: bool


def options_of(rows: DataFrame) -> dict[str, dict[str, Any]]:
    """Return the options of each method of the rows, by its label: those of its last row."""
    last = rows[["method", "options"]].drop_duplicates("method", keep="last")
    return {name: json.loads(text or "{}") for name, text in values_of(last, "method", "options")}


def about(rows: DataFrame) -> About:
    """Return what is known of the methods of a dataset's rows beside their scores."""
    options = options_of(rows)
    method = {name: plugins.installed("method", told.get("name", "")) for name, told in options.items()}
    data = [plugins.installed("dataset", told.get("dataset", {}).get("name", "")) for told in options.values()]
    return About(
        tuple(_notes(options, method)),
        frozenset(name for name, plugin in method.items() if plugin and plugin.is_photograph),
        any(plugin is None or "poses" in plugin.has for plugin in data),
    )


def _notes(options: Mapping[str, Mapping[str, Any]], methods: Mapping[str, Plugin | None]) -> Iterator[Note]:
    studies: dict[str, dict[str, float]] = {}
    for name, plugin in methods.items():
        if text := options[name].get("trained_on"):
            yield Note("trained on", (name,), reasons=str(text))
        if plugin and plugin.differs:
            yield Note("differs", (name,), reasons=plugin.differs)
        for study, score in plugin.opinions.items() if plugin else ():
            studies.setdefault(study, {})[name] = score
    compared = [(study, sorted(of.items(), key=lambda one: -one[1])) for study, of in studies.items() if len(of) > 1]
    if compared:  # a line for all studies, the best first
        said = (f"{study}: {', '.join(f'{name} {score:g}' for name, score in of)}" for study, of in compared)
        yield Note("opinions", tuple({name: 0 for _, of in compared for name, _ in of}), reasons="; ".join(said))


def seen_in_training(out: Path, rows: DataFrame) -> Iterator[str]:
    """Yield a line for each dataset and method whose test pictures were among the training pictures.

    out: a results folder, with its `views`; rows: its score table. "SET" means the pictures of a named test set, and
    "DATASET less SET" all pictures of other named sets of that dataset. Other words are not checked. Pictures are known
    by their content: names are often plain numbers.
    """
    for dataset, of_dataset in rows.groupby("dataset", sort=False):
        said = {method: str(options.get("trained_on") or "") for method, options in options_of(of_dataset).items()}
        trained = {method: (text, *_sets_in(text)) for method, text in said.items() if text}
        if not any(sets for _, sets, _ in trained.values()):
            continue
        pictures = _pictures(out, str(dataset), of_dataset)
        for method, (text, sets, but) in trained.items():
            found = [found_of(one, pictures, "image") for one in sets]  # by content, and not changed
            seen = {name for one in found for name in {*one.members} - {*one.by_name, *one.changed}}
            if but:
                seen -= {*found_of(but, pictures, "image").members}
            if seen:
                yield (
                    f"{dataset}: {len(seen)} of {len(pictures)} pictures were in the training set of {method} "
                    f"({text}), so its scores are too good: {first_few(sorted(seen), 3)}"
                )


def _sets_in(text: str) -> tuple[list[NamedSet], NamedSet | None]:
    """The named sets that a text names as training pictures, and the one that it leaves out of them."""
    known = {name.casefold(): named for name, named in named_sets().items()}
    whole, less, but = (part.strip().casefold() for part in re.split(r"(\bless\b|$)", text, maxsplit=1))
    if less and but not in known:
        return [], None
    return [one for name, one in known.items() if whole in (one.of.casefold(), name)], known.get(but)


def _pictures(out: Path, dataset: str, rows: DataFrame) -> dict[str, Picture]:
    """The views of a dataset by scene and name; those without a stored picture are left out."""
    found = {}
    for scene, view in sorted(set(values_of(rows[rows["view"] != ""], "scene", "view"))):
        place = layout.find(dataset, scene, view, out)
        with suppress(SucreBenchError):
            if place:
                found[f"{scene}/{view}"] = picture_of(read_rgb(place.original(out)))
    return found
