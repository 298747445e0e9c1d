"""Calls a method: gives it its encoding, checks its result against the contract, and names it in errors."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, coloured
from sucre_bench.errors import InputError, PluginError, is_utf8
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.scene import Encoding, Pixels, Plane, Restoration, Scene, View, Water

# The chosen display, whether all of a result is wanted, and whether a run calls the method.
_WANTED: ContextVar[tuple[str, bool, bool]] = ContextVar("wanted", default=("", True, False))


@contextmanager
def shown_with(display: str, *, in_full: bool = True, in_run: bool = False) -> Iterator[None]:
    """Inside, `display_of` returns this normalisation: the one that the user chose.

    in_full: what `is_stored_in_full` returns; in_run: what `is_in_run` returns.
    """
    token = _WANTED.set((display, in_full, in_run))
    try:
        yield
    finally:
        _WANTED.reset(token)


def is_stored_in_full() -> bool:
    """Return whether all of a result is wanted, as with save=full and from Python; else `info` may be shorter."""
    return _WANTED.get()[1]


def is_in_run() -> bool:
    """Return whether a run calls the method.

    A run passes scenes as a dataset gave them, so an equal data_id means equal data. A program may have changed them.
    """
    return _WANTED.get()[2]


def display_of(method: Any) -> str:
    """Return the normalisation that makes a picture of a method's result: the chosen one, or else the plugin's own.

    A method may ask for it to word its hints. Its result must not depend on it, because it is stored without.
    """
    return _WANTED.get()[0] or str(method.__plugin__.display)


def with_truth(restoration: Restoration, scene: Scene, view: View) -> Restoration:
    """Return a restoration whose info holds the scene's "true_water" as well, where it is known."""
    if not scene.water:
        return restoration
    return replace(
        restoration,
        info={**restoration.info, "true_water": _explaining(scene.water, view.encoding)},
    )


def checked_restore(method: Any, scene: Scene, view: View) -> Restoration:
    """Return a method's restoration, checked: the image in the view's encoding, float32 as the confidence is, the water
    saying what it explains.

    A method that assumes encoded intensities gets those of a linear view, and its image is decoded again. Raises
    PluginError when the result is not what a method must return, and what the method raises.
    """
    if (
        "depth" in method.__plugin__.needs
        and view.has_depth
        and view.depth.shape != view.rgb.shape[:2]
    ):
        sizes = f"its depth has shape {view.depth.shape}, its image {view.rgb.shape[:2]}"
        raise InputError(sizes, view.name, "load both in one size")
    converts = method.__plugin__.encoding == "gamma" and view.encoding == "linear"
    given = (
        replace(view, pixels=_Encoded(view.pixels, view.is_jpeg), encoding="gamma")
        if converts
        else view
    )
    restoration = method.restore(scene, given)
    if not isinstance(restoration, Restoration):
        raise PluginError(
            f"the method returned {type(restoration).__name__}; a method returns a Restoration"
        )
    image = np.asarray(restoration.image)
    if image.shape != view.rgb.shape or not np.issubdtype(image.dtype, np.floating):
        raise PluginError(
            f"the method returned an image {image.shape} {image.dtype}; it must be {view.rgb.shape} and floating"
        )
    if not coloured(image).any():
        raise PluginError(
            f"the method gave no pixel of {view.name} a colour; its result is all NaN or infinite"
        )
    water = restoration.water and _explaining(restoration.water, given.encoding)
    info = dict(restoration.info)
    if "device" in info and not is_utf8(device := str(info["device"])):
        raise PluginError(
            f"the method returned the device {device!r}; it must be text in UTF-8"
        )
    if converts:
        image = srgb_decode(image)
        info["converted"] = "encoded (sRGB) for the method, its result decoded"
    confidence, filled = restoration.confidence, restoration.filled
    if filled is not None:
        if np.shape(filled) != image.shape:
            raise PluginError(
                f"the method returned filled {np.shape(filled)}; it must be {image.shape}, as its image"
            )
        filled = srgb_decode(filled) if converts else np.asarray(filled)
        filled = np.where(coloured(image)[..., None], np.nan, filled).astype(np.float32)
    return replace(
        restoration,
        image=image.astype(np.float32, copy=False),
        filled=filled,
        water=water,
        confidence=None
        if confidence is None
        else np.asarray(confidence).astype(np.float32, copy=False),
        info=info,
    )


def _explaining(water: Water, encoding: Encoding) -> Water:
    """A water that says which intensities it explains: those of the view, where it did not."""
    return water if water.encoding else replace(water, encoding=encoding)


@dataclass(frozen=True)
class _Encoded:
    """The pixels of a linear view, gamma-encoded."""

    pixels: Pixels
    is_jpeg: bool

    def load(self, plane: Plane) -> Array | None:
        values = self.pixels.load(plane)
        return (
            values
            if values is None or plane == "depth"
            else srgb_encode(values).astype(np.float32)
        )
