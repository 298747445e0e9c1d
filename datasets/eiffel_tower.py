"""Eiffel Tower: a hydrothermal vent at 1,700 m, filmed by robots with lamps in 2015, 2016, 2018 and 2020.

    2015/images/20150412T...png     the photographs of a visit, as they were taken
    2015/sfm/                       COLMAP model of that visit, as text; distorted cameras
    global/sfm/                     COLMAP model of all visits in one frame
    2015/depths/                    optional, one's own: maps of the undistorted images, see `loading.depth_maps`

Conventions. Images are undistorted on the way. Lengths are metres: the models were fitted to the robots' navigation.
A name in the global model starts with its visit's year; its image is looked for in global/images/ and in that year's.
Source: Boittiaux et al., Eiffel Tower: a deep-sea underwater dataset for long-term visual localization, IJRR 2023.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal

from sucre_bench import InputError, Scene, dataset
from sucre_bench.imaging.image_files import PICTURE_READERS
from sucre_bench.loading.colmap_model import read_model, registered_scene
from sucre_bench.loading.find_folders import chosen, existing
from sucre_bench.loading.view_files import ImageScaleOption

_YEARS = ("2015", "2016", "2018", "2020")


@dataset(
    requires=PICTURE_READERS,
    has=("poses", "depth"),
    cites="Boittiaux, Dune, Ferrera, Arnaubec, Marxer, Matabos, Van Audenhaege & Hugel 2023, IJRR",
    licence="as its download page says",
    source="https://www.seanoe.org/data/00810/92226/ (18,082 images; an archive a year, one for global/)",
    proven="has read no released file yet: written from the authors' descriptions, tried on miniatures of them",
    signs=("sfm", "*/sfm"),
)
@dataclass(frozen=True)
class EiffelTower(ImageScaleOption):
    """The Eiffel Tower dives: one scene a visit, its views in order of name, undistorted on the way."""

    root: Path
    """The folder that holds 2015/ to 2020/ and global/, or one of these."""
    year: Literal["all", "2015", "2016", "2018", "2020", "global"] = "all"
    """Which visit. "all": every visit that exists, one scene each; "global": all visits in one scene and one frame."""
    depths: str = "depths"
    """Folder of depth maps of the undistorted images, beside sfm/; need not exist."""

    def scenes(self) -> Iterator[Scene]:
        """Yield a scene for each visit. Reads models, headers and samples of files, decodes nothing.

        Raises InputError when a visit's folder, its model or all of its images are missing.
        """
        root = existing(self.root)
        if (root / "sfm").is_dir():  # one visit was given
            if self.year not in ("all", root.name):
                raise InputError(
                    f"is one visit, not {self.year}",
                    root,
                    "give the folder above, or drop dataset.year",
                )
            places = [root]
        else:
            years = _YEARS if self.year == "all" else (self.year,)
            places = [
                root / year for year in years if self.year != "all" or (root / year).is_dir()
            ]
        if not places:
            raise InputError(
                f"{root}: holds no folder {', '.join(_YEARS)}; unpack the archive of a year there"
            )
        for place in places:
            depths = chosen(self, place, "depths", "folder")
            model = read_model(place / "sfm", place / "images", distorted=True)
            paths = {posed.name: place / "images" / posed.name for posed in model}
            for name, usual in paths.items():
                if not usual.is_file() and name[:4] in _YEARS:
                    images = place.parent / name[:4] / "images"
                    # a name may be a path: 2015/a.png, 2015/images/a.png
                    others = (
                        images / name,
                        place.parent / name,
                    )
                    there = (path for path in others if path.is_file())
                    paths[name] = next(there, images / PurePosixPath(name).name)
            yield registered_scene(place.name, model, paths, depths, self.image_scale)
