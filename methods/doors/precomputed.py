"""A method of images that exist already: renderings of a radiance field, results of published code."""

import difflib
import functools
import json
import os
import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path, PurePosixPath
from typing import Any, Literal, get_args

import numpy as np

from sucre_bench import InputError, NotApplicableError, Restoration, Scene, View, method
from sucre_bench.arrays import Array, evenly
from sucre_bench.errors import did_you_mean
from sucre_bench.imaging import image_files
from sucre_bench.imaging.colour_profiles import PROFILE, profile_of, view_in_srgb
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.image_files import decode, read_array, read_tiff, same_shape
from sucre_bench.imaging.orientation import lying_as
from sucre_bench.imaging.reference_images import NEARER, outline, psnr_of, say_if_black
from sucre_bench.loading.passed_over import EXPORT, other_photographs
from sucre_bench.loading.view_files import source_files
from sucre_bench.machine.files import check_folder, reading, regular
from sucre_bench.results.water_file import read_water
from sucre_bench.scene import Encoding

SUFFIXES = (*image_files.SUFFIXES, ".npy", ".npz")


def placeholders(template: str, known: Collection[str], option: str) -> frozenset[str]:
    """Return the names of the placeholders in a template, which `str.format` then fills.

    Raises InputError, naming the option, for one that is not known or not a plain name, and for a stray brace.
    """
    braces = "write {{ and }} for braces"
    single = re.sub(r"\{\{|\}\}", "", template)
    used = re.findall(r"\{([^{}]*)\}", single)
    for text in used:
        name = re.split("[!:]", text)[0]
        if name not in known:
            raise InputError(
                f"{option}: no placeholder '{{{name}}}'; {did_you_mean(name, known)}; {braces}"
            )
        if text != name:
            raise InputError(
                f"{option}: '{{{text}}}': no format or conversion is allowed; write {{{name}}}"
            )
    if single.count("{") + single.count("}") > 2 * len(used):
        raise InputError(f"{option}: '{template}': a single brace; {braces}")
    return frozenset(used)


def check_pattern(pattern: str, option: str) -> None:
    """Raise InputError unless a pattern tells views apart and has no placeholder but {stem}, {name} and {parent}."""
    if not placeholders(pattern, ("name", "parent", "stem"), option) & {"stem", "name"}:
        raise InputError(
            f"{option}: '{pattern}' is the same for every view; put {{stem}} into it"
        )


def inside(name: str) -> PurePosixPath:
    """Return a path relative to a folder, or raise InputError where it leads out of that folder."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not path.name:
        raise InputError(f"{name}: is no path inside a folder; rename the view")
    return path


_Index = Mapping[str, Sequence[tuple[PurePosixPath, str]]]


def _index(things: Iterable[tuple[PurePosixPath, str]]) -> _Index:
    """Names of views or files with their places in a folder, by the name that a place ends in."""
    called: dict[str, list[tuple[PurePosixPath, str]]] = defaultdict(list)
    for place, thing in things:
        called[place.name].append((place, thing))
    return called


def _place(name: str, pattern: str) -> PurePosixPath:
    """Where a view's image should be, relative to the folder; without suffix, unless the pattern has one."""
    path = PurePosixPath(name)
    filled = PurePosixPath(pattern.format(stem=path.stem, name=path.name, parent=path.parent))
    return filled if "/" in pattern else path.parent / filled


@functools.lru_cache(maxsize=8)  # all views of a scene ask for the same
def _views(names: tuple[str, ...], pattern: str) -> _Index:
    return _index((_place(name, pattern), name) for name in names)


