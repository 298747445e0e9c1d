"""U45: forty-five underwater photographs with colour casts, low contrast or haze, without references.

    upload/U45/U45/1.png    256x256; or any folder that holds the images

Source: Li, Li & Wang, A fusion adversarial underwater image enhancement network with a public test dataset, 2019.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from sucre_bench.errors import InputError
from sucre_bench.loading.find_folders import existing, folders_below
from sucre_bench.loading.image_folder import image_folder_scene, image_names
from sucre_bench.loading.view_files import ImageScaleOption
from sucre_bench.plugins.decorators import dataset
from sucre_bench.scene import Scene


@dataset(
    requires=("cv2", "PIL", "tifffile"),
    cites="Li, Li & Wang 2019, arXiv:1906.06819",
    licence="as its download page says",
    source="https://github.com/IPNUISTlegal/underwater-test-dataset-U45- (45 images of 256x256)",
    signs=("U45", "*/U45"),
)
@dataclass(frozen=True)
class U45(ImageScaleOption):
    """The U45 test images, one scene: single images without depth or reference."""

    root: Path
    """The download, or the folder of the images itself."""

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene. Reads headers and samples of files. InputError when there is no image."""
        root = existing(self.root)
        named = folders_below(root, lambda place, _: place.name.lower() == "u45" and bool(image_names(place)))
        folder = next(named, root)  # the download holds results of other methods beside it
        if not image_names(folder):
            raise InputError(f"{root}: holds no image, nor a folder U45 of images; give the folder of 1.png to 45.png")
        yield image_folder_scene("U45", folder, image_scale=self.image_scale)
