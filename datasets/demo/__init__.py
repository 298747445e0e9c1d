"""The built-in dataset: a made underwater scene with known truth, made once and stored in the cache folder."""

import dataclasses
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sucre_bench import InputError, Scene, Water, dataset
from sucre_bench.machine.files import user_cache
from sucre_bench.plugins.options import check_ranges

Preset = Literal["clear", "coastal", "turbid", "deep_sea"]

# Each row: B, beta and gamma. Chosen by eye to look like photographs, from clear ocean to turbid coast.
_PARAMETERS: dict[Preset, list[tuple[float, float, float]]] = {
    "clear": [(0.05, 0.28, 0.43), (0.26, 0.07, 0.05), (0.19, 0.11, 0.10)],
    "coastal": [(0.07, 0.36, 0.42), (0.42, 0.14, 0.13), (0.30, 0.20, 0.18)],
    "turbid": [(0.23, 0.45, 0.34), (0.56, 0.26, 0.34), (0.42, 0.32, 0.36)],
    "deep_sea": [(0.02, 0.13, 0.17), (0.19, 0.06, 0.055), (0.08, 0.07, 0.07)],
}
LAST = "water.json"  # the file of a made scene that is written after all else: a folder without it is not finished
_VERSION = 3  # to be raised whenever equal options make another scene than before
_MOST_PIXELS = 2_000_000_000  # of all views: a bundle of a stranger may ask for them


def water_of(preset: Preset) -> Water:
    """Return the water of this name."""
    return Water(*np.array(_PARAMETERS[preset]))


@dataset(
    requires=("cv2", "numba", "platformdirs", "scipy"),
    licence="MIT, made by sucre_bench",
    source="made on this machine when first asked for",
    has=("poses", "depth", "reference", "charts", "truth"),
)
@dataclass(frozen=True)
class Demo:
    """A made seabed with colour charts, surveyed from 8 m down to 1.5 m, in water of a known colour.

    The reference images show the same scene without water, in even light. The images follow SUCRe's model exactly,
    apart from noise and 8 bits. "deep_sea" is different: there the only light is a lamp on the camera. It has a
    lobe and falls with the square of its way, which is through the water too. The veil is its light that is scattered
    once. No method without a model of the lamp should be expected to find the water of such a scene. A pixel of the
    reference is the mean of 3 x 3 samples over its own area on the ground. Far pixels thus have less contrast than near
    ones, as in a photograph.
    """

    water: Preset = "coastal"
    """The water: "clear" (blue ocean), "coastal" (blue-green), "turbid" (green), or "deep_sea" (lit by a lamp)."""
    views: int = 16
    """How many views, from the farthest to the nearest; at least 2."""
    width: int = 640
    """Width of the images in pixels; at least 64. A view has the charts whose patches have 4 pixels: with 128
    none."""
    height: int = 480
    """Height of the images in pixels; at least 48."""
    seed: int = 0
    """Seed of the seabed, the path and the noise; equal seeds make equal scenes."""
    noise: float = 0.004
    """Standard deviation of the sensor's noise, as a share of full scale."""
    root: Path | None = None
    """Folder that stores made scenes; null = the user's cache folder."""

    def __post_init__(self) -> None:
        sizes = {"views": "[2, 5000]", "width": "[64, 16384]", "height": "[48, 16384]"}
        check_ranges(self, **sizes, seed="[0, inf)", noise="[0, 1]")
        if (pixels := self.views * self.width * self.height) > _MOST_PIXELS:
            fault = f"{pixels / 1e9:.1f} gigapixels in all views"
            raise InputError(
                fault, "demo", f"give {_MOST_PIXELS / 1e9:g} or fewer: smaller or fewer views"
            )

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene, named after its water."""
        from sucre_bench.datasets.colmap import Colmap

        for scene in Colmap(root=self.folder()).scenes():
            has = scene.has | {"truth"}
            yield dataclasses.replace(
                scene,
                name=self.water,
                water=water_of(self.water),
                has=has,
                data_id=self.data_id,
            )

    def folder(self) -> Path:
        """Return the folder of the scene's files, which are made if they are not there."""
        place = user_cache() / "demo" if self.root is None else self.root
        folder = place / f"{self.water}-{self.data_id}"
        if not (folder / LAST).is_file():
            from sucre_bench.datasets.demo.made_scene import make, make_once

            make_once(folder, lambda: make(**self._options()))
        return folder

    def _options(self) -> dict[str, Any]:
        return {
            f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name != "root"
        }

    @property
    def data_id(self) -> str:
        """A hash of the options that decide the scene's files; it names their folder and identifies the scene."""
        from sucre_bench.imaging.chart_kinds import KINDS, chart_kind

        kinds = repr({name: chart_kind(name) for name in KINDS})
        content = json.dumps([_VERSION, self._options(), kinds], sort_keys=True)
        return hashlib.blake2b(content.encode(), digest_size=6).hexdigest()
