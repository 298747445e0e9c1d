"""Real dives, whose true colours nobody knows: restorers against the photograph by measures that need no truth.

    python benchmarks/real_dives.py [--sets pool,d5] [--options restore,sucre_paper] [--sheet sheet.jpg]

The data lie in the folder that SUCRE_BENCH_DATA names, or in shared/data beside the checkout. Sets without data are
left out. Photographs without a model are prepared once, below outputs/real_dives. Measures, each the median over the
targets of a set:

- held: a water fitted to half of the views predicts the means of tiles in the others. The median error over that of
  the photograph as the target's colours in all views. One gain a view and channel is fitted to either. A falloff
  towards the corners is not predicted.
- below: share of the worst channel of J that is below zero.
- drift: a*b* distance between the medians of the nearest and the farthest third of the picture.
- halves: difference of the veil at the median distance between waters of odd and of even views, levels of 255.
- targets: the same between the targets' own waters.
- psi: angular error of the colour charts, degrees, where there are some.
- named: pictures with a fault that the eye sees, and which.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import sucre_bench as sb
from sucre_bench.arrays import Array
from sucre_bench.imaging.cielab import to_lab
from sucre_bench.imaging.visible_faults import VisibleFault, faults_of_dive, look_at
from sucre_bench.multiview.observe import observe
from sucre_bench.programs.prepare import Options
from sucre_bench.programs.prepare.pipeline import prepare
from sucre_bench.programs.restore.pipeline import FOR_A_DIVE

ROOT = Path(__file__).resolve().parents[1]
TILE_PX, LEAST_PX = 24, 20  # side of a tile of the target; pixels that a tile must have in a view


@dataclass(frozen=True)
class Dive:
    """A set: its folder below the data, whether `prepare` makes its depth, image_scale, and targets' places in it."""

    folder: str
    is_prepared: bool = False
    scale: float = 0.5
    targets: tuple[int, ...] = (1, 4)


DIVES: Mapping[str, Dive] = {
    "pool": Dive("subvo_pool/images", is_prepared=True, targets=(0, 7)),
    "pool-own": Dive("subvo_pool", targets=(6, 9)),
    "d5": Dive("seathru_d5_charts", targets=(0, 3)),
    "test1": Dive("seabed_surveys/test1", is_prepared=True),
    "test4": Dive("seabed_surveys/test4", is_prepared=True),
    "test10": Dive("seabed_surveys/test10", is_prepared=True),
}
RESTORE = {
    name: {"true": True, "false": False}.get(value, value) for name, value in FOR_A_DIVE.items()
}
OPTIONS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "photograph": ("underwater", {}),
    "restore": ("sucre_plus", RESTORE),
    "sucre_plus": ("sucre_plus", {}),
    "sucre_paper": ("sucre_paper", {}),
    "fusion_2018": ("fusion_2018", {}),
}


@dataclass(frozen=True, eq=False)
class Measured:
    """A restored target and its measures; NaN where one is not known. veil: (3,) at the median distance."""

    shown: Array
    held: float
    below: float
    drift: float
    halves: float
    veil: Array
    psi: float
    faults: tuple[VisibleFault, ...] = ()


def data_folder() -> Path | None:
    """The folder of the data, or None where there is none."""
    beside = [folder / "shared" / "data" for folder in (ROOT, *ROOT.parents)]
    named = os.environ.get("SUCRE_BENCH_DATA")
    return next(
        (folder for folder in ([Path(named)] if named else beside) if folder.is_dir()), None
    )


