"""Faults of a restored picture that need no true colours to be seen: `faults`.

Each variant is one number of a picture, or of a picture against its photograph. Above its limit the picture has the
fault, and tables say so in words (`FAULTS`). docs/metric-evidence.md has how often they are right. Pictures are looked
at with at most 480 pixels on a side, as on a screen.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Mask, coloured_pixels, once
from sucre_bench.imaging.cielab import to_lab
from sucre_bench.imaging.display import display
from sucre_bench.imaging.image_formation import reduced
from sucre_bench.plugins.plugin import Fault, metric
from sucre_bench.scene import Restoration, Score, View

_SIDE = 480

# Where each hue of CIE Lab ends, degrees. The brown of mud is a dark orange; pinks lie on both sides of 0.
_HUES = (
    (15, "pink"),
    (35, "red"),
    (90, "orange"),
    (115, "yellow"),
    (170, "green"),
    (220, "cyan"),
    (295, "blue"),
    (325, "violet"),
)
_TURNED_DEG, _STRONGER = 60.0, 10.0  # a cast of another hue than the photograph's; a stronger one, in chroma

_RED_DEG, _RED_CHROMA, _WAS_RED_CHROMA = (310.0, 50.0), 40.0, 15.0  # hues from red-violet to red-orange

FAULTS = {
    "holes": Fault(0.1, "{share} of it is black", "share of the picture without a colour, be it computed or guessed"),
    "guessed": Fault(0.25, "{share} of it is guessed", "share of the picture that `fill` guessed"),
    "below": Fault(0.1, "{share} of its colours are below zero", "share of colours with a negative channel"),
    "above": Fault(0.1, "{share} of its colours are above one", "share of colours with a channel above 1"),
    "clipped": Fault(0.25, "{share} of it is clipped", "share of pixels at 0 or 1 that the photograph has elsewhere"),
    "cast": Fault(
        20,
        "{hue} cast",
        "C*ab of the median colour; 0 if neither its hue is 60 degrees from the photograph's nor its C*ab 10 larger",
    ),
    "red": Fault(
        0.05,
        "{share} of it is a red that the photograph lacks",
        "share of pixels with C*ab above 40 and a hue from violet-red to orange-red that are not red in the photograph",
    ),
    "noise": Fault(
        0.045,
        "much noise",
        "standard deviation of the noisiest channel where the photograph is smooth; 0 if the photograph has half of it",
    ),
}


@metric(
    needs={"restoration"},
    requires=["cv2"],
    unit="",
    better="none",
    range=(0, np.inf),
    default=[*FAULTS],
    variants={name: fault.definition for name, fault in FAULTS.items()},
    faults=FAULTS,
)
@dataclass(frozen=True)
class Faults:
    """Faults of a picture: holes, guessed pixels, impossible colours, clipping, a colour cast, red, noise.

    They tell what is wrong with a picture, not which picture is best.
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield one score, NaN without any colour; a cast's hue is the region of a second score, "image/orange"."""
        valid = coloured_pixels(restored.image)
        n, coverage = int(np.count_nonzero(valid)), float(valid.mean())
        if variant in ("holes", "guessed"):
            guessed = 0.0 if restored.filled is None else float((coloured_pixels(restored.filled) & ~valid).mean())
            yield Score(guessed if variant == "guessed" else 1 - coverage - guessed, n_pixels=valid.size)
        elif variant in ("below", "above"):
            colours = restored.image[valid]
            is_out = (colours < 0) if variant == "below" else (colours > 1)
            yield Score(float(is_out.any(axis=-1).mean()) if n else np.nan, n_pixels=n, coverage=coverage)
        else:
            picture, photograph = _on_screen(shown), _on_screen(display(view.rgb, "none", view.encoding))
            seen = coloured_pixels(picture) & coloured_pixels(photograph)
            value, hue = np.nan, ""
            if variant == "cast" and seen.any():
                value, hue = _cast(picture, photograph, seen)
            elif seen.any():
                value = {"clipped": _clipped, "red": _red, "noise": _noise}[variant](picture, photograph, seen)
            yield Score(value, n_pixels=n, coverage=coverage)
            if hue and value:
                yield Score(value, f"image/{hue}", n_pixels=n, coverage=coverage)


@once
def _on_screen(picture: Array) -> Array:
    """Return a picture (H, W, 3) in [0, 1] with at most `_SIDE` pixels on a side; NaN where a part has no colour."""
    return reduced(picture.astype(np.float32), _SIDE)


def _cast(picture: Array, photograph: Array, seen: Mask) -> tuple[float, str]:
    """Return the chroma of a cast, 0 without one, and its hue."""
    chromas, hues = [], []
    for image in (picture, photograph):
        lab = to_lab(np.nan_to_num(image))[seen]
        bright = lab[(lab[:, 0] > 15) & (lab[:, 0] < 95)]
        _, a, b = np.median(bright if len(bright) else lab, axis=0)
        chromas.append(float(np.hypot(a, b)))
        hues.append(float(np.degrees(np.arctan2(b, a)) % 360))
    turned = abs((hues[0] - hues[1] + 180) % 360 - 180)
    if turned <= _TURNED_DEG and chromas[0] <= chromas[1] + _STRONGER:
        return 0.0, ""
    return chromas[0], next((name for end, name in _HUES if hues[0] < end), "pink")


def _clipped(picture: Array, photograph: Array, seen: Mask) -> float:
    at_end, was_at_end = (((x[seen] > 1 - 1 / 255) | (x[seen] < 1 / 255)).any(axis=-1) for x in (picture, photograph))
    return float(np.mean(at_end & ~was_at_end))


def _red(picture: Array, photograph: Array, seen: Mask) -> float:
    is_red = []
    for image, least in ((picture, _RED_CHROMA), (photograph, _WAS_RED_CHROMA)):
        _, a, b = np.moveaxis(to_lab(np.nan_to_num(image)), -1, 0)
        hue = np.degrees(np.arctan2(b, a)) % 360
        is_red.append(((hue > _RED_DEG[0]) | (hue < _RED_DEG[1])) & (np.hypot(a, b) > least))
    return float((is_red[0] & ~is_red[1])[seen].mean())


def _noise(picture: Array, photograph: Array, seen: Mask) -> float:
    """Return the standard deviation of noise by the Laplacian of Immerkaer (1996), its median over smooth places."""
    import cv2

    inside = cv2.erode(seen.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    if not inside.any():
        return np.nan
    plain = cv2.blur(np.nan_to_num(photograph).mean(axis=-1), (5, 5))
    steps = np.abs(cv2.Sobel(plain, -1, 1, 0)) + np.abs(cv2.Sobel(plain, -1, 0, 1))
    smooth = inside & (steps <= np.quantile(steps[inside], 0.3))
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    sigmas = []
    for image in (picture, photograph):
        rough = np.abs(cv2.filter2D(np.nan_to_num(image), -1, kernel)) / 6 / 0.6745
        sigmas.append(float(np.median(rough[smooth], axis=0).max()))
    return sigmas[0] if sigmas[0] > 2 * sigmas[1] else 0.0
