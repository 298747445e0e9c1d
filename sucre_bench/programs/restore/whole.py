"""Makes a restored picture whole, and brings it back to the geometry of its photograph.

A pixel that no method coloured shows the photograph, changed by what restoring changed at the rim around it. So there
is no step at the rim, and no water is guessed. First detail gets the contrast that restoring gave it, by least squares
in each channel, since water takes contrast: the photograph's own detail beside restored detail looks like haze. Then
the difference of the restored picture is added. Both are continued from known pixels by push and pull: sums are halved
until every cell knows a value, then enlarged into the unknown cells (Gortler, Grzeszczuk, Szeliski & Cohen 1996, The
lumigraph, sec. 3.4.2).

Open water has no colour of its own, so it stays as the photograph shows it. It is smooth, and has less red than all
ground, since nothing is farther. Smooth murk with more red is a little like it. Trust in a restored colour is 1 in
cells where most distances were measured, and is continued from there over the image, held back by edges. Over open
water it is lost within a few cells, elsewhere it stays. Small patches of distances that look like open water are false.
So a surface that goes on behind an edge of the ground, or a false match in the water, leaves no dark rim there.
"""

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.imaging.cielab import luma
from sucre_bench.imaging.fill import cell_px, continued, in_cells
from sucre_bench.imaging.filters import guided_filter
from sucre_bench.loading.lens import Lens

# The weight of no trust beside that of a neighbouring cell is this power of the likeness to open water. So holes in
# the ground, which are a little like water everywhere, keep trust.
_SHARP = 4

# Cells of a patch that counts as measured: smaller ones are false matches on waves and in water. So are patches of
# fewer than the second number of cells that look more like water than the share.
_FEWEST = 9
_LARGE = 60
_WATERY = 0.2

# Open water: its texture is below this share of the median texture of ground, its red below this quantile of ground's.
# Lost trust in a disc cut out of the ground, of a fifth of the image's width: reef 1 %, flat seabed 0, tiles of a pool
# 5 %.
_SMOOTH = 0.2
_RED = 0.01

# How much smooth places with more red than that are like open water: murk above a reef. With 0 the reef's gain made
# brown clouds of it. Mean and largest loss of trust in such discs, flat seabed, kelp, and pool: 0: 0 and 0, .1 and .6,
# .1 and .6 %; .3: 0 and .1, .3 and 2.6, .9 and 7.9 %; .5: .3 and .9, 1.6 and 14, 2.9 and 17 %.
_MURKY = 0.3

# The same where unknown cells join an open water: bright water under waves has the red of ground. With .3 it became
# orange above a reef; from .8 on, holes in far ground beside the water turned teal. Nothing changes in seven of nine
# dives; in both pools 0 to 2 levels.
_BESIDE_WATER = 0.6
_FINE = 0.5  # standard deviation of the texture's filter, in cells; with wider ones a rim of water has the ground's
_FINE_PX = 10  # pixels of a cell's side when trust is held at edges: more than that cost time and show nothing
_FLAT = 1e-4  # variance of the photograph below which trust is blurred, and not held at an edge

# Contrast is measured in cells, so many along the longer side. To choose the number, parts of 16 restored views of five
# dives were hidden and filled. They were off by 8.2 in CIE Lab, and by 9.1 with the photograph's own contrast. 30 or 60
# cells change that by .1.
_CONTRASTS = 40

_GRID = 16  # pixels between the places where a lens is computed; between them it is straight to a hundredth of a pixel


def whole(restored: Array, known: Mask, photograph: Array) -> Array:
    """Return the restored picture with colours for all pixels: (H, W, 3) float32 in [0, 1].

    restored, photograph: (H, W, 3) in [0, 1], gamma-encoded; known: (H, W), the restored pixels that have a colour.
    """
    if known.all():
        return restored
    if not known.any():
        return photograph
    contrasted = _with_contrast(restored, known, photograph)
    change = np.subtract(restored, contrasted, dtype=np.float32)
    change[~known] = 0
    picture = _continued(change, known.astype(np.float32))
    picture += contrasted  # in place, as all below: pictures of 24 megapixels have 290 MB
    np.clip(picture, 0, 1, out=picture)
    np.copyto(picture, restored, where=known[..., None])
    return picture


