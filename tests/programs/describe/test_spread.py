"""Before any work it is said whether the distances can measure the water."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.colmap_folder import write_dive
from support.command_line import Done
from support.made_ground import WATERS, make_ground

from sucre_bench.programs.describe.facts import Spread, spread_of

Bench = Callable[..., Done]


def spread(*heights_m: float) -> Spread:
    found = spread_of(make_ground(WATERS["coast"], heights_m=heights_m, width=60, height=45).views)
    assert found
    return found


@pytest.mark.parametrize(("heights_m", "ratio"), [((3, 3, 3), 1.0), ((3, 3.6, 3), 1.2), ((2, 3, 4), 2.0)])
def test_the_ratio_is_that_of_the_heights(heights_m: tuple[float, ...], ratio: float) -> None:
    assert spread(*heights_m).ratio == pytest.approx(ratio, rel=0.1)


def test_one_height_over_flat_ground_cannot_measure_the_water() -> None:
    assert "cannot be measured" in spread(3, 3, 3).sentence()
    assert "dive_gray_world" in spread(3, 3, 3).sentence()
    assert "can measure" in spread(2, 3, 4).sentence()


def test_views_apart_and_a_single_view() -> None:
    views = make_ground(WATERS["coast"], heights_m=(2, 4), width=60, height=45).views
    away = np.array(views[1].cam_from_world)
    away[0, 3] += 50
    apart = spread_of([views[0], replace(views[1], cam_from_world=away)])
    assert apart
    assert "No two views" in apart.sentence()
    assert spread_of(views[:1]) is None


def test_describe_and_run_say_it_first_and_a_prepared_scene_needs_no_prepare(tmp_path: Path, bench: Bench) -> None:
    dive = write_dive(tmp_path / "dive")
    (dive / "prepare.json").write_text(json.dumps({"scale": {"is_metric": True, "note": "given"}}))
    for depth in (dive / "depths").iterdir():
        depth.write_bytes((depth.parent / "depth_a.png").read_bytes())
    done = bench("describe", "./dive", "--no-sheet")
    assert "measure" in done.stdout
    assert "sucre-bench prepare" not in done.stdout
    words = ("dataset=./dive", "report=false", "tracking.uri=off", "workers=0", "metrics=[coverage]")
    of_several_views = bench("run", *words, "method=stitching", "out=a")
    assert "the water" in of_several_views.stderr
    assert "the water" not in bench("run", *words, "method=gray_world", "out=b").stderr