@dataclass(frozen=True)
class ImageFolder:
    """The images in a folder, found by pattern. It is listed once: what is put there afterwards is not seen.

    The image of ``left/a.jpg`` is ``left/a`` in the folder, of any kind that can be read; or else the only ``a`` in it,
    at any depth, provided that no other view of the scene is called ``a``. A pattern says how names differ:
    "restored_{stem}" is ``left/restored_a.png``. One with a slash is a path from the folder, and nothing else is tried.
    One that ends in {name} or in a suffix, "{stem}_out.tif", is a whole file name.
    """

    folder: Path
    pattern: str = "{stem}"

    def find(self, name: str, names: Sequence[str]) -> Path:
        """Return the image of the view of that name. names: of all the scene's views.

        Raises InputError where two files may be the view's, or a file another view's as well, or it lies elsewhere.
        NotApplicableError, saying what was looked for, where there is none.
        """
        wanted = inside(str(_place(str(inside(name)), self.pattern)))
        files_called, views_called = (
            index.get(wanted.name, ())
            for index in (self._files, _views(tuple(names), self.pattern))
        )
        files = [file for place, file in files_called if place == wanted]
        owners = [view for place, view in views_called if place == wanted]
        tried = [str(wanted)]
        if not files and "/" not in self.pattern:
            # a file in another view's place is not this one's
            taken = {place for place, _ in views_called}
            files = [file for place, file in files_called if place not in taken]
            owners = [view for _, view in views_called]
            tried = sorted({str(wanted), wanted.name}, key=len)[::-1]
        if not files:
            kinds = "" if self._is_whole else f" (any of {', '.join(SUFFIXES)})"
            fault = f"no image in {self.folder} is named {' or '.join(tried)}{kinds}"
            places = [str(place) for called in self._files.values() for place, _ in called]
            near = difflib.get_close_matches(tried[0], places, n=1, cutoff=0)
            nearest = (
                f"the nearest of {len(places)} is {near[0]}" if near else "there are no images"
            )
            raise NotApplicableError(f"{name}: {fault}; {nearest}")
        path = self.folder / files[0]
        if len(files) > 1:
            fault = f"{files[1]} in {self.folder} is there as well"
            raise InputError(
                f"{path}: {fault}; keep one, or tell them apart with pattern='{{stem}}.png'"
            )
        if rival := next((owner for owner in owners if owner != name), None):
            fault = f"may belong to {name} or {rival}"
            raise InputError(
                f"{path}: {fault}; use sub-folders as the views do, or pattern='{{name}}'"
            )
        if not path.resolve().is_relative_to(self.folder.resolve()):
            raise InputError(f"{path}: leads out of the folder; copy the file into it")
        return path

    @property
    def _is_whole(self) -> bool:
        """Whether the pattern is of a whole file name, with its suffix."""
        return self.pattern.endswith("{name}") or self.pattern.lower().endswith(SUFFIXES)

    @functools.cached_property
    def _files(self) -> _Index:
        """The images at any depth, by their place as the pattern gives it."""
        walk = (
            (Path(place).relative_to(self.folder), name)
            for place, _, names in os.walk(self.folder)
            for name in names
        )
        paths = sorted(
            PurePosixPath(place, name)
            for place, name in walk
            if name.lower().endswith(SUFFIXES)
        )
        return _index(
            (path if self._is_whole else path.with_suffix(""), str(path)) for path in paths
        )


FileEncoding = Literal["view", "gamma", "linear"]

# A restoration may exceed 1, but half of its values do not exceed 2; those of 0 to 255 do.
_MOST_MEDIAN = 2.0


