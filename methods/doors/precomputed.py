"""A method of images that exist already: renderings of a radiance field, results of published code."""

import difflib
import functools
import os
import string
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import nan
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np

from sucre_bench import Restoration, Scene, method
from sucre_bench.arrays import Array, Mask
from sucre_bench.errors import FileError, InputError, MissingFileError, NotApplicableError, did_you_mean
from sucre_bench.imaging import image_files
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.image_files import decode, read_array, read_tiff, same_shape, size_of_only_page
from sucre_bench.results.water_file import read_water
from sucre_bench.scene import Encoding, View, Water

# Finds the restored image of a view by its file name.
#
# The image of ``left/a.jpg`` is ``left/a`` in the folder, of any kind that can be read; or else the only ``a`` in it,
# at any depth, provided that no other view of the scene is called ``a``. A pattern says how names differ:
# "restored_{stem}" is ``left/restored_a.png``. One with a slash is a path from the folder, and nothing else is tried.
# One that ends in {name} or in a suffix, "{stem}_out.tif", is a whole file name.

_ByName = dict[str, list[PurePosixPath]]

SUFFIXES = (*image_files.SUFFIXES, ".npy", ".npz")


def check_pattern(pattern: str, option: str) -> None:
    """Raise InputError unless a pattern tells views apart and has no placeholder but {stem}, {name} and {parent}."""
    used = placeholders(pattern, ("name", "parent", "stem"), option)
    if not used & {"stem", "name"}:
        raise InputError(f"{option}: '{pattern}' is the same for every view; put {{stem}} into it")


def inside(name: str) -> PurePosixPath:
    """Return a view's name as a path, or raise InputError where it leads out of the folder that it is taken in."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not path.name:
        raise InputError(f"{name}: is no path inside a folder; rename the view")
    return path


@dataclass(frozen=True)
class ImageFolder:
    """The images in a folder, found by pattern. It lists each folder once: what is put there afterwards is not seen."""

    folder: Path
    pattern: str = "{stem}"
    _listed: dict[PurePosixPath, _ByName] = field(default_factory=dict, init=False, repr=False, compare=False)

    def find(self, name: str, names: Sequence[str]) -> Path:
        """Return the image of the view of that name. names: of all the scene's views.

        Raises InputError where two files may be the view's, or a file another view's as well, or it lies elsewhere;
        NotApplicableError, saying what was looked for, where there is none.
        """
        wanted = _place(inside(name), self.pattern)
        views = _views(tuple(names), self.pattern)
        found, rivals = self._beside(wanted.parent).get(wanted.name, []), views.at.get(wanted, ())
        if not found and "/" not in self.pattern:
            # A file in another view's place is not this one's.
            found = [path for path in self._below.get(wanted.name, []) if path.with_name(wanted.name) not in views.at]
            rivals = views.called.get(wanted.name, ())
        rival = next((other for other in rivals if other != name), None)
        if not found:
            raise NotApplicableError(f"{name}: {self._looked_for(wanted)}")
        path = self.folder / found[0]
        if len(found) > 1:
            fault = f"{found[1]} in {self.folder} is there as well"
            raise InputError(f"{path}: {fault}; keep one, or tell them apart with pattern='{{stem}}.png'")
        if rival:
            fault = f"may belong to {name} or {rival}"
            raise InputError(f"{path}: {fault}; use sub-folders as the views do, or pattern='{{name}}'")
        if not path.resolve().is_relative_to(self.folder.resolve()):
            raise InputError(f"{path}: leads out of the folder; copy the file into it")
        return path

    @property
    def _whole(self) -> bool:
        """Whether the pattern is of a whole file name, with its suffix."""
        return self.pattern.endswith("{name}") or self.pattern.lower().endswith(SUFFIXES)

    def _beside(self, parent: PurePosixPath) -> _ByName:
        """The images of one folder."""
        if parent not in self._listed:
            try:
                there = sorted(parent / path.name for path in (self.folder / parent).iterdir())
            except (FileNotFoundError, NotADirectoryError):
                there = []
            self._listed[parent] = self._by_name(there)
        return self._listed[parent]

    @functools.cached_property
    def _below(self) -> _ByName:
        """The images at any depth."""
        walk = ((Path(place).relative_to(self.folder).as_posix(), files) for place, _, files in os.walk(self.folder))
        return self._by_name(PurePosixPath(place, file) for place, files in walk for file in sorted(files))

    def _by_name(self, paths: Iterable[PurePosixPath]) -> _ByName:
        """Images, by what a pattern says of their name."""
        sorted_in: _ByName = {}
        for path in paths:
            if path.name.lower().endswith(SUFFIXES):
                sorted_in.setdefault(path.name if self._whole else path.stem, []).append(path)
        return sorted_in

    def _looked_for(self, wanted: PurePosixPath) -> str:
        """Why nothing was found: what was looked for, and what comes near."""
        there = [str(path if self._whole else path.with_suffix("")) for paths in self._below.values() for path in paths]
        if not there:
            return f"there are no images in {self.folder}"
        exact = "/" in self.pattern or wanted.parent == PurePosixPath()
        tried = [str(wanted)] if exact else [str(wanted), wanted.name]
        near = difflib.get_close_matches(tried[0], there, n=1, cutoff=0) or there[:1]
        kinds = "" if self._whole else f" (any of {', '.join(SUFFIXES)})"
        named = f"named {' or '.join(tried)}{kinds}"
        return f"no image in {self.folder} is {named}; the nearest of {len(there)} is {near[0]}"


def _place(name: PurePosixPath, pattern: str) -> PurePosixPath:
    """Where a view's image should be, relative to the folder; without suffix, unless the pattern has one."""
    filled = PurePosixPath(pattern.format(stem=name.stem, name=name.name, parent=name.parent))
    return filled if "/" in pattern else name.parent / filled


