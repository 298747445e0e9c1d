"""Writes the pictures and the contact sheet of photographs that the engine restored.

A pixel that no method coloured shows the photograph, changed by what restoring changed at the rim around it. So there
is no step at the rim, and no water is guessed. The change is the difference of restored picture and photograph,
continued from known pixels by push and pull: halved until every cell knows a value, then enlarged into the unknown
cells (Gortler, Grzeszczuk, Szeliski & Cohen 1996, The lumigraph, sec. 3.4.2).
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Array, Mask, evenly
from sucre_bench.errors import ANY_FAULT, InputError, OutputError, SucreBenchError, one_line
from sucre_bench.imaging.display import display
from sucre_bench.imaging.drawing import contact_sheet
from sucre_bench.imaging.encoding import to_8bit, to_16bit
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.loading.lens import Lens
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import track
from sucre_bench.programs.restore.picture_file import bits_of, encoded
from sucre_bench.results.restorations import read_mask
from sucre_bench.scene import View

_MOST_SHOWN, _WIDE = 60, 320  # pairs on the contact sheet, evenly chosen; pixels of a picture's width
_ORIENTATION = 274
_GRID = 16  # pixels between the places where a lens is computed; between them it is straight to a hundredth of a pixel


@dataclass(frozen=True, eq=False)
class Restored:
    """A photograph that the engine restored.

    name: path of its picture below the folder of pictures; photograph: its file; view: what was restored; image: the
    restored image; lens: of the photograph, if the view is its pinhole image; method: its label; is_water_known:
    whether colours that the method guessed for holes are used.
    """

    name: str
    photograph: Path
    view: View
    image: Path
    lens: Lens | None
    method: str
    is_water_known: bool = True


@dataclass(frozen=True)
class Written:
    """What became of the pictures. faults: why a photograph has none, by its name."""

    names: tuple[str, ...]
    faults: dict[str, str]


def write_pictures(
    restored: Sequence[Restored], out: Path, quality: int, original_geometry: bool, since_ns: int
) -> Written:
    """Write the picture of each photograph below out/pictures, and out/contact-sheet.jpg.

    quality: of JPEG and WebP, 1 to 100; original_geometry: with the photograph's lens, else undistorted; since_ns: a
    picture that is newer than this time and its restored image stays. Raises OutputError if files cannot be written.
    What is wrong with one photograph is a fault, and the others are written.
    """
    folder = out / "pictures"
    names, faults = list[str](), dict[str, str]()
    for one in track(restored, "writing pictures"):
        target = folder / one.name
        try:
            newest = max(since_ns, one.image.stat().st_mtime_ns)
            if not target.is_file() or target.stat().st_mtime_ns < newest:
                picture = (to_16bit if bits_of(one.photograph) == 16 else to_8bit)(_picture(one, original_geometry))
                write_atomically(target, encoded(picture, one.photograph.read_bytes(), quality))
            names.append(one.name)
        except OutputError:
            raise
        except SucreBenchError as fault:
            faults[one.name] = str(fault)
        except ANY_FAULT as fault:  # of a library, about one photograph's metadata
            faults[one.name] = one_line(fault)
    there = [one for one in restored if one.name in set(names)]
    if there:
        write_atomically(out / "contact-sheet.jpg", _sheet([there[k] for k in evenly(len(there), _MOST_SHOWN)], folder))
    return Written(tuple(names), faults)


def _picture(one: Restored, original_geometry: bool) -> Array:
    """The whole picture (H, W, 3) in [0, 1]. Raises InputError if a file cannot be read or has another size."""
    picture, view = read_rgb(one.image), one.view
    mask = read_mask(one.image)
    known = np.ones(picture.shape[:2], np.bool_) if mask is None else mask
    if one.is_water_known:
        known |= picture.any(axis=-1)  # pixels without depth that the method filled
    beside = display(view.rgb, "none", view.encoding)
    if original_geometry and one.lens is not None:
        lens, beside = one.lens, display(read_rgb(one.photograph), "none", view.encoding)
        if beside.shape[1::-1] != (lens.camera.width, lens.camera.height):
            size = f"{beside.shape[1]}x{beside.shape[0]}"
            fault = f"is {size}, its camera {lens.camera.width}x{lens.camera.height}"
            raise InputError(fault, one.photograph, "leave out --original-geometry")
        picture, known = as_photographed(lens, picture, known)
    return whole(picture, known, beside)


def _sheet(restored: Sequence[Restored], folder: Path) -> bytes:
    """The contact sheet, a JPEG: each photograph beside its picture, as viewers turn it."""
    from PIL import Image

    pairs = []
    for one in restored:
        sides = []
        for path in (one.photograph, folder / one.name):
            picture = Image.fromarray(to_8bit(read_rgb(path)))
            picture.thumbnail((_WIDE, 2 * _WIDE))
            with suppress(*ANY_FAULT), Image.open(one.photograph) as source:
                turned = {3: 180, 6: 270, 8: 90}.get(source.getexif().get(_ORIENTATION, 1), 0)
                picture = picture.rotate(turned, expand=True)
            sides.append(picture)
        pairs.append((sides[0], sides[1]))
    content, captions = io.BytesIO(), [f"{one.name}   {one.method}"[-90:] for one in restored]
    contact_sheet(pairs, captions, _WIDE).save(content, "JPEG", quality=90)
    return content.getvalue()


# -- whole pictures, and the geometry of the photograph ---------------------------------------------------------------


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
