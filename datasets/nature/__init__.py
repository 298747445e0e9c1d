"""Made seas under natural conditions, with true colours, each made once and stored in the cache folder."""

import dataclasses
import hashlib
from collections.abc import Iterator
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from sucre_bench import InputError, Scene, View, Water, dataset
from sucre_bench.arrays import Array
from sucre_bench.datasets.nature.conditions import CONDITIONS, Condition, Name
from sucre_bench.machine.cache import get_or_make
from sucre_bench.machine.files import user_cache
from sucre_bench.plugins.options import check_ranges
from sucre_bench.scene import Plane

WaterName = Literal["coastal", "clear", "deep", "green", "blue", "haze"]
PathName = Literal[
    "approach", "forward", "survey", "survey_two_heights", "survey_varying", "orbit"
]
Relief = Literal["normal", "flat", "rough"]

_VERSION = 2  # to be raised whenever equal options make another scene than before
_MOST_PIXELS = 200_000_000  # of all views
_PLANES = ("rgb", "reference", "depth", "pose", "water")
_MILD_POSE_PX = 0.5
_MILD_DEPTH = 0.005


@dataset(
    requires=("cv2", "filelock", "numba", "platformdirs", "scipy"),
    licence="MIT, made by sucre_bench",
    source="made on this machine when first asked for",
    has=("poses", "depth", "reference", "truth"),
)
@dataclass(frozen=True)
class Nature:
    """A made sea under a natural condition: animals, moving light, a camera's automatics, wrong depth and poses.

    Light is summed in this order: light that reaches the ground, colour of the ground, water along the ray (SUCRe's
    model, with the distance from the camera), the mean over 3 x 3 rays of a pixel, blur, animals and snow, lens,
    exposure and white balance, tone, noise, file. The reference is the ground without water in even light, with the
    exposure, white balance and tone of the view; with a strobe, its exposure is not that of the view. It is NaN behind
    fish, since a picture may show them. The water is known where all views have the same, stored without a tone curve,
    in daylight.
    """

    condition: Name = "plain"
    """What nature, camera and files do; "plain": noise of .4 % and 8 bits. docs/datasets.md has all."""
    water: WaterName = "coastal"
    """The water, from "clear" to "haze"."""
    path: PathName = "approach"
    """How the camera moves: from 10 m to 2 m, forward over the ground, along a line above it, or around a place."""
    relief: Relief = "normal"
    """How high the ground is: about 0.35, 0.03 or 0.9 m."""
    errors: Literal["mild", "none"] = "mild"
    """mild: depth is wrong by .5 % in patches, and poses by .5 px in a drift, where the condition has no such errors of
    its own; none: depth and poses are exact where the condition leaves them."""
    views: int = 12
    """How many views, at least 2."""
    width: int = 192
    """Width of the images in pixels; at least 64."""
    height: int = 144
    """Height of the images in pixels; at least 48."""
    seed: int = 0
    """Seed of ground, path and condition; equal seeds make equal scenes."""
    root: Path | None = None
    """Folder that stores made scenes; null = the user's cache folder."""

    def __post_init__(self) -> None:
        check_ranges(
            self, views="[2, 1000]", width="[64, 8192]", height="[48, 8192]", seed="[0, inf)"
        )
        if (pixels := self.views * self.width * self.height) > _MOST_PIXELS:
            fault = f"{pixels / 1e9:.1f} gigapixels in all views"
            raise InputError(
                fault, "nature", f"give {_MOST_PIXELS / 1e9:g} or fewer: smaller or fewer views"
            )

    @property
    def spec(self) -> Condition:
        """The condition, with mild errors of depth and poses where it has none and they are wanted."""
        spec = CONDITIONS[self.condition]
        if self.errors == "none":
            return spec
        pose_px = spec.pose_px or _MILD_POSE_PX
        return dataclasses.replace(
            spec, pose_px=pose_px, depth_patches=spec.depth_patches or _MILD_DEPTH
        )

    @property
    def data_id(self) -> str:
        """A hash of all that decides the scene's arrays; it names their folder and identifies the scene."""
        content = repr(
            (_VERSION, astuple(self.spec), astuple(dataclasses.replace(self, root=None)))
        )
        return hashlib.blake2b(content.encode(), digest_size=6).hexdigest()

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene, named after its options."""
        from sucre_bench.datasets.nature.render import camera_of

        made, camera = self.arrays(), camera_of(self.width, self.height)
        views = [
            View(f"{place:02}.png", _Stored(self._folder, place), camera, pose)
            for place, pose in enumerate(made["pose"])
        ]
        water = None
        has = {"depth", "poses", "reference"}
        if (made["water"] == made["water"][0]).all():  # NaN, an unknown one, equals nothing
            water = Water(*made["water"][0])
            has |= {"truth"}
        relief = "" if self.relief == "normal" else f"-{self.relief}"
        name = f"{self.condition}-{self.water}-{self.path}{relief}-{self.seed}"
        yield Scene(name, views, frozenset(has), water=water, data_id=self.data_id)

    def arrays(self) -> dict[str, Array]:
        """Return what is stored of the scene, made if it is not there: arrays of V views.

        rgb, reference (V, H, W, 3); depth (V, H, W) and pose (V, 4, 4), as a method gets them; water (V, 3, 3): B, beta
        and gamma of each view, NaN where the condition leaves no true value.
        """

        def read(folder: Path) -> dict[str, Array] | None:
            try:
                return {
                    name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in _PLANES
                }
            except (OSError, ValueError):
                return None

        def make(folder: Path) -> dict[str, Array]:
            from sucre_bench.datasets.nature.render import render

            made = render(self)
            folder.mkdir()
            for name in _PLANES:
                np.save(folder / f"{name}.npy", made[name])
            return made

        return get_or_make(self._folder, read, make)

    @property
    def _folder(self) -> Path:
        place = user_cache() / "nature" if self.root is None else self.root
        return place / f"{self.condition}-{self.data_id}"


@dataclass(frozen=True)
class _Stored:
    """The pixels of a stored view."""

    folder: Path
    place: int

    def load(self, plane: Plane) -> Array:
        """Return a plane as float32."""
        return np.array(
            np.load(self.folder / f"{plane}.npy", mmap_mode="r")[self.place], dtype=np.float32
        )