@dataclass(frozen=True)
class _Views:
    """The names of the views whose image belongs at a place, and of those whose image is called like that."""

    at: Mapping[PurePosixPath, Sequence[str]]
    called: Mapping[str, Sequence[str]]


@functools.lru_cache(maxsize=8)  # all views of a scene ask for the same
def _views(names: tuple[str, ...], pattern: str) -> _Views:
    at: dict[PurePosixPath, list[str]] = {}
    called: dict[str, list[str]] = {}
    for name in names:
        place = _place(PurePosixPath(name), pattern)
        at.setdefault(place, []).append(name)
        called.setdefault(place.name, []).append(name)
    return _Views(at, called)


def placeholders(template: str, known: Collection[str], option: str) -> frozenset[str]:
    """Return the names of the placeholders in a template, which `str.format` then fills.

    Raises InputError, naming the option, for one that is not known or not a plain name, and for a stray brace.
    """
    try:
        fields = [field for field in string.Formatter().parse(template) if field[1] is not None]
    except ValueError as fault:
        raise InputError(f"{option}: '{template}': {fault}; write {{{{ and }}}} for braces") from fault
    for _, name, form, conversion in fields:
        if name in known and (form or conversion):
            written = f"{{{name}{f'!{conversion}' if conversion else ''}{f':{form}' if form else ''}}}"
            raise InputError(f"{option}: '{written}': no format or conversion is allowed; write {{{name}}}")
        if name not in known:
            hint = did_you_mean(str(name), known)
            raise InputError(f"{option}: no placeholder '{{{name}}}'; {hint}; write {{{{ and }}}} for braces")
    return frozenset(str(name) for _, name, _, _ in fields)


# Reads a restored image that another program wrote, and the water beside it.
#
# 8- and 16-bit files are divided by 255 and 65535; floating ones, .npy, .npz and .tif, are taken as they are. Arrays
# are (H, W, 3) in RGB order, those with a fourth channel have their transparency there; an .npz holds one, or several
# and one called "image".

