"""What `restore` makes of real dives whose true colours nobody knows: nothing that the eye would refuse.

The long form, with more sets and measures, is benchmarks/real_dives.py.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from support.places import published

import sucre_bench as sb
from sucre_bench.imaging.cielab import to_lab
from sucre_bench.imaging.visible_faults import faults_of_dive, look_at
from sucre_bench.programs.prepare import Options
from sucre_bench.programs.prepare.pipeline import prepare
from sucre_bench.programs.restore.pipeline import FOR_A_DIVE

OPTIONS = {
    name: {"true": True, "false": False}.get(value, value) for name, value in FOR_A_DIVE.items()
}
SIZE_PX = 640  # photographs are shrunk to this longest side; at 480 `prepare` places only 3 of the 12 of the pool

# The first photographs of a dive: `prepare` tries twice, in vain, to place the last two of the pool.
PHOTOGRAPHS = 6


def scene_of(folder: str, out: Path, photographs: int = PHOTOGRAPHS) -> sb.Scene:
    """A set with depth as it is published, or photographs alone with the depth that `prepare` makes."""
    root, scale = published(folder), 0.35
    if not (root / "depths").is_dir():
        (out / "in").mkdir()
        for file in sorted(root.iterdir())[:photographs]:
            shutil.copy(file, out / "in")
        prepare(out / "in", out / "dive", Options(max_size=SIZE_PX, depth_size=SIZE_PX // 2))
        root, scale = out / "dive", 1.0
    return sb.load_scene("colmap", root=root, image_scale=scale)


@pytest.mark.parametrize(
    ("folder", "names", "is_tiled"),
    [
        ("subvo_pool", ["01_19", "01_35"], True),
        ("subvo_pool/images", ["00_21", "01_11"], True),
        ("seabed_surveys/test1", ["2", "5"], False),
    ],
)
def test_no_picture_of_a_real_dive_is_ruined(
    tmp_path: Path, folder: str, names: list[str], is_tiled: bool
) -> None:
    scene = scene_of(folder, tmp_path)
    views = [view for view in scene.views if any(name in view.name for name in names)]
    assert len(views) == len(names)
    looks = []
    for view in views:
        restored = sb.restore("sucre_plus", scene, view, **OPTIONS)
        colours = restored.image[np.isfinite(restored.image).all(axis=-1)]
        below = (colours < 0).mean(axis=0)
        assert below.max() < 0.05
        looks.append(look_at(restored.shown, view.rgb, view.distance, float(below.max())))
        if is_tiled:
            _, b = tile_ab(restored.shown, view)
            assert b < -5, "the tiles of the pool are blue"
    assert faults_of_dive(looks) == [() for _ in looks]


def test_kelp_in_water_that_few_views_do_not_tell_stays_as_photographed(tmp_path: Path) -> None:
    # The paper's steps end near their start there, and that water turns green kelp grey.
    scene = scene_of("seabed_surveys/test4", tmp_path, photographs=4)
    restored = sb.restore("sucre_plus", scene, scene.views[2], **OPTIONS)
    assert restored.info["solver"] == "none"


def tile_ab(picture: np.ndarray, view: sb.View) -> tuple[float, float]:
    """The median a* and b* of the darker half of the ground, which is tiles; grout is brighter."""
    ground = np.isfinite(picture).all(axis=-1) & (view.distance > 0)
    light = to_lab(view.rgb)[..., 0]
    a, b = np.median(
        to_lab(np.nan_to_num(picture))[ground & (light < np.median(light[ground]))], axis=0
    )[1:]
    return float(a), float(b)
