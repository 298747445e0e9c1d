"""Error of the colours that a method computed, against a reference: `colours` (dB) and `colours_de00` (CIEDE2000).

The display of a restoration hides its colours: a stretch makes dark and bright, warm and cold pictures alike. So both
metrics take J, before any display. Methods without an absolute scale may differ from the reference in exposure alone:
the variants "gain" leave the exposure of the whole picture free. A gain and an offset for each channel would also hide
casts and haze, which are errors of colour.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.cielab import ciede2000, lab_d50
from sucre_bench.imaging.encoding import srgb_encode
from sucre_bench.imaging.reference_images import known_in_both, psnr_of, reference_of
from sucre_bench.plugins.plugin import metric
from sucre_bench.scene import Restoration, Score, View

# pixels of which CIEDE2000 is computed, on a regular grid; each takes a microsecond
_MOST = 1 << 18


@metric(
    role="colours",
    needs={"reference"},
    unit="dB",
    better="higher",
    range=(-np.inf, np.inf),
    variants={
        "raw": "as computed, neither stretched nor clipped",
        "gain": "after the gain of all channels that fits best, so that the exposure is free",
        "channels": "after the gain of each channel that fits best, so that the white balance is free, too",
    },
)
@dataclass(frozen=True)
class Colours:
    """Peak signal-to-noise ratio of the computed colours J to the reference, whatever their display.

    10 log10(1 / MSE) over all channels of the pixels with a colour and a depth, in the view's encoding.
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score; nothing where the view has no reference."""
        if (found := _exposed(restored.image, view, variant)) is not None:
            colours, true = found
            error = float(np.mean((colours - true) ** 2)) if len(true) else np.nan
            yield _score(psnr_of(error), true, view)


@metric(
    role="colours",
    needs={"reference"},
    requires=["skimage"],
    unit="dE00",
    better="lower",
    range=(0, np.inf),
    cites="Sharma et al. 2005",
    variants={
        "gain": "after the gain of all channels that fits best, so that the exposure is free; clipped to [0, 1]",
        "raw": "as computed, clipped to [0, 1]",
    },
)
@dataclass(frozen=True)
class ColoursDe00:
    """Mean CIEDE2000 difference of the computed colours J from the reference, in CIE Lab under D50.

    Of images with more than 262,144 coloured pixels, so many of them count, at equal steps.
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score; nothing where the view has no reference."""
        if (found := _exposed(restored.image, view, variant)) is not None:
            labs = []
            for colours in found:
                few = colours[:: max(1, -(-len(colours) // _MOST))].clip(0, 1)
                labs.append(lab_d50(srgb_encode(few) if view.encoding == "linear" else few))
            yield _score(
                float(ciede2000(*labs).mean()) if len(found[1]) else np.nan, found[1], view
            )


def _exposed(image: Array, view: View, variant: str) -> tuple[Array, Array] | None:
    """Return computed and true colours (P, 3) of the pixels that have both and a depth, the computed after the gain.

    None without a reference. Raises InputError when the sizes differ.
    """
    if view.reference is None:
        return None
    reference = reference_of(view, image)
    scored = known_in_both(image, reference, view)
    colours, true = image[scored].astype(np.float64), reference[scored].astype(np.float64)
    if variant != "raw" and not np.array_equal(colours, true):
        # rounding would leave an error of 1e-32
        axis = 0 if variant == "channels" else None
        products, squares = (colours * true).sum(axis=axis), (colours**2).sum(axis=axis)
        colours *= np.maximum(products, 0) / np.maximum(squares, 1e-12)
    return colours, true


def _score(value: float, true: Array, view: View) -> Score:
    return Score(value, n_pixels=len(true), coverage=len(true) / view.valid.size)
