"""Finds and checks photos, and prepares them for feature detection."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from sucre_bench.arrays import AnyArray, Size
from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.imaging.image_files import decode, image_size, read_bgr, same_shape, write_png
from sucre_bench.loading.image_folder import image_names, no_image
from sucre_bench.loading.passed_over import folders_in, say_passed_over
from sucre_bench.machine.files import check_folder
from sucre_bench.machine.progress import track


@dataclass(frozen=True, slots=True)
class Photo:
    """A photo."""

    name: str
    """Path relative to the folder of photos, which orders them."""

    key: str
    """A name that any program accepts."""

    path: Path

    size: Size
    """(width, height) in pixels, after shrinking."""

    output: str
    """The name of its undistorted image."""

    mask: Path | None
    """The file whose black parts are not used."""

    stamp: tuple[object, ...]
    """Identifies the file's version."""


def find_photos(
    folder: Path, masks: Path | None, max_size: int, leave_out: Path
) -> tuple[list[Photo], dict[str, str]]:
    """Return the photos of a folder and its sub-folders in order of their names, and the fault of each damaged one.

    max_size: shrink larger photos to this longest side, 0: do not; leave_out: a sub-folder without photos, for example
    that of the masks.
    Raises InputError if there are fewer than two photos, or if a mask is missing or has another shape.
    """
    check_folder(folder, "give the one that holds the photos")
    names = image_names(folder, subfolders=True, but=leave_out)
    names = [
        name
        for name in names
        if not masks or masks.resolve() not in (folder / name).resolve().parents
    ]
    left_out = [leave_out, *filter(None, [masks])]
    say_passed_over(folder, folders_in(folder, left_out), [folder / name for name in names])
    shared = Counter(PurePosixPath(name).with_suffix("") for name in names)
    photos: list[Photo] = []
    damaged: dict[str, str] = {}
    for name in names:
        path = folder / name
        pure = PurePosixPath(name)
        size = image_size(path)
        if size is None:
            damaged[name] = _damage(path)
            continue
        shrink = min(1.0, max_size / max(size)) if max_size else 1.0
        output = (
            f"{name}.png"
            if shared[pure.with_suffix("")] > 1
            else pure.with_suffix(".png").as_posix()
        )
        mask = None if masks is None else _find_mask(masks, pure, size)
        stamps = [
            (p.stat().st_size, p.stat().st_mtime_ns) for p in (path, mask) if p is not None
        ]
        used = (max(1, round(size[0] * shrink)), max(1, round(size[1] * shrink)))
        photos.append(
            Photo(
                name, f"{len(photos):06d}.png", path, used, output, mask, (name, used, *stamps)
            )
        )
    if len(photos) < 2:  # then decode every file: a valid header may have no picture
        raise too_few(
            folder,
            len(names),
            damaged | {p.name: why for p in photos if (why := _damage(p.path))},
        )
    return photos, damaged


def too_few(folder: Path, files: int, damaged: Mapping[str, str]) -> InputError:
    """Return the error for a folder with fewer than two readable photos; it names the unreadable files."""
    what = "holds one photo" if files > len(damaged) else "holds no photos"
    if damaged:
        reasons = [f"{name} {why.partition('; ')[0]}" for name, why in sorted(damaged.items())]
        more = f"; and {len(reasons) - 4} more" if len(reasons) > 4 else ""
        what = f"{what} that can be read ({'; '.join(reasons[:4])}{more})"
    return no_image(folder, what, "put two or more .jpg, .png or .tif of one place there")


def _find_mask(masks: Path, name: PurePosixPath, size: Size) -> Path:
    """COLMAP names the mask of a.jpg a.jpg.png; most other tools a.png."""
    for file in (masks / f"{name}.png", masks / name.with_suffix(".png")):
        if file.is_file():
            found = image_size(file)
            if found is not None and not same_shape(found, size):
                fault = f"is {found[0]}x{found[1]}, its photo {size[0]}x{size[1]}"
                raise InputError(fault, file, "make the mask in the photo's shape")
            return file
    remedy = "make a mask for every photo, white where it is to be used"
    raise MissingFileError("is not there", masks / f"{name}.png", remedy)


def read_photo(photo: Photo) -> AnyArray:
    """Return a photo (H, W, 3) BGR uint8 or uint16 at its size of use. Raises InputError if unreadable."""
    import cv2

    stored = read_bgr(photo.path)
    return (
        stored
        if stored.shape[1::-1] == photo.size
        else cv2.resize(stored, photo.size, interpolation=cv2.INTER_AREA)
    )


def _damage(path: Path) -> str:
    """Why a photo cannot be read, and the remedy; empty if it can."""
    try:
        read_bgr(path)
    except InputError as fault:
        return fault.beside(path)
    return ""


def read_mask(path: Path, size: Size) -> AnyArray:
    """Return a mask (H, W) uint8, white where the picture is used, at a size (width, height)."""
    import cv2

    return np.asarray(
        cv2.resize(decode(path, cv2.IMREAD_GRAYSCALE), size, interpolation=cv2.INTER_NEAREST)
    )


def write_gray(photos: Sequence[Photo], folder: Path, longest: int) -> dict[str, str]:
    """Write 8-bit gray pictures of the photos, and masks, for feature detection; return the faults of damaged ones.

    longest: their longest side in pixels. 16-bit photos, which are often linear and dark, are stretched.
    """
    import cv2

    damaged = {}
    for photo in track(photos, "reading photos"):
        target = folder / "gray" / photo.key
        if target.is_file():
            continue
        try:
            gray = cv2.cvtColor(read_photo(photo), cv2.COLOR_BGR2GRAY)
        except InputError as fault:
            damaged[photo.name] = fault.beside(photo.path)
            continue
        if gray.dtype == np.uint16:
            top = max(float(np.quantile(gray[::8, ::8], 0.995)), 1.0)
            gray = np.clip(gray * (255 / top), 0, 255).astype(np.uint8)
        shrink = min(1.0, longest / max(photo.size))
        size = (round(photo.size[0] * shrink), round(photo.size[1] * shrink))
        if photo.mask is not None:
            write_png(folder / "masks" / f"{photo.key}.png", read_mask(photo.mask, size))
        write_png(target, cv2.resize(gray, size, interpolation=cv2.INTER_AREA))
    return damaged
