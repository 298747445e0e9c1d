"""The pixels that a study shows: those that all its methods fill, so that people judge colours and not holes."""

from pathlib import Path

from sucre_bench import results
from sucre_bench.arrays import Mask
from sucre_bench.errors import InputError
from sucre_bench.programs.people.design import Key
from sucre_bench.results import layout
from sucre_bench.results.common_scores import LEAST_FILLED
from sucre_bench.results.restorations import stored_mask
from sucre_bench.results.rows import restorations, row_objects


def common_masks(folder: Path, key: Key) -> dict[tuple[str, str], Mask]:
    """Return the pixels (H, W) that all methods fill, by scene and view; no entry for a view without holes.

    Raises InputError if a mask is gone or damaged, if the masks of a view differ in size, or if its methods share less
    than 1 % of the image.
    """
    rows = restorations(results.read(folder))
    rows = rows[(rows["dataset"] == key.dataset) & rows["method"].isin(key.methods) & (rows["coverage"] < 1)]
    shown = {(one.scene, one.view) for one in key.pictures.values()}
    made: dict[tuple[str, str], Mask] = {}
    for row in row_objects(rows):
        where, place = (row.scene, row.view), layout.find(key.dataset, row.scene, row.view, folder)
        if where not in shown or place is None:
            continue
        mask = stored_mask(folder, place, row)
        before = made.setdefault(where, mask)
        if before.shape != mask.shape:
            raise InputError(f"{place.mask(folder, row.method)}: is not of the size of the other methods' masks")
        made[where] = before & mask
    for (_, view), mask in made.items():
        if mask.mean() < LEAST_FILLED:
            raise InputError(
                f"{view}: all methods share less than 1 % of the image; leave one out, or use --pixels own"
            )
    return made
