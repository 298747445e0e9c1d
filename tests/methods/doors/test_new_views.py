"""Rendering methods: new views with water and images without, scored apart, on renderings of a made scene."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.messages import names, refused

from sucre_bench import InputError, load_scenes
from sucre_bench.imaging.encoding import srgb_decode, to_8bit, to_levels
from sucre_bench.imaging.image_files import write_png
from sucre_bench.methods.doors import Precomputed

SIZE = ("dataset.width=96", "dataset.height=72", "dataset.views=4", "dataset.noise=0.02")
TOLD = {"held_out": 2, "encoding": "linear", "white_balance": "none"}


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("demo")


@pytest.fixture
def rendered(tmp_path: Path, cache: Path) -> Path:
    """What a perfect method would render of the noisy scene: without water its truth, with water the noiseless views.

    The pictures with water are linear, in 16 bits.
    """
    (scene,) = load_scenes("demo", width=96, height=72, views=4, noise=0.0, root=cache)
    for view in scene:
        write_png(
            tmp_path / "renders" / "clear" / view.name, to_8bit(view.reference)[..., ::-1]
        )
        write_png(
            tmp_path / "renders" / "water" / view.name,
            to_levels(srgb_decode(view.rgb), 16)[..., ::-1],
        )
    (tmp_path / "renders" / "rendering.json").write_text(json.dumps(TOLD))
    return tmp_path


def scored(bench, folder: Path, cache: Path, *more: str) -> tuple[int, pd.DataFrame]:
    words = ("dataset=demo", f"dataset.root={cache}", *SIZE, "method=precomputed", "method.folder=renders/clear",
             "method.with_water=renders/water", "metrics=[psnr,new_view_psnr,new_view_ssim]", "out=out",
             "tracking.uri=off", "report=false", "workers=0", *more)  # fmt: skip
    done = bench("run", *words)
    return done.returncode, pd.read_parquet(folder / "out" / "scores.parquet").set_index(
        ["metric", "view"]
    )


def test_a_perfect_rendering_has_the_noise_as_its_error_with_water_and_none_without(
    bench, rendered, cache
):
    code, rows = scored(bench, rendered, cache)
    assert code == 0
    held_out = ["view_000.png", "view_002.png"]
    new = rows.loc["new_view_psnr"]
    assert list(new.index[new["status"] == "ok"]) == held_out
    # Noise of .02 has 34 dB; a little less of it is left where it was clipped.
    assert new.loc[held_out, "value"].between(33.7, 35).all()
    assert rows.loc["new_view_ssim"].loc[held_out, "value"].between(0.6, 0.99).all()
    trained = new.drop(held_out)
    assert set(trained["status"]) == {"skipped"}
    assert "renders/rendering.json" in names(trained["reason"].iloc[0])
    assert (rows.loc["psnr", "value"] > 50).all()  # all views, against the scene without water


def test_pictures_with_water_of_another_size_fail_without_harm_to_the_images(
    bench, rendered, cache
):
    small = np.zeros((36, 48, 3), np.uint8)
    write_png(rendered / "renders" / "water" / "view_000.png", small)
    code, rows = scored(bench, rendered, cache, "method.resize=true")
    assert code == 1
    row = rows.loc[("new_view_psnr", "view_000.png")]
    assert row["status"] == "failed"
    assert {"48x36", "96x72"} <= names(row["reason"])
    assert rows.loc[("new_view_psnr", "view_002.png"), "status"] == "ok"
    assert set(rows.loc["psnr", "status"]) == {"ok"}


@pytest.mark.parametrize(
    ("told", "named"),
    [
        (None, {"rendering.json", "encoding", "white_balance"}),
        ({"encoding": "gamma", "white_balance": "none"}, {"rendering.json", "'held_out'"}),
        ({**TOLD, "held_out": []}, {"held_out", "[]"}),
        ({**TOLD, "held_out": 1}, {"held_out", "1"}),
        ({**TOLD, "encoding": "sRGB"}, {"'sRGB'", "gamma", "linear"}),
        ({**TOLD, "white_balance": "gray world"}, {"white_balance", "none"}),
    ],
)
def test_pictures_that_do_not_say_how_they_were_rendered_are_refused(
    rendered: Path, told: dict | None, named: set[str]
):
    file = rendered / "renders" / "rendering.json"
    file.unlink() if told is None else file.write_text(json.dumps(told))
    with refused(*named):
        Precomputed(
            folder=rendered / "renders" / "clear", with_water=rendered / "renders" / "water"
        )


def test_pictures_without_water_are_no_pictures_with_it(rendered: Path):
    with pytest.raises(InputError, match="with_water"):
        Precomputed(
            folder=rendered / "renders" / "water", with_water=rendered / "renders" / "water"
        )


def test_a_held_out_view_that_the_scene_lacks_is_named(bench, rendered: Path, cache: Path):
    (rendered / "renders" / "rendering.json").write_text(
        json.dumps({**TOLD, "held_out": ["view_2.png"]})
    )
    code, rows = scored(bench, rendered, cache)
    assert code == 1
    assert {"view_2.png", "view_002.png"} <= names(rows.loc["new_view_psnr", "reason"].iloc[0])
