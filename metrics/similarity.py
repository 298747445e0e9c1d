"""Similarity to a reference image: PSNR and SSIM.

Both compare in [0, 1], gamma-encoded, over the pixels that the view has depth for (all, where it has no depth map) and
that the method gave a colour. The mean is taken over those pixels alone. (Blackening the rest in both images and
averaging over everything would add -10 log10(area) dB, 13 dB at 5 %.) The variants "unmasked" take every pixel, holes
as black, as most published tables do. Each score's coverage is the share of the image's pixels it is made of.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import AnyArray, Array, Mask, coloured_pixels, locked
from sucre_bench.imaging.encoding import srgb_encode, to_8bit
from sucre_bench.imaging.reference_images import known_in_both, psnr_of, reference_of
from sucre_bench.imaging.resizing import Resizing, resized
from sucre_bench.machine.compute import compiled, usable_cores
from sucre_bench.plugins.plugin import metric
from sucre_bench.scene import Restoration, Score, View

Image = AnyArray
RADIUS = 5  # the widest window reaches so far
# rows a thread takes at a time
_BAND = 128
# columns whose sums stay in the processor's cache
_TILE = 512


def squared_error(one: Image, other: Image, mask: Mask) -> float:
    """Return the sum over pixels in the mask (H, W) of the squared differences of images (H, W, C).

    What is not finite in `one` counts as 0.
    """
    import cv2

    total = 0.0
    for rows in (slice(top, top + _BAND) for top in range(0, len(mask), _BAND)):
        values = one[rows].astype(other.dtype, copy=False)
        values = (
            values if np.isfinite(values.sum()) else np.where(np.isfinite(values), values, 0)
        )
        total += cv2.norm(values, other[rows], cv2.NORM_L2SQR, mask[rows].view(np.uint8))
    return total


def mean_ssim(one: Image, other: Image, weights: Array, norm: float, whole: Mask) -> float:
    """Return the mean SSIM of two images (H, W, C) over the windows whose centre is in `whole` (H, W), and channels.

    weights: (11,) of a row and of a column of the window, 0 where it is narrower, summing to 1; norm: by which
    variances and covariances are multiplied. What is not finite counts as 0. K1 = .01, K2 = .03, range 1 (Wang et al.
    2004, eq. 13). With s = x + y and d = x - y, four filtered images do where x and y need five. 2 mu_x mu_y = (mu_s^2
    - mu_d^2) / 2, mu_x^2 + mu_y^2 = (mu_s^2 + mu_d^2) / 2, likewise for the variances. They are filtered in float32,
    less a typical value of s and d near by, so that the variances lose no digits.
    """
    height, _, channels = one.shape
    bands = [
        (c, row, min(row + _BAND, height))
        for c in range(channels)
        for row in range(0, height, _BAND)
    ]
    loop, one, other = compiled(_ssim_of_rows), locked(one), locked(other)
    rounded = weights.astype(np.float32)
    # what rounding took from the sum
    rounded[RADIUS] += np.float32(1 - rounded.sum(dtype=np.float64))

    with ThreadPoolExecutor(usable_cores()) as pool:
        sums = pool.map(
            lambda rows: loop(one, other, rows, rounded, np.float32(norm), whole), bands
        )
        total = float(sum(sums))  # in order: the same sum however many threads there are
    return total / (int(np.count_nonzero(whole)) * channels)


def _ssim_of_rows(
    one: Image,
    other: Image,
    rows: tuple[int, int, int],
    weights: Image,
    norm: np.float32,
    whole: Mask,
) -> float:
    """The sum over window centres. rows: a channel, and its first row and the end.

    Rows beyond the image repeat its first or last: their weight is 0, or the window is not whole.
    """
    channel, start, end = rows
    height, width, _ = one.shape
    zero = np.float32(0)
    c1, c2 = np.float32(2 * 0.01**2), np.float32(2 * 0.03**2)
    w0, w1, w2, w3, w4, w5 = (
        weights[0],
        weights[1],
        weights[2],
        weights[3],
        weights[4],
        weights[5],
    )
    line = np.zeros((4, _TILE + 2 * RADIUS), np.float32)  # s, d, s^2, d^2 of a row
    # the last rows, filtered along the row
    ring = np.zeros((2 * RADIUS + 1, 4, _TILE), np.float32)
    sums = np.zeros(_TILE)
    for left in range(0, width, _TILE):
        n = min(_TILE, width - left)
        first, last = max(left - RADIUS, 0), min(left + n + RADIUS, width)
        line[:] = 0
        typical_s = 0.0
        typical_d = 0.0
        seen = 0
        for row in range(start, end, 8):
            for x in range(left, left + n, 8):
                if whole[row, x]:
                    a, b = one[row, x, channel], other[row, x, channel]
                    a, b = (a if np.isfinite(a) else 0.0), (b if np.isfinite(b) else 0.0)
                    typical_s, typical_d, seen = typical_s + a + b, typical_d + a - b, seen + 1
        s0, d0 = np.float32(typical_s / max(seen, 1)), np.float32(typical_d / max(seen, 1))
        for row in range(start - RADIUS, end + RADIUS):
            source = min(max(row, 0), height - 1)
            for x in range(first, last):
                a, b = (
                    np.float32(one[source, x, channel]),
                    np.float32(other[source, x, channel]),
                )
                a = a if a - a == zero else zero
                b = b if b - b == zero else zero
                s, d = (a + b) - s0, (a - b) - d0
                i = x - left + RADIUS
                line[0, i] = s
                line[1, i] = d
                line[2, i] = s * s
                line[3, i] = d * d
            for k in range(4):
                v, h = line[k], ring[row % 11, k]
                for i in range(n):
                    near = (
                        w5 * v[i + 5] + w4 * (v[i + 4] + v[i + 6]) + w3 * (v[i + 3] + v[i + 7])
                    )
                    h[i] = (
                        near
                        + w2 * (v[i + 2] + v[i + 8])
                        + w1 * (v[i + 1] + v[i + 9])
                        + w0 * (v[i] + v[i + 10])
                    )
            centre = row - RADIUS
            if centre < start:
                continue
            for k in range(4):
                v = line[k]
                a0, a1, a2 = (
                    ring[(row + 1) % 11, k],
                    ring[(row + 2) % 11, k],
                    ring[(row + 3) % 11, k],
                )
                a3, a4, a5 = (
                    ring[(row + 4) % 11, k],
                    ring[(row + 5) % 11, k],
                    ring[(row + 6) % 11, k],
                )
                a6, a7, a8 = (
                    ring[(row + 7) % 11, k],
                    ring[(row + 8) % 11, k],
                    ring[(row + 9) % 11, k],
                )
                a9, a10 = ring[(row + 10) % 11, k], ring[row % 11, k]
                for i in range(n):
                    near = w5 * a5[i] + w4 * (a4[i] + a6[i]) + w3 * (a3[i] + a7[i])
                    v[i] = (
                        near
                        + w2 * (a2[i] + a8[i])
                        + w1 * (a1[i] + a9[i])
                        + w0 * (a0[i] + a10[i])
                    )
            for i in range(n):
                s, d = line[0, i], line[1, i]
                of_s, of_d = (line[2, i] - s * s) * norm, (line[3, i] - d * d) * norm
                s, d = (s + s0) * (s + s0), (d + d0) * (d + d0)
                ssim = (s - d + c1) * (of_s - of_d + c2) / ((s + d + c1) * (of_s + of_d + c2))
                sums[i] += np.float64(ssim) if whole[centre, left + i] else 0.0
    return sums.sum()


_GRAY = Resizing(256)


@metric(
    role="similarity",
    needs={"reference"},
    requires=["cv2", "PIL"],
    unit="dB",
    better="higher",
    range=(-np.inf, np.inf),
    variants={
        "masked": "the shown picture, over pixels with depth and a colour",
        "unmasked": "the shown picture, all pixels, holes as black",
        "raw": "the computed image, neither stretched nor clipped, over pixels with depth and a colour",
        "luma": "as masked, of luma (.299, .587, .114), in 8 bits",
        "gray": "luma of both pictures brought to 256x256 in 8 bits (Pillow's bicubic), all pixels, holes as black, as"
        " in xahidbuffon/FUnIE-GAN",
        "wrapped": "all pixels, of bytes whose differences and squares wrap around at 256: a mistake of many programs",
    },
)
@dataclass(frozen=True)
class Psnr:
    """Peak signal-to-noise ratio to the reference, 10 log10(1 / MSE) over all channels; infinite for equal images.

    "raw" compares in the view's own encoding: what a method computed, before any normalisation for display.
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score; nothing where the view has no reference."""
        if view.reference is None:
            return
        raw = variant == "raw"
        image, reference = _pair(restored.image if raw else shown, view, encode=not raw)
        is_masked = variant in ("masked", "raw", "luma")
        mask = (
            known_in_both(image, reference, view) if is_masked else coloured_pixels(reference)
        )
        if variant == "wrapped":
            off = to_8bit(image) - to_8bit(reference)
            yield _score(psnr_of(float((off * off).mean()) / 255**2), mask)
            return
        if variant in ("luma", "gray"):
            levels = [to_8bit(x) for x in (image, reference)]
            if variant == "gray":
                levels = [resized(x, _GRAY) for x in levels]
                mask = np.ones((_GRAY.side, _GRAY.side), np.bool_)
            # Whole levels of 255, as files hold them.
            image, reference = (
                np.floor(_luma(x.astype(np.float64)) + 0.5) / 255 for x in levels
            )
        n = np.count_nonzero(mask) * image.shape[-1]
        yield _score(psnr_of(squared_error(image, reference, mask) / n) if n else np.nan, mask)


@metric(
    role="similarity",
    needs={"reference"},
    requires=["cv2", "numba"],
    unit="",
    better="higher",
    range=(-1, 1),
    cites="Wang et al. 2004",
    variants={
        "gaussian": "Gaussian window, sigma 1.5, 11x11, as published; mean of the three channels",
        "uniform7": "uniform window 7x7, sample covariances (scikit-image's default)",
        "gray": "as gaussian, on luma (.299, .587, .114)",
        "gaussian-unmasked": "as gaussian, all pixels, holes as black",
        "uniform7-unmasked": "as uniform7, all pixels, holes as black",
        "gray-unmasked": "as gray, all pixels, holes as black",
        "funie": "of both pictures at 256x256 in 8 bits (Pillow's bicubic), windows reflected at the borders, sample"
        " covariances of 25 pixels, all pixels, holes as black, as in xahidbuffon/FUnIE-GAN",
    },
)
@dataclass(frozen=True)
class Ssim:
    """Structural similarity to the reference (Wang et al. 2004), K1 = .01, K2 = .03, data range 1.

    Masked variants average over the pixels whose whole window has a colour and depth, so that no hole bleeds into the
    score. As in the original, windows that leave the image count nowhere.
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score; nothing where the view has no reference."""
        import cv2

        if view.reference is None:
            return
        window, _, unmasked = variant.partition("-")
        image, reference = _pair(shown, view, encode=True)
        if window == "funie":
            yield _score(
                _funie_ssim(image, reference), np.ones((_GRAY.side, _GRAY.side), np.bool_)
            )
            return
        mask = coloured_pixels(reference) if unmasked else known_in_both(image, reference, view)
        if window == "gray":
            image, reference = (_luma(np.nan_to_num(x, nan=0.0)) for x in (image, reference))
        weights, norm = _WINDOWS["uniform7" if window == "uniform7" else "gaussian"]
        # The centres of windows that lie in the image and in the mask as a whole.
        width, whole = int(np.count_nonzero(weights)), mask.copy()
        if not mask.all():
            whole = cv2.erode(mask.astype(np.uint8), np.ones((width, width), np.uint8)) > 0
        margin = width // 2
        whole[:margin] = whole[-margin:] = whole[:, :margin] = whole[:, -margin:] = False
        if not whole.any():
            yield Score(np.nan, n_pixels=0, coverage=0.0)
            return
        yield _score(mean_ssim(image, reference, weights, norm, whole), whole)


def _funie_ssim(image: Array, reference: Array) -> float:
    """Mean over the image and its channels; windows reach four deviations, beyond the border by reflection."""
    import cv2

    def near(values: Array) -> Array:
        return np.asarray(
            cv2.GaussianBlur(values, (13, 13), 1.5, borderType=cv2.BORDER_REFLECT)
        )

    x, y = (resized(to_8bit(one), _GRAY) / 255.0 for one in (image, reference))
    mx, my = near(x), near(y)
    vx, vy, both = (
        25 / 24 * (near(a * b) - near(a) * near(b)) for a, b in ((x, x), (y, y), (x, y))
    )
    c1 = 0.01**2
    c2 = 0.03**2
    ssim = (2 * mx * my + c1) * (2 * both + c2) / ((mx**2 + my**2 + c1) * (vx + vy + c2))
    return float(ssim.mean())


# Weights along a row and a column, and what variances are multiplied by.
_GAUSSIAN: Array = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * 1.5**2))
_WINDOWS = {
    "gaussian": (_GAUSSIAN / _GAUSSIAN.sum(), 1.0),
    "uniform7": (np.array([0, 0, *[1 / 7] * 7, 0, 0]), 49 / 48),
}


def _pair(image: Array, view: View, encode: bool) -> tuple[Array, Array]:
    """The image and the view's reference, which is gamma-encoded if asked for; InputError when their sizes differ."""
    reference = reference_of(view, image)
    if encode and view.encoding == "linear":
        reference = srgb_encode(reference).astype(np.float32)
    return image, reference


def _luma(image: Array) -> Array:
    """(H, W, 1), of an image (H, W, 3)."""
    return np.asarray(image @ np.array([[0.299], [0.587], [0.114]], dtype=image.dtype))


def _score(value: float, mask: Mask) -> Score:
    n = int(np.count_nonzero(mask))
    return Score(value, n_pixels=n, coverage=n / mask.size)
