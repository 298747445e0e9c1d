"""UIQM, a quality measure without a reference: colourfulness (UICM), sharpness (UISM) and contrast (UIConM).

Source: Panetta, Gao & Agaian 2016, "Human-visual-system-inspired underwater image quality measures", IEEE JOE 41(3):

    UIQM   = .0282 UICM + .2953 UISM + 3.5753 UIConM
    UICM   = -.0268 sqrt(mu_RG^2 + mu_YB^2) + .1586 sqrt(var_RG + var_YB),  RG = R - G,  YB = (R + G) / 2 - B,
             mu: mean without the lowest and highest tenth; var: about mu, over all pixels
    UISM   = .299 EME(R') + .587 EME(G') + .114 EME(B'),  C' = C Sobel(C),  EME = 2 / (k1 k2) sum ln(max / min)
    UIConM = logAMEE of the intensity = 1 / (k1 k2) (x) sum m ln m,  m = (max (-) min) / (max (+) min),

sums over k1 k2 blocks, (+) (-) (x) the operations of parameterised logarithmic image processing (PLIP), whose
constants gamma and k are 1026. Where readers of the publication differ, the default takes: blocks of 10x10 pixels,
incomplete ones dropped. A block whose least value is 0 adds nothing to an EME. The intensity is the luma
.299/.587/.114. The sum is PLIP's too, so that logAMEE is a mean whatever the image's size (with a plain sum the factor
(x) makes it vanish as the image grows). The sign of every m ln m is turned, as all are negative and the published
values positive. A scale of the Sobel filter cancels in max / min. -m ln m is greatest at m = .37: blocks of full
contrast count for less again. Each variant differs from the default in exactly what its description says.

"matlab-first-output" reproduces the scores that U45 publishes. What the table calls UICM is the trimmed mean of R - G,
since the program takes the first of several results of its own function. "matlab" is that program with its UICM.
astronaut / coffee of scikit-image: panetta2016 2.54 / 2.93, funie 2.41 / 2.52, chen none / .64.

All see the picture as 8-bit sRGB. A block counts where every pixel of it, and for EME every neighbour, has a colour.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sucre_bench.arrays import AnyArray, Array, Mask, locked, once
from sucre_bench.errors import NotApplicableError
from sucre_bench.imaging.encoding import eight_bit, palette
from sucre_bench.imaging.percentiles import ValueCounts
from sucre_bench.metrics.uiqm.sharpness_and_contrast import (
    Contrast,
    Sharpness,
    uiconm,
    uiconm_blocks,
    uism,
    uism_blocks,
)
from sucre_bench.plugins.plugin import metric
from sucre_bench.scene import Restoration, Score, View

# UICM, the colourfulness in UIQM: mean and spread of the opponent colours R - G and (R + G) / 2 - B.

_ALPHA = 0.1  # the share trimmed at each end


@dataclass(frozen=True, slots=True)
class Colourfulness:
    """The points on which implementations of UICM differ."""

    trimmed_variance: bool = False
    """Whether var is over the pixels that mu is made of."""

    wraparound: bool = False
    """Whether R - G and R + G are modulo 256, as unsigned bytes are."""

    rounded: bool = False
    """Whether both tails have the nearest whole number of pixels, and sums are divided by .8 of the pixels, which may
    be a fraction."""

    first_output: bool = False
    """Whether the result is the trimmed mean of R - G alone, the first of several results of a program."""

    order: str = "RGB"
    """Which channel is taken for R, G and B."""


def uicm(shown: AnyArray, form: Colourfulness = Colourfulness()) -> float:
    """Return the colourfulness of a picture (H, W, 3) in [0, 1]; NaN where nothing has a colour."""
    opponents = _opponents(shown, form.wraparound, form.order)
    if not opponents:
        return float("nan")
    moments = []
    for x in opponents:
        low = int(np.ceil(_ALPHA * x.size))
        end = x.size - int(np.floor(_ALPHA * x.size))
        scale = 1.0
        if form.rounded:
            low, end = (int(np.floor(share * x.size + 0.5)) for share in (_ALPHA, 1 - _ALPHA))
            scale = (end - low) / ((1 - 2 * _ALPHA) * x.size)
        if low >= end:
            return float("nan")
        mean = scale * x.mean(low, end)
        squares = (
            scale * x.mean_square(mean, low, end)
            if form.trimmed_variance
            else x.mean_square(mean)
        )
        moments.append((mean, squares))
    (mean_RG, var_RG), (mean_YB, var_YB) = moments
    if form.first_output:
        return mean_RG
    return float(-0.0268 * np.hypot(mean_RG, mean_YB) + 0.1586 * np.sqrt(var_RG + var_YB))


@once
def _opponents(shown: AnyArray, wraparound: bool, order: str) -> tuple[ValueCounts, ...]:
    """R - G and (R + G) / 2 - B of every pixel."""
    colours = palette(shown)
    if not colours.counts.size:
        return ()
    R, G, B = colours.rgb.T[["RGB".index(channel) for channel in order]].astype(np.int32)
    RG, sum_RG = R - G, R + G
    if wraparound:
        RG, sum_RG = RG % 256, sum_RG % 256
    found = []
    for x, divisor in ((RG, 1), (sum_RG - 2 * B, 2)):
        # whole numbers from -512 on
        every = np.bincount(x + 512, weights=colours.counts).astype(np.int64)
        there = np.flatnonzero(every)
        found.append(ValueCounts.of((there - 512) / divisor, every[there]))
    return tuple(found)


_ABOUT: dict[str, Any] = {
    "requires": ["cv2", "numba"],
    "unit": "",
    "better": "higher",
    "cites": "Panetta, Gao & Agaian 2016",
}
# as published
_COLOUR = Colourfulness()
_SHARP = Sharpness()
_CONTRAST = Contrast()


@dataclass(frozen=True, slots=True)
class _Form:
    """What a variant is made of."""

    about: str
    colour: Colourfulness = _COLOUR
    sharp: Sharpness = _SHARP
    contrast: Contrast = _CONTRAST

    weights: tuple[float, float, float] = (0.0282, 0.2953, 3.5753)
    """Of UICM, UISM and UIConM."""


_BLUE144 = (0.299, 0.587, 0.144)
_BLUE144_BGR = (0.144, 0.587, 0.299)
_FUNIE = _Form(
    "as in xahidbuffon/FUnIE-GAN, the port most copied: blue144, UIConM without PLIP over the three channels",
    sharp=Sharpness(weights=_BLUE144),
    contrast=Contrast("together", plip=False, total="mean"),
)
_FUNIE_BGR = replace(
    _FUNIE,
    about="as funie, red and blue exchanged, as where OpenCV read the picture",
    colour=Colourfulness(order="BGR"),
    sharp=Sharpness(weights=_BLUE144_BGR),
)
_CHEN = _Form(
    "as in xueleichen/PSNR-SSIM-UCIQE-UIQM-Python: trimmed-variance, block8 with cut blocks, plus-one, wraparound,"
    " edges rounded, UIConM of luma in [0, 1] with a plain sum, negative and near 0; no score where a block is black",
    Colourfulness(trimmed_variance=True, wraparound=True),
    Sharpness(block=8, cut_blocks=True, edges="rounded", zero="one"),
    Contrast("rec709", total="plain", block=8, cut_blocks=True, fails_on_black=True),
)
_MATLAB = _Form(
    "the MATLAB program of many papers: tenths rounded, trimmed-variance, block5 of the picture enlarged to a multiple"
    " of 5, |S_x - S_y| in place of C Sobel(C), UIConM without PLIP summed over the three channels",
    Colourfulness(trimmed_variance=True, rounded=True),
    Sharpness(block=5, edges="resized", fractional=True),
    Contrast("each", plip=False, total="mean", block=5),
)


def _block(side: int, form: _Form, about: str) -> _Form:
    return replace(
        form,
        about=about,
        sharp=replace(form.sharp, block=side),
        contrast=replace(form.contrast, block=side),
    )


_FORMS = {
    "panetta2016": _Form("as published, see the module"),
    "trimmed-variance": _Form(
        "variances over the trimmed pixels", Colourfulness(trimmed_variance=True)
    ),
    "blue144": _Form(
        "EME(B') weighs .144, a misprint often copied", sharp=Sharpness(weights=_BLUE144)
    ),
    "block8": _block(8, _Form(""), "blocks of 8x8 pixels"),
    "block5": _block(5, _Form(""), "blocks of 5x5 pixels"),
    "no-plip": _Form(
        "ordinary arithmetic in UIConM", contrast=Contrast(plip=False, total="mean")
    ),
    "plus-one": _Form(
        "blocks with a 0 count as ln(max / 1) in UISM", sharp=Sharpness(zero="one")
    ),
    "wraparound": _Form(
        "R - G and R + G modulo 256, as unsigned bytes do", Colourfulness(wraparound=True)
    ),
    "matlab": _MATLAB,
    "matlab-first-output": replace(
        _MATLAB,
        about="as matlab, with the trimmed mean of R - G in place of UICM: the scores U45 publishes",
        colour=Colourfulness(rounded=True, first_output=True),
    ),
    "funie": _FUNIE,
    "funie-block8": _block(8, _FUNIE, "as funie, blocks of 8x8 pixels"),
    "funie-bgr": _FUNIE_BGR,
    "funie-bgr-block8": _block(
        8, _FUNIE_BGR, "as funie-bgr, blocks of 8x8 pixels, as in mkartik/Shallow-UWnet"
    ),
    "getuiqm1": replace(
        _FUNIE,
        about="as funie, sums over blocks divided by (H / 10) (W / 10), whole or not: getUIQM1 of ddz16/UIE_Benckmark"
        " and Owen718/Image-quality-measure-method",
        sharp=replace(_FUNIE.sharp, fractional=True),
        contrast=replace(_FUNIE.contrast, fractional=True),
    ),
    "chen": _CHEN,
    "chen-bgr": replace(
        _CHEN,
        about="as chen, red and blue exchanged, as in LintaoPeng/U-shape_Transformer's notebook",
        colour=replace(_CHEN.colour, order="BGR"),
        sharp=replace(_CHEN.sharp, weights=(0.114, 0.587, 0.299)),
        contrast=replace(_CHEN.contrast, order="BGR"),
    ),
    "uwcnn-plus": _Form(
        "as in MelodyZhangZH/UWCNN-plus: wraparound of G - R, EME of the levels of 8x8 blocks, channels exchanged and"
        " weighing .557 .144 .299, UIConM over the three channels with a plain sum, which weighs .6765",
        Colourfulness(wraparound=True, order="GRB"),
        Sharpness((0.557, 0.144, 0.299), 8, edges="levels", zero="almost"),
        Contrast("together", total="plain", block=8),
        (0.0282, 0.2953, 0.6765),
    ),
}


def _distinct(part: Callable[[_Form], object]) -> dict[str, str]:
    """The variants that differ in one part: of those that share it the first."""
    first: dict[object, str] = {}
    for name, form in _FORMS.items():
        first.setdefault(part(form), name)
    return {name: f"that of uiqm:{name}: {_FORMS[name].about}" for name in first.values()}


# Over 47 made scenes and 17 restorers (docs/formulas.md). The forms with "plus-one" are no better than chance.
_AGREEMENT = {
    "panetta2016": 0.21,
    "getuiqm1": 0.46,
    "matlab-first-output": 0.38,
    "funie": 0.46,
    "wraparound": 0.39,
}


@metric(
    role="no-reference",
    range=(-np.inf, np.inf),
    variants={name: form.about for name, form in _FORMS.items()},
    agreement=_AGREEMENT,
    **_ABOUT,
)
@dataclass(frozen=True)
class Uiqm:
    """Underwater image quality measure: colourfulness, sharpness and contrast, without a reference.

    It rewards noise and vivid colours, right or wrong: it hardly follows PSNR (SUCRe, table 1).
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN where no block is whole; coverage is the share of the blocks that UISM is made of.

        NotApplicableError where the program that the variant stands for has no result.
        """
        form = _FORMS[variant]
        shown = locked(shown)
        parts = uicm(shown, form.colour), uism(shown, form.sharp), _contrast(shown, form, view)
        yield _score(shown, float(np.dot(form.weights, parts)), uism_blocks(shown, form.sharp))


@metric(
    role="diagnosis",
    range=(-np.inf, np.inf),
    variants=_distinct(lambda form: form.colour),
    **_ABOUT,
)
@dataclass(frozen=True)
class Uicm:
    """The colourfulness in `uiqm`."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN where nothing has a colour."""
        shown = locked(shown)
        yield _score(shown, uicm(shown, _FORMS[variant].colour), eight_bit(shown).valid)