@dataclass(frozen=True, kw_only=True)
class RestoredElsewhere:
    """Options of a method whose images another program makes, and the reader of such images.

    8- and 16-bit files are divided by 255 and 65535; floating ones, .npy, .npz and .tif, are taken as they are. Arrays
    are (H, W, 3) in RGB order, those with a fourth channel have their transparency there. An .npz holds one, or several
    and one called "image".
    """

    encoding: FileEncoding = "view"
    """Encoding of the files: gamma (sRGB), linear, or view (that of the view's image)."""

    holes: Literal["alpha", "black", "none"] = "alpha"
    """Which pixels have no colour. alpha: fully transparent pixels; black: also exactly black pixels; none: no pixel.
    NaN and infinity are always holes."""

    resize: bool = False
    """Resize images of another size to the view, by area or linearly; false: another size is an error."""

    trained_on: str = ""
    """What the method was trained on, for tables: "SET" or "DATASET less SET", with a set of `sucre-bench list sets`,
    or any other words. `compare` warns of test pictures that were among it."""

    def encoding_of(self, view: View) -> Encoding:
        """Return the encoding of a view's files."""
        return view.encoding if self.encoding == "view" else self.encoding

    def read(self, path: Path, view: View, photograph: Path | None = None) -> Restoration:
        """Return the restored image of a view from a file, in the view's encoding, and its water.

        A colour profile that the file has is converted to sRGB, and named in `info`. photograph: the view's file; the
        image is turned to lie as it does, see `lying_as`.
        The water is what ``a.json`` beside ``a.png`` holds. Raises InputError where the image cannot be read, has no
        pixel with a colour, or is not of the view's size, and what `read_water` raises.
        """
        import cv2

        colours, info = _colours(path), dict[str, Any]()
        if photograph:
            colours = lying_as(colours, path, lambda: view.rgb, photograph)
        image, size, found = colours[..., :3], view.rgb.shape[1::-1], colours.shape[1::-1]
        sizes = f"is {found[0]}x{found[1]}, the view is {size[0]}x{size[1]}"
        if not same_shape(found, size):
            raise InputError(
                f"{sizes}, another shape", path, "restore the view as it is, uncropped"
            )
        if found != size and not self.resize:
            remedy = "restore it at that size, or give method.resize=true"
            raise InputError(sizes, path, remedy)
        is_hole = np.asarray(~np.isfinite(image).all(axis=-1))
        if self.holes != "none" and colours.shape[2] == 4:
            is_hole |= colours[..., 3] == 0
        if self.holes == "black":
            is_hole |= (image == 0).all(axis=-1)
        if is_hole.all():
            raise InputError(
                f"{path}: no pixel has a colour; see method.holes, {self.holes} here"
            )
        seen = np.where(is_hole[..., None], np.float32(np.nan), image)
        remedy = "if it has none, give method.holes=black"
        say_if_black(path, seen, lambda: view.rgb, remedy)
        if profile := profile_of(path):
            image = profile.to_srgb(image, self.encoding_of(view))
            info = {PROFILE: profile.name}
        image = np.where(is_hole[..., None], np.float32(np.nan), image)
        image = converted(image, self.encoding_of(view), view.encoding).astype(np.float32)
        beside = path.with_suffix(".json")
        water = read_water(beside) if beside.is_file() else None
        water = water and replace(water, encoding=water.encoding or self.encoding_of(view))
        if found == size:
            return Restoration(image, water, info=info)
        # A pixel that is mixed from a hole and its neighbours becomes a hole too: NaN spreads.
        how = cv2.INTER_AREA if found[0] > size[0] else cv2.INTER_LINEAR
        resized = np.asarray(cv2.resize(image, size, interpolation=how), np.float32)
        return Restoration(resized, water, info={**info, "resized_from": list(found)})