def opened(dive: Dive, data: Path, prepared: Path, size_px: int = 0) -> sb.Scene | None:
    """Return the scene of a set, None without its data. prepared: where depth is made; size_px: shrinks photographs."""
    folder = data / dive.folder
    if not folder.is_dir():
        return None
    if dive.is_prepared:
        out = prepared / dive.folder.replace("/", "-")
        prepare(folder, out, Options(max_size=size_px, depth_size=size_px // 2 or 800))
        folder = out
    return sb.load_scene(
        "colmap", root=folder, image_scale=1.0 if size_px and dive.is_prepared else dive.scale
    )


def measured(
    scene: sb.Scene, places: Sequence[int], option: str, halves: bool = True
) -> list[Measured]:
    """Restore targets of a scene by an option and measure them. halves: also fit halves of the views, for `held`."""
    method, options = OPTIONS[option]
    found, looks = [], []
    for place in places:
        target = scene.views[place]
        whole = sb.restore(method, scene, target, **options)
        known = whole.image[np.isfinite(whole.image).all(axis=-1)]
        held, apart = _held(scene, target, method, options) if halves else (np.nan, np.nan)
        psi = np.nan
        if target.charts:
            rows = sb.score(whole, target, metrics=["psi"])
            psi = float(
                rows.loc[
                    rows["region"].isin([chart.name for chart in target.charts]), "value"
                ].mean()
            )
        below = float((known < 0).mean(axis=0).max())
        drift = drift_of(whole.shown, target.distance)
        found.append(
            Measured(whole.shown, held, below, drift, apart, veil_of(whole.water, target), psi)
        )
        looks.append(look_at(whole.shown, target.rgb, target.distance, below))
    return [
        replace(one, faults=faults)
        for one, faults in zip(found, faults_of_dive(looks), strict=True)
    ]


def _held(
    scene: sb.Scene, target: sb.View, method: str, options: Mapping[str, Any]
) -> tuple[float, float]:
    """Return `held` over both ways to halve the views, and `halves`."""
    others = [view for view in scene.views if view.name != target.name]
    errors, veils = [], []
    for seen, unseen in ((others[::2], others[1::2]), (others[1::2], others[::2])):
        half = replace(scene, views=[target, *seen])
        try:
            restored = sb.restore(method, half, target, **options)
        except sb.SolveError:
            return np.nan, np.nan
        if restored.water is None and method != "underwater":
            return np.nan, np.nan
        errors.append(
            error_of_tiles(target, unseen, restored) / error_of_tiles(target, unseen, None)
        )
        veils.append(veil_of(restored.water, target))
    return float(np.mean(errors)), float(255 * np.abs(veils[0] - veils[1]).max())


def error_of_tiles(
    target: sb.View, unseen: Sequence[sb.View], restored: sb.Restoration | None
) -> float:
    """Return the median |error|, levels of 255, of means of tiles that a restored target predicts in unseen views.

    restored: None for the photograph's colours at every distance. A view's gain in a channel is the median over tiles.
    """
    seen = observe(target, [target, *unseen], with_view=True)
    assert seen.view is not None
    is_other = np.array([name != target.name for name in seen.views])[seen.view]
    pixel, distance = seen.pixels[seen.place], seen.distance.astype(np.float64)
    full = np.iinfo(seen.colour.dtype).max if seen.colour.dtype.kind == "u" else 1
    colour = seen.colour.T / full
    image = target.rgb if restored is None else restored.image
    predicted = image.reshape(-1, 3)[pixel].astype(np.float64)
    if restored is not None and restored.water is not None:
        water = restored.water
        predicted = predicted * np.exp(-np.outer(distance, water.attenuation))
        predicted -= water.veiling_light * np.expm1(-np.outer(distance, water.backscatter))
    is_known = is_other & np.isfinite(predicted).all(axis=-1)
    y, x = np.divmod(pixel[is_known], seen.shape[1])
    across = -(-seen.shape[1] // TILE_PX)
    tile = (y // TILE_PX * across + x // TILE_PX) * len(seen.views) + seen.view[is_known]
    _, place, n = np.unique(tile, return_inverse=True, return_counts=True)
    view = np.zeros(len(n), int)
    view[place] = seen.view[is_known]
    expected, found = (
        np.stack([np.bincount(place, column) / n for column in values[is_known].T], axis=1)[
            n >= LEAST_PX
        ]
        for values in (colour, predicted)
    )
    view = view[n >= LEAST_PX]
    for one in np.unique(view):
        found[view == one] *= np.median(
            expected[view == one] / np.maximum(found[view == one], 1e-3), axis=0
        )
    return float(255 * np.median(np.abs(found - expected))) if len(found) else np.nan


def drift_of(picture: Array, distance: Array) -> float:
    """Return the a*b* distance between the medians of the nearest and the farthest third of a picture's ground."""
    ground = np.isfinite(picture).all(axis=-1) & (distance > 0)
    low, high = np.quantile(distance[ground], [1 / 3, 2 / 3])
    lab = to_lab(np.nan_to_num(picture))
    near, far = (
        np.median(lab[ground & part], axis=0)[1:] for part in (distance <= low, distance >= high)
    )
    return float(np.hypot(*(near - far)))


def veil_of(water: sb.Water | None, target: sb.View) -> Array:
    """Return the veil (3,) at the median distance of a target; 0 without a water."""
    if water is None:
        return np.zeros(3)
    distance = float(np.median(target.distance[target.distance > 0]))
    return np.asarray(-water.veiling_light * np.expm1(-water.backscatter * distance))


def rows(
    name: str, scene: sb.Scene, places: Sequence[int], options: Sequence[str]
) -> Iterator[tuple[str, list[Measured]]]:
    """Yield the row of each option, printed, and what was measured."""
    for option in options:
        found = measured(scene, places, option)
        values = [
            np.nanmedian([getattr(one, what) for one in found])
            for what in ("held", "below", "drift", "halves")
        ]
        veils = np.stack([one.veil for one in found])
        values += [
            255 * float(np.ptp(veils, axis=0).max()),
            float(np.mean([one.psi for one in found])),
        ]
        kinds = sorted({fault.kind for one in found for fault in one.faults})
        n = sum(bool(one.faults) for one in found)
        numbers = (
            f"{value:7.{digits}f}" for value, digits in zip(values, (2, 2, 1, 0, 0, 1), strict=True)
        )
        yield (
            f"{name:9} {option:12} {' '.join(numbers)}  {n} of {len(found)} {' '.join(kinds)}",
            found,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", default=",".join(DIVES))
    parser.add_argument("--options", default=",".join(OPTIONS))
    parser.add_argument("--sheet", type=Path)
    given = parser.parse_args()
    options, pictures = given.options.split(","), []
    if (data := data_folder()) is None:
        raise SystemExit("no data: name their folder in SUCRE_BENCH_DATA")
    print("set       option          held   below   drift  halves targets     psi  named")
    for name in given.sets.split(","):
        scene = opened(DIVES[name], data, ROOT / "outputs" / "real_dives")
        if scene is None:
            print(f"{name}: no data in {data / DIVES[name].folder}")
            continue
        for row, found in rows(name, scene, DIVES[name].targets, options):
            print(row, flush=True)
            pictures.append([one.shown for one in found])
    if given.sheet:
        write_sheet(given.sheet, pictures, len(options))


def write_sheet(path: Path, pictures: Sequence[Sequence[Array]], n_options: int) -> None:
    """Write a picture with a row for each target and a column for each option; holes are black."""
    import cv2

    lines = []
    for start in range(0, len(pictures), n_options):
        for of_target in zip(*pictures[start : start + n_options], strict=True):
            cells = [
                cv2.resize(np.nan_to_num(one), (320, 240), interpolation=cv2.INTER_AREA)
                for one in of_target
            ]
            lines.append(np.hstack(cells))
    cv2.imwrite(str(path), np.rint(255 * np.vstack(lines)[..., ::-1]).astype(np.uint8))


if __name__ == "__main__":
    main()