@metric(
    role="diagnosis",
    range=(-np.inf, np.inf),
    variants=_distinct(lambda form: form.sharp),
    **_ABOUT,
)
@dataclass(frozen=True)
class Uism:
    """The sharpness in `uiqm`."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN where no block is whole."""
        form = _FORMS[variant].sharp
        shown = locked(shown)
        yield _score(shown, uism(shown, form), uism_blocks(shown, form))


@metric(
    role="diagnosis",
    range=(-np.inf, np.inf),
    variants=_distinct(lambda form: form.contrast),
    **_ABOUT,
)
@dataclass(frozen=True)
class Uiconm:
    """The contrast in `uiqm`."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN where no block is whole. NotApplicableError as `uiqm`."""
        form = _FORMS[variant]
        shown = locked(shown)
        yield _score(shown, _contrast(shown, form, view), uiconm_blocks(shown, form.contrast))


def _contrast(shown: Array, form: _Form, view: View) -> float:
    try:
        return uiconm(shown, form.contrast)
    except NotApplicableError as reason:
        raise NotApplicableError(f"{view.name}: {reason}") from None


def _score(shown: Array, value: float, counted: Mask) -> Score:
    """counted: blocks, or pixels, that have what the value is made of."""
    known = counted.size > 0 and not np.isnan(value)
    n_pixels = eight_bit(shown).n_valid if known else 0
    return Score(value, n_pixels=n_pixels, coverage=float(counted.mean()) if known else 0.0)
