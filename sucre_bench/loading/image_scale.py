"""The option `image_scale` of datasets."""

from dataclasses import dataclass
from typing import Any

from sucre_bench.errors import check_number


@dataclass(frozen=True, kw_only=True)
class ImageScaleOption:
    """The option of datasets that can shrink their images. Raises InputError if it is out of range."""

    image_scale: float = 1.0
    """Shrink images by this factor, above 0 up to 1; with them depth maps, references, cameras and chart corners."""

    def __post_init__(self: Any) -> None:
        check_number(f"{type(self).__plugin__.name}.image_scale", self.image_scale, "(0, 1]")
