"""Methods against the pictures that their authors, or the makers of data sets, published of them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from published import psnr_db, published, read, restored

from sucre_bench.methods.fusion import Fusion2012

ANCUTI = ["Ancuti1.png", "Ancuti3.png", "Im1.jpg"]


@pytest.mark.parametrize("name", ANCUTI)
def test_fusion_2012_gives_what_its_authors_show(name: str):
    folder = published("fusion_published")
    photograph = read(folder / name)
    theirs = read(folder / name.replace(".", "_RecoveredAncuti."))
    height, width = photograph.shape[:2]
    if theirs.shape != photograph.shape:  # their Im1 is four columns narrower
        theirs = cv2.resize(theirs, (width, height), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    ours = restored(Fusion2012(), photograph).image
    assert psnr_db(ours, theirs) > max(21, psnr_db(photograph, theirs))


def test_fusion_2012_stretched_gives_the_fusion_column_of_u45():
    folder = published("u45_published")
    names = sorted(file.name for file in (folder / "FE").iterdir())
    levels = [
        psnr_db(restored(Fusion2012(balance="stretch"), read(folder / "Raws" / name)).image, read(folder / "FE" / name))
        for name in names
    ]
    assert np.mean(levels) > 29
    assert min(levels) > 26