FileEncoding = Literal["view", "gamma", "linear"]
Holes = Literal["alpha", "black", "none"]

# A restoration may exceed 1, but half of its values do not exceed 2; those of 0 to 255 do.
_MOST_MEDIAN = 2.0


@dataclass(frozen=True)
class Reading:
    """How restored images are to be read; each of its options means what `Precomputed` says of it."""

    encoding: FileEncoding
    holes: Holes
    resize: bool

    def image(self, path: Path, view: View) -> tuple[Array, dict[str, Any]]:
        """Return a view's restored image, (H, W, 3) float32 in the view's encoding, NaN in holes, and what was done.

        Raises InputError where it cannot be read, has no pixel with a colour, or is not of the view's size.
        """
        if (found := size_of_only_page(path)) is not None:
            self._check_size(view, found, path)
        image, transparent = _colours(path)
        holes = ~np.isfinite(image).all(axis=-1)
        if self.holes != "none":
            holes |= transparent
        if self.holes == "black":
            holes |= (image == 0).all(axis=-1)
        if holes.all():
            raise InputError(f"{path}: no pixel has a colour; see method.holes, {self.holes} here")
        image[holes] = np.nan
        image = converted(image, encoding_of(self.encoding, view), view.encoding).astype(np.float32)
        return self._at_size_of(view, image, path)

    def _at_size_of(self, view: View, image: Array, path: Path) -> tuple[Array, dict[str, Any]]:
        import cv2

        height, width = view.rgb.shape[:2]
        found = (image.shape[1], image.shape[0])
        if found == (width, height):
            return image, {}
        self._check_size(view, found, path)
        # A pixel that is mixed from a hole and its neighbours becomes a hole too: NaN spreads.
        how = cv2.INTER_AREA if found[0] > width else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(image, (width, height), interpolation=how)), {"resized_from": list(found)}

    def _check_size(self, view: View, found: tuple[int, int], path: Path) -> None:
        """Raise InputError unless an image of its own size (width, height) is of the view's size, or may be resized."""
        height, width = view.rgb.shape[:2]
        sizes = f"is {found[0]}x{found[1]}, the view is {width}x{height}"
        if not same_shape(found, (width, height)):
            raise InputError(f"{path}: {sizes}, another shape; restore the view as it is, uncropped")
        if found != (width, height) and not self.resize:
            raise InputError(f"{path}: {sizes}; restore it at that size, or give method.resize=true")


def encoding_of(encoding: FileEncoding, view: View) -> Encoding:
    """Return the encoding of a view's files."""
    return view.encoding if encoding == "view" else encoding


def water_beside(path: Path, files: FileEncoding, view: View) -> Water | None:
    """Return the water that ``a.json`` beside ``a.png`` holds as B and, if known, beta and gamma; None without.

    It explains intensities of the "encoding" that it names, as the files are encoded where it names none.
    Raises what `read_water` raises.
    """
    beside = path.with_suffix(".json")
    water = read_water(beside) if beside.is_file() else None
    return water and replace(water, encoding=water.encoding or encoding_of(files, view))