def _colours(path: Path) -> Array:
    """An image file as (H, W, 3 or 4) float32: RGB, and alpha if it has one."""
    import cv2

    stored = None
    suffix = path.suffix.lower()
    if suffix in (".npy", ".npz"):
        stored = read_array(
            path, lambda names: "image" if "image" in names or len(names) != 1 else names[0]
        )
    elif suffix in (
        ".tif",
        ".tiff",
    ):
        # OpenCV multiplies 8-bit colours by alpha, and splits float images into pages
        try:
            stored = read_tiff(path)
        except InputError:
            raise
        except Exception:
            # each of its decoders has its own; OpenCV reads it, or says what is wrong
            pass
    if stored is None:
        stored = decode(path, cv2.IMREAD_UNCHANGED)
        stored = stored if stored.ndim == 2 else stored[..., [2, 1, 0, 3][: stored.shape[2]]]
    if stored.ndim == 2 or stored.shape[2:] == (1,):
        stored = np.broadcast_to(stored.reshape(*stored.shape[:2], 1), (*stored.shape[:2], 3))
    if stored.ndim != 3 or stored.shape[2] not in (3, 4) or not stored.size:
        shape = "x".join(map(str, stored.shape))
        raise InputError(
            f"{path}: is an array of {shape}; expected height x width x 3, colours in RGB order"
        )
    if stored.dtype in (np.uint8, np.uint16):
        return stored.astype(np.float32) / np.float32(np.iinfo(stored.dtype).max)
    if stored.dtype.kind != "f":
        raise InputError(
            f"{path}: is {stored.dtype}; save it with 8 or 16 bits a channel, or as floats"
        )
    with np.errstate(over="ignore"):  # what float32 cannot hold is a hole
        values = stored.astype(np.float32)
    some = values[..., :3].reshape(-1)[:: max(1, values.size // 1_000_000)]
    if (some > _MOST_MEDIAN).mean() > 0.5:
        raise InputError(
            f"{path}: half of its values exceed {_MOST_MEDIAN:g}; divide them so that white is 1"
        )
    return values


# New views of a scene that a rendering method learned: its pictures with water, of views that it did not learn from.
#
# renders/rendering.json, beside the pictures or above them, is what the pictures say of themselves:
#
#     {"held_out": 8, "encoding": "gamma", "white_balance": "none"}
#
# - held_out: names of the views that training did not see; or N, for every Nth view by name, from the first.
# - encoding: of the pictures: "gamma" (sRGB) or "linear".
# - white_balance: "none" where training saw the data set's own photographs. Other colours are compared with nothing.

_NAME = "rendering.json"
_EXAMPLE = '{"held_out": ["a.png"], "encoding": "gamma", "white_balance": "none"}'


def read_rendering(folder: Path) -> tuple[Path, list[str] | int, Encoding]:
    """Return the file that says how pictures were rendered, which views were held out, and the pictures' encoding.

    Raises InputError where there is no such file, it says too little, or the white balance is another.
    """
    path = next(
        (place / _NAME for place in (folder, folder.parent) if (place / _NAME).is_file()),
        folder / _NAME,
    )
    with reading(path, f"write there how the pictures were rendered, such as {_EXAMPLE}"):
        told: dict[str, Any] = json.loads(regular(path).read_text(encoding="utf-8"))
        held_out, encoding, balance = told["held_out"], told["encoding"], told["white_balance"]
    is_list = (
        isinstance(held_out, list)
        and held_out
        and all(isinstance(name, str) for name in held_out)
    )
    if not is_list and not (type(held_out) is int and held_out > 1):
        raise InputError(
            f"held_out is {held_out!r}",
            path,
            "give names of views, or N above 1 for every Nth view",
        )
    if encoding not in get_args(Encoding):
        raise InputError(f"encoding is {encoding!r}", path, "give gamma or linear")
    if balance != "none":
        remedy = 'train on the photographs as the data set has them and write "none", or give those that it saw'
        raise InputError(
            f"white_balance is {balance!r}, the photographs have their own", path, remedy
        )
    return path, held_out, encoding


def held_out_views(path: Path, held_out: list[str] | int, names: Sequence[str]) -> list[str]:
    """Return which of all views of a scene were held out. InputError where one is no view of it."""
    if isinstance(held_out, int):
        return sorted(names)[::held_out]
    for name in held_out:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1, cutoff=0)
            raise InputError(
                f"holds out '{name}', which is no view of the scene",
                path,
                f"the nearest is {near[0]}",
            )
    return held_out


_MOST_OTHERS = 60


@functools.lru_cache(maxsize=4 * _MOST_OTHERS)  # all views of a scene ask for the same
def _outline_of(view: View) -> Array:
    return outline(view.rgb)


def _say_if_of_other_view(path: Path, image: Array, scene: Scene, view: View) -> None:
    """Say that a picture is more like another view's photograph than like that of the view whose name it has."""
    names = [one.name for one in scene.views]
    at = names.index(view.name) if view.name in names else 0
    near = {k for k in (at - 1, at + 1) if 0 <= k < len(names)}
    others = {*evenly(len(names), _MOST_OTHERS), *near} - {at}
    edges = outline(image)
    alike = dict[str, float]()
    for k in sorted(others):
        with suppress(InputError):  # a photograph that cannot be read is named at its own turn
            alike[names[k]] = float(_outline_of(scene.views[k]) @ edges)
    nearest = max(alike, key=alike.__getitem__, default="")
    if nearest and alike[nearest] > float(_outline_of(view) @ edges) + NEARER:
        fault = f"{path.name} is more like the photograph {nearest} than like {view.name}, whose name it has"
        image_files.say_once_a_folder(
            path, "view", f"{fault}; see whether numbers of files are those of views"
        )


def similarity(picture: Array, photograph: Array) -> dict[str, float]:
    """Return PSNR (dB) and SSIM (Wang et al. 2004) of two images (H, W, 3) of one encoding, over all pixels.

    The picture is clipped to [0, 1]; what is not finite counts as black.
    """
    from skimage.metrics import structural_similarity

    picture = np.nan_to_num(picture, nan=0.0).clip(0, 1)
    window = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    ssim = structural_similarity(picture, photograph, channel_axis=-1, data_range=1, **window)
    error = float(np.mean((picture - photograph) ** 2, dtype=np.float64))
    return {"psnr": psnr_of(error), "ssim": float(ssim)}


@method(reads=("folder", "with_water"), may_use=("skimage",))
@dataclass(frozen=True)
class Precomputed(RestoredElsewhere):
    """Read images that were restored elsewhere, one for each view, from a folder by the view's name.

    A view without an image is skipped. Time and memory are unknown. A file a.json beside a.png may hold the water. That
    is B, and beta and gamma if known, three numbers each, and `encoding` if it explains other intensities than the
    image's.
    """

    folder: Path
    """Folder of the restored images: png, jpg, tif, bmp, webp, npy, npz; in sub-folders like the views, or not."""

    pattern: str = "{stem}"
    """Name of a view's image: {stem} is the view's file name without suffix, {name} with it, {parent} its folder.
    Examples: 'restored_{stem}', '{stem}.npz', '{parent}/out/{stem}'."""

    with_water: Path | None = None
    """Folder of the same method's pictures with water, for new_view_psnr and new_view_ssim; in it or above it lies
    rendering.json, which says what training did not see: see docs/doors.md. none: there are no such pictures."""

    def __post_init__(self) -> None:
        check_pattern(self.pattern, "method.pattern")
        check_folder(self.folder, "give the folder that holds the restored images")
        if self.with_water:
            check_folder(self.with_water, "give the folder that holds the pictures with water")
            if self.with_water.resolve() == self.folder.resolve():
                remedy = "give pictures with water in with_water, and those without in folder"
                raise InputError(
                    "is method.folder as well",
                    f"method.with_water={self.with_water}",
                    remedy,
                )
            read_rendering(self.with_water)

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the image found for the view, in the view's encoding.

        info: "file", "resized_from" (width, height) if it was resized, and with `with_water` "new_view": PSNR and SSIM
        of the picture with water, or why there are none.
        Raises NotApplicableError when there is none, InputError when several fit or it cannot be read.
        """
        path = self._images.find(view.name, [v.name for v in scene.views])
        restored = self.read(path, view, next(source_files(view), None))
        _say_if_of_other_view(path, restored.image, scene, view)
        file = path.relative_to(self.folder).as_posix()
        new_view = {"new_view": self._new_view(scene, view)} if self.with_water else {}
        if getattr(view.pixels, "profile", None):  # a file that says nothing is in sRGB
            restored = replace(restored, info={PROFILE: "sRGB", **restored.info})
        unknown = {"seconds": nan, "peak_mb": nan, "device": "unknown"}
        return replace(restored, info={"file": file, **restored.info, **new_view, **unknown})

    def _new_view(self, scene: Scene, view: View) -> dict[str, Any]:
        """How near the picture with water is to the photograph; or what failed, or why the view is skipped."""
        path, held_out, reader = self._rendering
        try:
            if view.name not in held_out_views(path, held_out, [v.name for v in scene.views]):
                return {"skipped": f"{path}: does not hold the view out, so training saw it"}
            picture = reader.restore(scene, view)
        except NotApplicableError as fault:
            return {"skipped": str(fault)}
        except InputError as fault:  # the image without water is scored all the same
            return {"failed": str(fault)}
        return similarity(picture.image, view_in_srgb(view).rgb)

    @functools.cached_property
    def _rendering(self) -> tuple[Path, list[str] | int, "Precomputed"]:
        """The file that tells of the pictures with water, the views it holds out, and what reads these pictures."""
        folder = self.with_water
        assert folder is not None
        path, held_out, encoding = read_rendering(folder)
        reader = replace(
            self, folder=folder, with_water=None, encoding=encoding, holes="alpha", resize=False
        )
        return path, held_out, reader

    @functools.cached_property
    def _images(self) -> ImageFolder:
        if others := other_photographs(self.folder):
            fault = (
                f"{len(others)} pictures are in formats that are not read, as {others[0].name}"
            )
            image_files.say_once_a_folder(self.folder / "_", "formats", f"{fault}; {EXPORT}")
        return ImageFolder(self.folder, self.pattern)
