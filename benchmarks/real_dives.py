"""Real dives, whose true colours nobody knows: restorers against the photograph by measures that need no truth.

    python benchmarks/real_dives.py [--sets pool,d5] [--options restore,sucre_paper] [--size 700] [--sheet sheet.jpg]

The data lie in the folder that SUCRE_BENCH_DATA names, or in shared/data beside the checkout. Sets without data are
left out. Photographs without a model are prepared once, below outputs/real_dives. Measures, each the median over the
targets of a set:

- held: error of the model by judge.py: fitted to half of the views, it predicts means of tiles in the others; over that
  of the colours of the photograph. Above 1, the photograph predicts better.
- below: share of the worst channel of J that is below zero.
- drift: a*b* distance between the medians of the nearest and the farthest third of the picture.
- halves: difference of the veil at the median distance between the waters of the two halves, levels of 255.
- targets: the same between the waters of the targets.
- psi: angular error of the colour charts, degrees, where there are some.
- named: pictures with a fault that the eye sees, and which.
"""

from __future__ import annotations

import argparse
import functools
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
from sucre_bench.methods.sucre import Sucre
from sucre_bench.methods.sucre.judge import Court, chosen_model, judging
from sucre_bench.methods.sucre.model import veil
from sucre_bench.methods.sucre.models import Fit, Model
from sucre_bench.methods.sucre.observed import JUDGED_TARGETS, Dive
from sucre_bench.programs.prepare import Options
from sucre_bench.programs.prepare.pipeline import prepare
from sucre_bench.programs.restore.pipeline import FOR_A_DIVE

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class RealDive:
    """Its folder below the data, whether `prepare` makes its depth, image_scale, and targets' places in it."""

    folder: str
    is_prepared: bool = False
    scale: float = 0.5
    targets: tuple[int, ...] = (1, 4)


DIVES: Mapping[str, RealDive] = {
    "pool": RealDive("subvo_pool/images", is_prepared=True, targets=(0, 7)),
    "pool-own": RealDive("subvo_pool", targets=(6, 9)),
    "d5": RealDive("seathru_d5_charts", targets=(0, 3)),
    "test1": RealDive("seabed_surveys/test1", is_prepared=True),
    "test4": RealDive("seabed_surveys/test4", is_prepared=True),
    "test10": RealDive("seabed_surveys/test10", is_prepared=True),
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


def opened(dive: RealDive, data: Path, prepared: Path, size_px: int = 0) -> sb.Scene | None:
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


def measured(scene: sb.Scene, places: Sequence[int], option: str) -> list[Measured]:
    """Restore targets of a scene by an option and measure them."""
    method, options = OPTIONS[option]
    held, halves = judged(scene, option)
    found, looks = [], []
    for place in places:
        target = scene.views[place]
        whole = sb.restore(method, scene, target, **options)
        known = whole.image[np.isfinite(whole.image).all(axis=-1)]
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
            Measured(whole.shown, held, below, drift, halves, veil_of(whole.water, target), psi)
        )
        looks.append(look_at(whole.shown, target.rgb, target.distance, below))
    return [
        replace(one, faults=faults)
        for one, faults in zip(found, faults_of_dive(looks), strict=True)
    ]


def judged(scene: sb.Scene, option: str) -> tuple[float, float]:
    """Return `held` and `halves` of an option's model; NaN for a method without one, and where nothing is judged."""
    if option == "photograph":
        return 1.0, np.nan
    if option not in ("restore", "sucre_plus", "sucre_paper"):
        return np.nan, np.nan
    options = judging(Sucre())
    court = court_of(scene)
    if court is None:
        return np.nan, np.nan
    is_paper = option == "sucre_paper"
    model = Model(Fit.EARLY) if is_paper else chosen_model(scene, options).model
    if model.fit is Fit.NOTHING:
        return 1.0, np.nan
    found = court.judged(model)
    if found is None:
        return np.nan, np.nan
    distance = np.median(np.concatenate([target.distance for target, *_ in court.targets]))
    first, second, _ = (
        veil(distance, fit.water.B, fit.water.gamma) for fit in court.fitted[model]
    )
    return found.held_out, float(255 * np.abs(first - second).max())


@functools.lru_cache(maxsize=1)
def court_of(scene: sb.Scene) -> Court | None:
    return Court.of(Dive.spread(judging(Sucre()), scene, JUDGED_TARGETS))


def drift_of(picture: Array, distance: Array) -> float:
    """Return the a*b* distance between the medians of the nearest and the farthest third of a picture's ground."""
    ground = np.isfinite(picture).all(axis=-1) & (distance > 0)
    low, high = np.quantile(distance[ground], [1 / 3, 2 / 3])
    lab = to_lab(np.nan_to_num(picture))
    near, far = (
        np.median(lab[ground & part], axis=0)[1:]
        for part in (distance <= low, distance >= high)
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
            f"{value:7.{digits}f}"
            for value, digits in zip(values, (2, 2, 1, 0, 0, 1), strict=True)
        )
        yield (
            f"{name:9} {option:12} {' '.join(numbers)}  {n} of {len(found)} {' '.join(kinds)}",
            found,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", default=",".join(DIVES))
    parser.add_argument("--options", default=",".join(OPTIONS))
    parser.add_argument(
        "--size", type=int, default=0, help="longest side that photographs shrink to"
    )
    parser.add_argument("--sheet", type=Path)
    given = parser.parse_args()
    options, pictures = given.options.split(","), []
    if (data := data_folder()) is None:
        raise SystemExit("no data: name their folder in SUCRE_BENCH_DATA")
    print("set       option          held   below   drift  halves targets     psi  named")
    for name in given.sets.split(","):
        scene = opened(DIVES[name], data, ROOT / "outputs" / "real_dives", given.size)
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
