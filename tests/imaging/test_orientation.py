"""Two pictures of one view are compared as they lie, whether a program turned its output by EXIF or not."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageOps

from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.imaging.orientation import lying_as, upright

pytestmark = pytest.mark.short


def scene(path: Path, orientation: int) -> None:
    picture = np.random.default_rng(1).integers(0, 256, (6, 9, 3)).astype(np.uint8)
    tags = Image.Exif()
    tags[274] = orientation
    Image.fromarray(picture).resize((90, 60), Image.Resampling.BICUBIC).save(path, exif=tags)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("program", ["turns", "does not turn", "keeps the tag"])
def test_the_output_of_any_program_lies_as_its_photograph(
    tmp_path: Path, orientation: int, program: str
) -> None:
    photograph, output = tmp_path / "in.png", tmp_path / "out.png"
    scene(photograph, orientation)
    with Image.open(photograph) as image:
        turned = np.asarray(ImageOps.exif_transpose(image)) / np.float32(255)
        Image.fromarray(
            np.asarray(ImageOps.exif_transpose(image) if program == "turns" else image)
        ).save(output)
    if program == "keeps the tag":
        scene(output, orientation)
    stored = read_rgb(photograph)
    assert np.array_equal(upright(stored, orientation), turned)
    assert np.array_equal(
        lying_as(read_rgb(output), output, lambda: stored, photograph), stored
    )
