"""Methods against the pictures that their authors, or the makers of data sets, published of them."""

import cv2
import numpy as np
import pytest
from support.forward_model import restored
from support.places import psnr_db, published, read

from sucre_bench import Arrays, Restoration, View, score
from sucre_bench.methods.fusion import Fusion2012
from sucre_bench.methods.ibla import Ibla
from sucre_bench.methods.networks.onnx import Onnx
from sucre_bench.methods.udcp import Udcp
from sucre_bench.methods.ulap import Ulap

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


@pytest.mark.parametrize(
    ("method", "column", "typical_db", "least_db"),
    [
        (Fusion2012(balance="stretch"), "FE", 29, 26),
        # 27 and more but on one photograph, whose veiling light is another
        (
            Ibla(),
            "UIBLA",
            36,
            14,
        ),
        (Udcp(), "UDCP", 21, 14),
    ],
    ids=["fusion_2012", "ibla", "udcp"],
)
def test_a_column_of_u45_comes_back(
    method: object, column: str, typical_db: float, least_db: float
):
    folder = published("u45_published")
    names = sorted(file.name for file in (folder / column).iterdir())
    level = [
        psnr_db(
            restored(method, read(folder / "Raws" / name)).image, read(folder / column / name)
        )
        for name in names
    ]
    assert np.median(level) > typical_db
    assert min(level) > least_db


def test_ulap_does_not_flood_a_reef_with_red():
    """Of this photograph a published program makes a mean red of 133 of 255; without the stretch of depth it is 198."""
    photograph = read(published("seathru_d5_charts") / "images" / "LFT_3411.png")
    small = cv2.resize(photograph, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    assert 255 * restored(Ulap(), small).image[..., 0].clip(0, 1).mean() < 170


def test_physicalnn_raises_the_no_reference_scores_of_u45():
    """The recipe of docs/doors.md with the authors' weights; the figures are those it names."""
    weights, folder = (
        published("published_weights") / "physicalnn" / "physicalnn.onnx",
        published("u45_published"),
    )
    network = Onnx(model=weights, tile=None)
    before, after = [], []
    for file in sorted((folder / "Raws").iterdir()):
        view = View(file.name, Arrays(read(file)))
        before.append(uiqm(Restoration(view.rgb), view))
        after.append(uiqm(restored(network, view.rgb), view))
    assert np.mean(before) == pytest.approx(2.82, abs=0.01)
    assert np.mean(after) == pytest.approx(3.31, abs=0.02)


def uiqm(restoration: Restoration, view: View) -> float:
    rows = score(restoration, view, metrics=["uiqm:panetta2016"])
    return float(rows.loc[rows["variant"] == "panetta2016", "value"].item())
