"""Writes the pictures and the contact sheet of photographs that the engine restored."""

import io
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, evenly
from sucre_bench.errors import ANY_FAULT, InputError, OutputError, one_line
from sucre_bench.imaging.colour_profiles import read_srgb
from sucre_bench.imaging.display import display
from sucre_bench.imaging.drawing import contact_sheet
from sucre_bench.imaging.encoding import to_8bit, to_levels
from sucre_bench.imaging.image_files import decode, image_size, read_rgb
from sucre_bench.loading.lens import Lens
from sucre_bench.machine.compute import usable_cores
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import track
from sucre_bench.programs.restore.picture_file import bits_of, encoded
from sucre_bench.programs.restore.whole import as_photographed, whole, with_open_water
from sucre_bench.results.restorations import read_mask
from sucre_bench.scene import View

# pairs on the contact sheet, evenly chosen
_MOST_SHOWN = 60
# pixels of a picture's width
_WIDE = 320
_BYTES_A_PIXEL = 80  # that writing a picture takes: 1.8 GB for 24 megapixels
_MOST_AT_ONCE = 4  # pictures that are written: a container or a cluster job may allow less memory than is free
_ORIENTATION = 274
_INTERPOLATED = 3  # in a map of depth's origins: between measured points, so perhaps beyond an edge of the ground


@dataclass(frozen=True, eq=False)
class Restored:
    """A photograph that the engine restored."""

    name: str
    """Path of its picture below the folder of pictures."""

    photograph: Path
    """Its file."""

    view: View
    """What was restored."""

    image: Path
    """The restored image."""

    lens: Lens | None
    """Of the photograph, if the view is its pinhole image."""

    origin: Path | None
    """Where `prepare` says how each pixel got its depth, if it does."""

    method: str
    """Its label."""

    measured: float
    """Share of pixels with a measured distance."""

    limits: Sequence[str]
    """What the method says of its result, in words."""

    record: Mapping[str, Any]
    """All that is stored of the restoration beside its image."""

    is_of_dive: bool
    """Whether it was restored with others."""


def write_pictures(
    restored: Sequence[Restored],
    out: Path,
    quality: int,
    original_geometry: bool,
    since_ns: int,
) -> dict[str, str]:
    """Write the picture of each photograph below out/pictures, and out/contact-sheet.jpg; return why some have none.

    quality: of JPEG and WebP, 1 to 100; original_geometry: with the photograph's lens, else undistorted; since_ns: a
    picture that is newer than this time and its restored image stays. Raises OutputError if files cannot be written.
    What is wrong with one photograph is a fault, and the others are written.
    """
    import psutil

    folder = out / "pictures"

    def write(one: Restored) -> str:
        """Write a picture, and return why there is none."""
        target = folder / one.name
        try:
            newest = max(since_ns, one.image.stat().st_mtime_ns)
            if not target.is_file() or target.stat().st_mtime_ns < newest:
                picture = to_levels(_picture(one, original_geometry), bits_of(one.photograph))
                write_atomically(target, encoded(picture, one.photograph.read_bytes(), quality))
            return ""
        except OutputError:
            raise
        except ANY_FAULT as fault:  # one photograph's, or of a library about its metadata
            return one_line(fault)

    pixels = [math.prod(image_size(one.photograph) or (math.inf,)) for one in restored]
    fit = psutil.virtual_memory().available / (_BYTES_A_PIXEL * max(pixels, default=1))
    with ThreadPoolExecutor(max(1, int(min(_MOST_AT_ONCE, usable_cores(), fit)))) as pool:
        whys = list(track(pool.map(write, restored), "writing pictures", len(restored)))
    faults = {one.name: why for one, why in zip(restored, whys, strict=True) if why}
    if there := [one for one in restored if one.name not in faults]:
        write_atomically(
            out / "contact-sheet.jpg",
            _sheet([there[k] for k in evenly(len(there), _MOST_SHOWN)], folder),
        )
    return faults


def _picture(one: Restored, original_geometry: bool) -> Array:
    """The whole picture (H, W, 3) in [0, 1]. Raises InputError if a file cannot be read or has another size."""
    import cv2

    picture, mask = read_rgb(one.image), read_mask(one.image)
    measured = np.ones(picture.shape[:2], np.bool_) if mask is None else mask
    coloured = measured
    if one.origin and one.origin.is_file():
        origin = cv2.resize(
            decode(one.origin, 0), measured.shape[::-1], interpolation=cv2.INTER_NEAREST_EXACT
        )
        measured = measured & (origin != _INTERPOLATED)
    if not measured.all():
        beside = display(one.view.rgb, "none", one.view.encoding)
        picture = with_open_water(whole(picture, coloured, beside), measured, beside)
    if not original_geometry or one.lens is None:
        return picture
    lens = one.lens
    beside = display(read_rgb(one.photograph), "none", one.view.encoding)
    if beside.shape[1::-1] != lens.camera.size:
        size = f"{beside.shape[1]}x{beside.shape[0]}"
        fault = f"is {size}, its camera {lens.camera.width}x{lens.camera.height}"
        raise InputError(fault, one.photograph, "leave out --original-geometry")
    return whole(*as_photographed(lens, picture, np.ones(measured.shape, dtype=bool)), beside)


def _sheet(restored: Sequence[Restored], folder: Path) -> bytes:
    """The contact sheet, a JPEG: each photograph beside its picture, as viewers turn it."""
    from PIL import Image

    pairs = []
    for one in restored:
        sides = []
        for path in (one.photograph, folder / one.name):
            picture = Image.fromarray(to_8bit(read_srgb(path)[0]))
            picture.thumbnail((_WIDE, 2 * _WIDE))
            with suppress(*ANY_FAULT), Image.open(one.photograph) as source:
                turned = {3: 180, 6: 270, 8: 90}.get(source.getexif().get(_ORIENTATION, 1), 0)
                picture = picture.rotate(turned, expand=True)
            sides.append(picture)
        pairs.append((sides[0], sides[1]))
    content = io.BytesIO()
    captions = [f"{one.name}   {one.method}"[-90:] for one in restored]
    contact_sheet(pairs, captions, _WIDE).save(content, "JPEG", quality=90)
    return content.getvalue()
