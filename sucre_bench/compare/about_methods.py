"""What is known of methods beside their scores.

What they were trained on, as their option `trained_on` says, and which test pictures were among it; how their pictures
differ from their publication's; what people thought of them in published studies.
"""

import json
import re
from collections.abc import Iterator
from pathlib import Path

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame
from sucre_bench.compare.model import Note
from sucre_bench.errors import SucreBenchError
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.loading.named_sets import Picture, found_of, named_sets, print_of
from sucre_bench.results import layout
from sucre_bench.results.rows import values_of


def _trained_on(rows: DataFrame) -> dict[str, str]:
    """What each method of the rows says, by its label; without those that say nothing."""
    of_methods = rows[["method", "options"]].drop_duplicates("method")
    said = {str(name): json.loads(options or "{}").get("trained_on") for name, options in of_methods.to_numpy()}
    return {name: str(text) for name, text in said.items() if text}


def notes_on_methods(rows: DataFrame) -> Iterator[Note]:
    """Yield what each method of the rows was trained on and differs in, and each study that had several of them."""
    for name, text in _trained_on(rows).items():
        yield Note("trained on", (name,), reasons=text)
    studies: dict[str, dict[str, float]] = {}
    for name, options in values_of(rows.drop_duplicates("method"), "method", "options"):
        plugin = plugins.installed("method", json.loads(options or "{}").get("name", ""))
        if plugin and plugin.differs:
            yield Note("differs", (name,), reasons=plugin.differs)
        for study, score in plugin.opinions.items() if plugin else ():
            studies.setdefault(study, {})[name] = score
    for study, scores in studies.items():
        if len(scores) > 1:
            best_first = sorted(scores, key=lambda name: -scores[name])
            said = ", ".join(f"{name} {scores[name]:g}" for name in best_first)
            yield Note("opinions", tuple(best_first), reasons=f"{study}: {said}")


def seen_in_training(out: Path, rows: DataFrame) -> Iterator[str]:
    """Yield a line for each dataset and method whose test pictures were among the training pictures.

    out: a results folder, with its `views`; rows: its score table. "SET" means the pictures of a named test set, and
    "DATASET less SET" all pictures of other named sets of that dataset. Other words are not checked.
    """
    known = {text.casefold(): named for text, named in named_sets().items()}
    for dataset, of_dataset in rows.groupby("dataset", sort=False):
        if not (said := _trained_on(of_dataset)):
            continue
        pictures = _pictures(out, str(dataset), of_dataset)
        for method, text in said.items():
            whole, less, but = (part.strip().casefold() for part in re.split(r"(\bless\b|$)", text, maxsplit=1))
            if less and but not in known:
                continue
            trained = [one for name, one in known.items() if one.of.casefold() == whole or name == whole]
            seen = {name for one in trained for name in found_of(one, pictures, "image").members}
            if less:
                seen -= set(found_of(known[but], pictures, "image").members)
            if seen:
                first = ", ".join(sorted(seen)[:3])
                yield (
                    f"{dataset}: {len(seen)} of {len(pictures)} pictures were in the training set of {method} "
                    f"({text}), so its scores are too good: {first}{', ...' if len(seen) > 3 else ''}"
                )


def _pictures(out: Path, dataset: str, rows: DataFrame) -> dict[str, Picture]:
    """The views of a dataset by name; those without a stored picture are left out."""
    found = {}
    for scene, view in sorted(set(values_of(rows[rows["view"] != ""], "scene", "view"))):
        place = layout.find(dataset, scene, view, out)
        try:
            image = read_rgb(place.original(out)) if place else None
        except SucreBenchError:
            continue
        if image is not None:
            found[view] = Picture((image.shape[1], image.shape[0]), print_of(image))
    return found
