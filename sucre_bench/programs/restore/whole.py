"""Makes a restored picture whole, and brings it back to the geometry of its photograph.

A pixel that no method coloured shows the photograph, changed by what restoring changed at the rim around it. So there
is no step at the rim, and no water is guessed. The change is the difference of restored picture and photograph,
continued from known pixels by push and pull: halved until every cell knows a value, then enlarged into the unknown
cells (Gortler, Grzeszczuk, Szeliski & Cohen 1996, The lumigraph, sec. 3.4.2).

Open water has no colour of its own, so it stays as the photograph shows it. It is smooth, and has less red than all
ground, since nothing is farther. Trust in a guessed colour is 1 at pixels with a distance and is continued from there
over the image, held back by edges. Over open water it is lost within a few cells, elsewhere it stays.
"""

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.imaging.cielab import luma
from sucre_bench.imaging.fill import cell_px, continued, in_cells
from sucre_bench.loading.lens import Lens

# The weight of no trust beside that of a neighbouring cell, in open water.
_PULL = 0.04

# Open water: its texture is below this share of the median texture of ground, its red below this quantile of ground's.
# Lost trust in a disc cut out of the ground, of a fifth of the image's width: demo 0 %, tiles of a pool 6 %, reef 10 %;
# in the open water above the reef 96 to 99 %. Without the red, the pool's discs lose up to 50 %.
_SMOOTH, _RED = 0.2, 0.05

_GRID = 16  # pixels between the places where a lens is computed; between them it is straight to a hundredth of a pixel


def whole(restored: Array, known: Mask, photograph: Array) -> Array:
    """Return the restored picture with colours for all pixels: (H, W, 3) float32 in [0, 1].

    restored, photograph: (H, W, 3) in [0, 1], gamma-encoded; known: (H, W), the restored pixels that have a colour.
    """
    if known.all():
        return restored
    if not known.any():
        return photograph
    change = _continued((restored - photograph) * known[..., None], known.astype(np.float32))
    return np.where(known[..., None], restored, (photograph + change).clip(0, 1)).astype(np.float32)


def _continued(sums: Array, weight: Array) -> Array:
    """Return sums (H, W, 3) by weight (H, W), with values for pixels of weight 0 from those around."""
    import cv2

    height, width = weight.shape
    values = np.divide(sums, weight[..., None], out=np.zeros_like(sums), where=weight[..., None] > 0)
    if (weight > 0).all() or max(height, width) == 1:
        return values
    half = (-(-width // 2), -(-height // 2))
    less = (cv2.resize(one, half, interpolation=cv2.INTER_AREA) for one in (sums, weight))
    coarse = _continued(*(np.asarray(one, dtype=np.float32) for one in less))
    wide = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR).reshape(height, width, 3)
    return np.where(weight[..., None] > 0, values, wide).astype(np.float32)


def with_open_water(picture: Array, measured: Mask, photograph: Array) -> Array:
    """Return a whole picture with the photograph's colours where it shows open water: (H, W, 3) float32 in [0, 1].

    picture, photograph: (H, W, 3) in [0, 1], gamma-encoded; measured: (H, W), the pixels with a distance.
    """
    import cv2

    if measured.all() or not measured.any():
        return picture
    n = cell_px(measured)
    light = luma(np.ascontiguousarray(photograph, dtype=np.float32))
    texture = np.sqrt(in_cells((light - cv2.GaussianBlur(light, (0, 0), n)) ** 2, n))
    known = in_cells(measured, n) > 0.5
    if not known.any():
        return picture
    small = in_cells(photograph, n)
    red = small[..., 0] / np.maximum(small.sum(axis=-1), 1e-6)
    is_smooth = 1 / (1 + (texture / (_SMOOTH * max(float(np.median(texture[known])), 1e-6))) ** 4)
    is_far = 1 / (1 + (red / max(float(np.quantile(red[known], _RED)), 1e-6)) ** 16)
    trust = continued(known.astype(np.float32), known, small, _PULL * is_smooth * is_far)
    fine = cv2.resize(trust, measured.shape[::-1], interpolation=cv2.INTER_LINEAR)
    fine = np.where(measured, 1, fine)[..., None]
    return np.asarray(fine * picture + (1 - fine) * photograph, dtype=np.float32)


def as_photographed(lens: Lens, picture: Array, known: Mask) -> tuple[Array, Mask]:
    """Return a picture (H, W, 3) of a lens's pinhole camera as the lens shows it, and which pixels (H, W) it shows.

    The pinhole image looks at less than the photograph, so a border of the photograph has no pixel there.
    """
    import cv2

    size = width, height = lens.camera.width, lens.camera.height
    across, down = (np.linspace(0.5, side - 0.5, max(2, side // _GRID)) for side in size)
    u, v = np.meshgrid(across, down)
    coarse = lens.straightened(np.stack([u.ravel(), v.ravel()], axis=-1)).reshape(*u.shape, 2)
    coarse = np.where(np.isfinite(coarse), coarse, -1e4).astype(np.float32)
    columns, rows = np.meshgrid(
        *(np.linspace(0, len(at) - 1, n, dtype=np.float32) for at, n in ((across, width), (down, height)))
    )
    x, y = (np.asarray(cv2.remap(coarse[..., c] - 0.5, columns, rows, cv2.INTER_LINEAR)) for c in range(2))
    shown = cv2.remap(picture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    share = cv2.remap(known.astype(np.uint8), x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(shown).clip(0, 1), np.asarray(share > 0)
