"""Images that another program has restored already: renderings of a radiance field, results of published code."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from math import nan
from pathlib import Path

from sucre_bench import InputError, Restoration, Scene, View, method
from sucre_bench.methods.doors.pattern import ImageFolder, check_pattern
from sucre_bench.methods.doors.picture import FileEncoding, Holes, Reading, water_beside

__all__ = ["Precomputed"]


@method(reads=("folder",))
@dataclass(frozen=True)
class Precomputed:
    """Images restored elsewhere, one a view, found in a folder by the view's name.

    A view that has none is skipped. What restoring took is not known. A file a.json beside a.png may hold the water:
    B, and beta and gamma if known, three numbers each, and the encoding of the intensities that it explains, if not the
    images' own.
    """

    folder: Path
    """Folder with the restored images: png, jpg, tif, bmp, webp, npy, npz; in sub-folders as the views are, or not."""

    pattern: str = "{stem}"
    """What the image of a view is called: {stem} is the view's file name without suffix, {name} with it, {parent} its
    folder; 'restored_{stem}', '{stem}.npz', '{parent}/out/{stem}'."""

    encoding: FileEncoding = "view"
    """Of the files: gamma (sRGB), linear, or as the view's own image is."""

    holes: Holes = "alpha"
    """Which pixels have no colour: alpha, those wholly transparent; black, those that are exactly black, too; none,
    neither. NaN and infinity are holes in any case."""

    resize: bool = False
    """Bring images of another size to the view's, by area or linearly; otherwise they are an error."""

    def __post_init__(self) -> None:
        check_pattern(self.pattern, "precomputed.pattern")
        if not self.folder.is_dir():
            raise InputError(f"{self.folder}: no such folder; give the one that holds the restored images")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the image found for the view, in the view's encoding.

        info: "file", and "resized_from" (width, height) where it was.
        Raises NotApplicableError where there is none, InputError where it is not clear which one, or it cannot be read.
        """
        path = self._images.find(view.name, [v.name for v in scene.views])
        image, done = Reading(self.encoding, self.holes, self.resize).image(path, view)
        file = path.relative_to(self.folder).as_posix()
        info = {"file": file, **done, "seconds": nan, "peak_mb": nan, "device": "unknown"}
        return Restoration(image, water_beside(path, self.encoding, view), info=info)

    @functools.cached_property
    def _images(self) -> ImageFolder:
        return ImageFolder(self.folder, self.pattern)