def _with_contrast(restored: Array, known: Mask, photograph: Array) -> Array:
    """Return the photograph (H, W, 3) float32 with the contrast of the restored pixels around, a gain a channel.

    Detail is what differs from the mean of the cells around. A gain is the slope of restored detail over that of the
    photograph, in a cell and its neighbours: a cell that is nearly flat tells none.
    """
    import cv2

    size = known.shape[::-1]
    n = -(-max(size) // _CONTRASTS)

    def enlarged(cells: Array) -> Array:
        return np.asarray(cv2.resize(cells, size, interpolation=cv2.INTER_LINEAR))

    def smooth(plane: Array | Mask) -> Array:
        return enlarged(in_cells(plane, n))

    share = np.maximum(smooth(known), 1e-6)
    result = photograph.astype(np.float32)
    for c in range(3):
        detail, gained = (
            np.where(known, plane - smooth(np.where(known, plane, 0)) / share, 0)
            for plane in (photograph[..., c], restored[..., c])
        )
        both, weight = (
            np.asarray(
                cv2.GaussianBlur(in_cells(detail * other, n), (0, 0), 1), dtype=np.float32
            )
            for other in (gained, detail)
        )
        gain = enlarged(_continued(both[..., None], weight)[..., 0])
        result[..., c] += (gain - 1) * (photograph[..., c] - smooth(photograph[..., c]))
    return result


def _continued(sums: Array, weight: Array) -> Array:
    """Turn sums (H, W, C) into sums by weight (H, W), with values for pixels of weight 0 from those around."""
    import cv2

    height, width = weight.shape
    half = (-(-width // 2), -(-height // 2))
    less = [cv2.resize(one, half, interpolation=cv2.INTER_AREA) for one in (sums, weight)]
    np.divide(sums, weight[..., None], out=sums, where=weight[..., None] > 0)
    if not (weight > 0).all() and max(height, width) > 1:
        coarse = _continued(
            np.asarray(less[0], dtype=np.float32).reshape(*half[::-1], -1),
            np.asarray(less[1], dtype=np.float32),
        )
        wide = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR).reshape(
            sums.shape
        )
        np.copyto(sums, wide, where=weight[..., None] == 0)
    return sums


def with_open_water(picture: Array, measured: Mask, photograph: Array) -> Array:
    """Return a whole picture with the photograph's colours where it shows open water: (H, W, 3) float32 in [0, 1].

    picture, photograph: (H, W, 3) in [0, 1], gamma-encoded; measured: (H, W), the pixels with a measured distance.
    """
    import cv2

    if measured.all() or not measured.any():
        return picture
    n = cell_px(measured)
    light = luma(np.ascontiguousarray(photograph, dtype=np.float32))
    texture = np.sqrt(in_cells((light - cv2.GaussianBlur(light, (0, 0), _FINE * n)) ** 2, n))
    known = in_cells(measured, n) > 0.5
    _, patch, found, _ = cv2.connectedComponentsWithStats(
        known.astype(np.uint8), connectivity=4
    )
    cells = found[patch, cv2.CC_STAT_AREA]
    known &= cells >= _FEWEST
    if not known.any():
        return picture
    ground = large if (large := known & (cells >= _LARGE)).any() else known
    small = in_cells(photograph, n)
    red = small[..., 0] / np.maximum(small.sum(axis=-1), 1e-6)
    rough = texture / max(_SMOOTH * float(np.median(texture[ground])), 1e-6)
    near = red / max(float(np.quantile(red[ground], _RED)), 1e-6)
    blue = 1 / (1 + near.clip(0, 10) ** 16)
    smooth = 1 / (1 + rough.clip(0, 10) ** 4)
    watery = np.maximum(blue, _MURKY) * smooth
    known &= ground | (np.bincount(patch.ravel(), watery.ravel())[patch] < _WATERY * cells)
    _, hole, _, _ = cv2.connectedComponentsWithStats((~known).astype(np.uint8), connectivity=4)
    n_open = np.bincount(hole.ravel(), (blue * smooth > 0.5).ravel())[hole]
    watery = np.where(n_open >= _LARGE, np.maximum(blue, _BESIDE_WATER) * smooth, watery)
    trust = continued(known.astype(np.float32), known, small, watery**_SHARP)
    size = measured.shape[::-1]
    step = -(-n // _FINE_PX)
    guide = in_cells(photograph, step)
    coarse = np.asarray(
        cv2.resize(trust, guide.shape[1::-1], interpolation=cv2.INTER_LINEAR), dtype=np.float32
    )
    edged = guided_filter(guide, coarse, 2 * n // step, _FLAT).clip(0, 1)
    fine = cv2.resize(edged, size, interpolation=cv2.INTER_LINEAR)
    is_known = (
        cv2.resize(known.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST_EXACT) > 0
    )
    fine[measured & is_known] = 1
    change = np.subtract(picture, photograph, dtype=np.float32)
    change *= fine[..., None]
    change += photograph
    return change


def as_photographed(lens: Lens, picture: Array, known: Mask) -> tuple[Array, Mask]:
    """Return a picture (H, W, 3) of a lens's pinhole camera as the lens shows it, and which pixels (H, W) it shows.

    The pinhole image looks at less than the photograph, so a border of the photograph has no pixel there.
    """
    import cv2

    size = width, height = lens.camera.size
    across, down = (np.linspace(0.5, side - 0.5, max(2, side // _GRID)) for side in size)
    u, v = np.meshgrid(across, down)
    coarse = lens.straightened(np.stack([u.ravel(), v.ravel()], axis=-1)).reshape(*u.shape, 2)
    coarse = np.where(np.isfinite(coarse), coarse, -1e4).astype(np.float32)
    columns, rows = np.meshgrid(
        *(
            np.linspace(0, len(at) - 1, n, dtype=np.float32)
            for at, n in ((across, width), (down, height))
        )
    )
    x, y = (cv2.remap(coarse[..., c] - 0.5, columns, rows, cv2.INTER_LINEAR) for c in range(2))
    shown = cv2.remap(picture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    share = cv2.remap(
        known.astype(np.uint8),
        x,
        y,
        cv2.INTER_NEAREST,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=0,
    )
    return np.asarray(shown).clip(0, 1), np.asarray(share > 0)
