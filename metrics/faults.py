"""Faults of a restored picture that need no true colours to be seen: `faults`.

Each variant is one number of a picture, or of a picture against its photograph. Above its limit the picture has the
fault, and tables say so in words (`FAULTS`). docs/formulas.md has how often they are right. Pictures are looked
at with at most 480 pixels on a side, as on a screen.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Mask, coloured_pixels, once
from sucre_bench.imaging.display import display
from sucre_bench.imaging.visible_faults import LIMITS, Look, look_at, on_screen
from sucre_bench.plugins.plugin import Fault, metric
from sucre_bench.scene import Restoration, Score, View

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
FAULTS = {
    "holes": Fault(
        0.1,
        "{share} of it is black",
        "share of the picture without a colour, be it computed or guessed",
    ),
    "guessed": Fault(
        0.25, "{share} of it is guessed", "share of the picture that `fill` guessed"
    ),
    "below": Fault(
        LIMITS["below"],
        "{share} of a channel is below zero",
        "share of the worst channel below zero",
    ),
    "above": Fault(
        0.1, "{share} of its colours are above one", "share of colours with a channel above 1"
    ),
    "clipped": Fault(
        0.25,
        "{share} of it is clipped",
        "share of pixels at 0 or 1 that the photograph has elsewhere",
    ),
    "cast": Fault(
        LIMITS["cast"],
        "{hue} cast",
        "a*b* distance of a third of the ground, near to far, from what a white balance of the photograph can give",
    ),
    "red": Fault(
        LIMITS["red"],
        "{share} of it is a red that the photograph lacks",
        "share of pixels with a hue within 15 degrees of red, saturation above .5 and value above .15 of HSV that "
        "are not red in the photograph",
    ),
    "rims": Fault(
        LIMITS["rims"],
        "coloured rims",
        "share of pixels at steps of depth whose a*b* distance from the ground beside is 15 above the photograph's",
    ),
    "flat": Fault(
        LIMITS["flat"],
        "{share} of it is flat paint",
        "share of pixels with less than a quarter of the texture that the photograph has there",
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
    """Faults of a picture: holes, guesses, impossible colours, clipping, a cast, red, coloured rims, flat paint, noise.

    They tell what is wrong with a picture, not which picture is best.
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN without any colour, none where a fault cannot be.

        A cast's hue is the region of a second score, "image/orange".
        """
        valid = coloured_pixels(restored.image)
        n, coverage = int(np.count_nonzero(valid)), float(valid.mean())
        if variant in ("holes", "guessed"):
            guessed = (
                0.0
                if restored.filled is None
                else float((coloured_pixels(restored.filled) & ~valid).mean())
            )
            yield Score(
                guessed if variant == "guessed" else 1 - coverage - guessed, n_pixels=valid.size
            )
        elif variant in ("below", "above"):
            colours = restored.image[valid]
            is_out = (
                (colours < 0)
                if variant == "below"
                else (colours > 1).any(axis=-1, keepdims=True)
            )
            yield Score(
                float(is_out.mean(axis=0).max()) if n else np.nan, n_pixels=n, coverage=coverage
            )
        elif variant in LIMITS:
            look = _look(shown, view)
            value = float(getattr(look, variant))
            if n and math.isnan(value):  # no step of depth has rims, no near ground a cast
                return
            yield Score(value, n_pixels=n, coverage=coverage)
            if variant == "cast" and value > 0:
                hue = next((name for end, name in _HUES if look.hue_deg < end), "pink")
                yield Score(value, f"image/{hue}", n_pixels=n, coverage=coverage)
        else:
            picture, photograph = (
                on_screen(shown),
                on_screen(display(view.rgb, "none", view.encoding)),
            )
            seen = coloured_pixels(picture) & coloured_pixels(photograph)
            measure = {"clipped": _clipped, "noise": _noise}[variant]
            yield Score(
                measure(picture, photograph, seen) if seen.any() else np.nan,
                n_pixels=n,
                coverage=coverage,
            )


@once
def _look(shown: Array, view: View) -> Look:
    return look_at(
        shown,
        display(view.rgb, "none", view.encoding),
        view.distance if view.has_depth else None,
    )


def _clipped(picture: Array, photograph: Array, seen: Mask) -> float:
    at_end, was_at_end = (
        ((x[seen] > 1 - 1 / 255) | (x[seen] < 1 / 255)).any(axis=-1)
        for x in (picture, photograph)
    )
    return float(np.mean(at_end & ~was_at_end))


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
