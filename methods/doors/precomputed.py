"""A method of images that exist already: renderings of a radiance field, results of published code."""

import functools
from dataclasses import dataclass
from math import nan
from pathlib import Path

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.errors import FileError, MissingFileError
from sucre_bench.methods.doors.pattern import ImageFolder, check_pattern
from sucre_bench.methods.doors.read_picture import FileEncoding, Holes, Reading, water_beside

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
