"""Whether test pictures were among the pictures that a method was trained on, as its option `trained_on` names them."""

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from sucre_bench.arrays import DataFrame
from sucre_bench.compare.choose_rows import options_of
from sucre_bench.errors import SucreBenchError
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.loading.named_sets import NamedSet, Picture, found_of, named_sets, picture_of
from sucre_bench.machine.text_formats import first_few
from sucre_bench.results import layout
from sucre_bench.results.rows import values_of


def seen_in_training(out: Path, rows: DataFrame) -> Iterator[str]:
    """Yield a line for each dataset and method whose test pictures were among the training pictures.

    out: a results folder, with its `views`; rows: its score table. "SET" means the pictures of a named test set, and
    "DATASET less SET" all pictures of other named sets of that dataset. Other words are not checked. Pictures are known
    by their content: names are often plain numbers.
    """
    for dataset, of_dataset in rows.groupby("dataset", sort=False):
        said = {
            method: str(options.get("trained_on") or "")
            for method, options in options_of(of_dataset).items()
        }
        trained = {method: (text, *_sets_in(text)) for method, text in said.items() if text}
        if not any(sets for _, sets, _ in trained.values()):
            continue
        # the views by scene and name, without those that have no stored picture
        pictures = dict[str, Picture]()
        of_views = of_dataset[of_dataset["view"] != ""]
        for scene, view in sorted(set(values_of(of_views, "scene", "view"))):
            with suppress(SucreBenchError):
                if place := layout.find(str(dataset), scene, view, out):
                    pictures[f"{scene}/{view}"] = picture_of(read_rgb(place.original(out)))
        for method, (text, sets, but) in trained.items():
            # by content, and not changed
            found = [found_of(one, pictures, "image") for one in sets]
            seen = {
                name for one in found for name in {*one.members} - {*one.by_name, *one.changed}
            }
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
    parts = re.split(r"(\bless\b|$)", text, maxsplit=1)
    whole, less, but = (part.strip().casefold() for part in parts)
    if less and but not in known:
        return [], None
    sets = [one for name, one in known.items() if whole in (one.of.casefold(), name)]
    return sets, known.get(but)