def _colours(path: Path) -> tuple[Array, Mask]:
    """An image file as (H, W, 3) float32, RGB, and where it is transparent."""
    stored = _stored(path)
    if stored.ndim == 2:
        stored = stored[..., None]
    if stored.ndim != 3 or stored.shape[2] not in (1, 3, 4) or not stored.size:
        shape = "x".join(map(str, stored.shape))
        raise InputError(f"{path}: is an array of {shape}; expected height x width x 3, colours in RGB order")
    if stored.dtype.kind == "f":
        with np.errstate(over="ignore"):  # what float32 cannot hold is a hole
            values = stored.astype(np.float32)
        some = values[..., :3].reshape(-1)[:: max(1, values.size // 1_000_000)]
        if (some > _MOST_MEDIAN).sum() > some.size / 2:
            raise InputError(f"{path}: half of its values exceed {_MOST_MEDIAN:g}; divide them so that white is 1")
    elif stored.dtype in (np.uint8, np.uint16):
        values = stored.astype(np.float32) / np.float32(np.iinfo(stored.dtype).max)
    else:
        raise InputError(f"{path}: is {stored.dtype}; save it with 8 or 16 bits a channel, or as floats")
    transparent = values[..., 3] == 0 if values.shape[2] == 4 else np.zeros(values.shape[:2], dtype=bool)
    colours = values.repeat(3, axis=2) if values.shape[2] == 1 else values[..., :3].copy()
    return colours, transparent


def _stored(path: Path) -> np.ndarray:
    """What a file holds, channels in RGB order."""
    import cv2

    suffix = path.suffix.lower()
    if suffix in (".npy", ".npz"):
        return _array(path)
    if suffix in (".tif", ".tiff") and (values := _tiff(path)) is not None:
        return values
    values = decode(path, cv2.IMREAD_UNCHANGED)
    return values if values.ndim == 2 else values[..., [2, 1, 0, 3][: values.shape[2]]]


def _array(path: Path) -> np.ndarray:
    return read_array(path, lambda names: "image" if "image" in names or len(names) != 1 else names[0])


def _tiff(path: Path) -> np.ndarray | None:
    """What a TIFF holds; None where another reader is to try, or to say what is wrong.

    OpenCV multiplies 8-bit colours by their transparency, and splits float images into pages.
    """
    try:
        return read_tiff(path)
    except InputError:
        raise
    except Exception:  # of any kind: each of its decoders has its own
        return None


_REMEDY = "give the folder that holds the restored images"


@method(reads=("folder",))
@dataclass(frozen=True)
class Precomputed:
    """Read images that were restored elsewhere, one for each view, from a folder by the view's name.

    A view without an image is skipped. Time and memory are unknown. A file a.json beside a.png may hold the water: B,
    and beta and gamma if known, three numbers each, and `encoding` if it explains other intensities than the image's.
    """

    folder: Path
    """Folder of the restored images: png, jpg, tif, bmp, webp, npy, npz; in sub-folders like the views, or not."""

    pattern: str = "{stem}"
    """Name of a view's image: {stem} is the view's file name without suffix, {name} with it, {parent} its folder.
    Examples: 'restored_{stem}', '{stem}.npz', '{parent}/out/{stem}'."""

    encoding: FileEncoding = "view"
    """Encoding of the files: gamma (sRGB), linear, or view (that of the view's image)."""

    holes: Holes = "alpha"
    """Which pixels have no colour. alpha: fully transparent pixels; black: also exactly black pixels; none: no pixel.
    NaN and infinity are always holes."""

    resize: bool = False
    """Resize images of another size to the view, by area or linearly; false: another size is an error."""

    def __post_init__(self) -> None:
        check_pattern(self.pattern, "precomputed.pattern")
        if not self.folder.exists():
            raise MissingFileError("no such folder", self.folder, _REMEDY)
        if not self.folder.is_dir():
            raise FileError("is a file, not a folder", self.folder, _REMEDY)

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the image found for the view, in the view's encoding.

        info: "file", and "resized_from" (width, height) if it was resized.
        Raises NotApplicableError when there is none, InputError when several fit or it cannot be read.
        """
        path = self._images.find(view.name, [v.name for v in scene.views])
        image, done = Reading(self.encoding, self.holes, self.resize).image(path, view)
        file = path.relative_to(self.folder).as_posix()
        info = {"file": file, **done, "seconds": nan, "peak_mb": nan, "device": "unknown"}
        return Restoration(image, water_beside(path, self.encoding, view), info=info)

    @functools.cached_property
    def _images(self) -> ImageFolder:
        return ImageFolder(self.folder, self.pattern)
