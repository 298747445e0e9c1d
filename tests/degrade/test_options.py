"""The options of a degradation: labels, hashes, runs and refusals."""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from support.made_scene import NINE, many, of, photo
from support.messages import refused

from sucre_bench import Camera, Scene, View, plugins
from sucre_bench.arrays import Array
from sucre_bench.degrade import degraded
from sucre_bench.engine import preflight
from sucre_bench.engine.hydra_run import run_words as run_jobs
from sucre_bench.engine.run import Outcome
from sucre_bench.jobs import compose_jobs
from sucre_bench.scene import Plane


def test_data_are_equal_exactly_where_their_hashes_are():
    scene = many()
    options: list[dict[str, object]] = [
        {}, {"noise": 0.1}, {"noise": 0.2}, {"noise": 0.1, "seed": 1}, {"bits": 8}, {"jpeg_quality": 8}, {"blur_px": 1},
        {"scale": 0.5}, {"depth_noise": 0.1}, {"depth_noise": 0.1, "depth_noise_px": 2.0}, {"depth_holes": 0.1},
        {"depth_holes": 0.1, "depth_hole_px": 2.0}, {"pose_noise_m": 0.1}, {"pose_noise_deg": 0.1}, {"add_water": NINE},
        {"within": 2, "target": "v4.png"}, {"within": 2, "target": "v3.png"}, {"keep": 2, "target": "v4.png"},
    ]  # fmt: skip
    ids = [degraded(scene, **one).data_id for one in options]
    assert len(set(ids)) == len(ids)
    assert ids[0] == scene.data_id
    same = [
        {"bits": 8, "seed": 3},
        {"bits": 8, "depth_hole_px": 4.0},
        {"bits": 8, "target": "v4.png", "within": 99},
    ]
    assert {degraded(scene, **one).data_id for one in same} == {ids[4]}
    assert degraded(replace(scene, data_id="other"), bits=8).data_id != ids[4]
    assert degraded(replace(scene, data_id=""), bits=8).data_id == ""


METHOD = '''
from dataclasses import dataclass
from pathlib import Path
from sucre_bench import Restoration, method

@method()
@dataclass(frozen=True)
class Diary:
    """Notes which views it is given, and how worn the target is."""

    log: Path
    """Where."""

    def restore(self, scene, view):
        with self.log.open("a") as file:
            file.write(f"{view.name}:{'+'.join(v.name for v in scene)}:{len(set(view.rgb[..., 0].ravel()))}\\n")
        return Restoration(view.rgb * 1.0)
'''


@pytest.fixture
def run(tmp_path: Path, toys: str):
    (tmp_path / "diary.py").write_text(METHOD)
    plugins.load_file(tmp_path / "diary.py")
    base = [
        "dataset=toy",
        "method=diary",
        f"method.log={tmp_path / 'log'}",
        "metrics=[psnr]",
        "report=false",
    ]

    def run(*overrides: str) -> tuple[Outcome, list[str]]:
        before = (
            len((tmp_path / "log").read_text().split()) if (tmp_path / "log").exists() else 0
        )
        outcome = run_jobs(
            [*base, "tracking.uri=off", f"out={tmp_path / 'out'}", *overrides], multirun=True
        )
        return outcome, (tmp_path / "log").read_text().split()[before:]

    return run


def test_a_sweep_over_degradations_keeps_them_apart_and_goes_on_where_it_stopped(
    run, tmp_path: Path
):
    swept = ("degrade.bits=2,null", "degrade.within=1")
    first, told = run(*swept)
    assert (first.ok, first.failed) == (6, ())
    seen = {
        "v0.png": "v0.png+v1.png",
        "v1.png": "v0.png+v1.png+v2.png",
        "v2.png": "v1.png+v2.png",
    }
    assert {tuple(line.split(":")[:2]) for line in told} == set(seen.items())
    assert sorted(int(line.split(":")[2]) <= 4 for line in told) == [False] * 3 + [True] * 3
    ids = first.rows.groupby("dataset")["data_id"].unique()
    assert set(ids.index) == {"toy,within=1", "toy,within=1,bits=2"}
    # one per scene, whichever the target, as comparisons want it
    assert all(len(one) == 1 for one in ids)
    assert len({one[0] for one in ids}) == 2
    assert (
        tmp_path / "out" / "restored" / "toy,within=1,bits=2" / "diary" / "v1.png"
    ).is_file()
    assert set(json.loads((tmp_path / "out" / "environment.json").read_text())["data"]) == set(
        ids.index
    )
    again, told = run(*swept)
    assert (again.cached, told) == (6, [])
    more, told = run("degrade.bits=2,3", "degrade.within=1", "views=[v1.png]")
    assert (more.ok, [line.split(":")[0] for line in told]) == (2, ["v1.png"])


def test_a_scene_that_lacks_what_is_to_be_degraded_is_refused_before_any_work(
    toys: str, tmp_path: Path
):
    base = [
        "dataset=two_scenes",
        "method=gain",
        "metrics=[redness]",
        f"out={tmp_path}",
        "tracking.uri=off",
    ]
    for option, lacking in (("depth_holes=0.1", "depth"), ("pose_noise_m=1", "poses")):
        with pytest.raises(preflight.ProblemsError, match=rf"'left' .*{lacking};"):
            run_jobs([*base, f"degrade.{option}"], multirun=False)


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("nois=1", {"degrade.nois", "'noise'"}),
        ("noise=-1", {"degrade.noise", "-1.0", "[0, 1]"}),
        ("noise=nan", {"degrade.noise", "nan", "[0, 1]"}),
        ("noise=lots", {"degrade.noise", "lots", "number"}),
        ("bits=0", {"degrade.bits", "0", "whole", "[1, 16]"}),
        ("jpeg_quality=101", {"degrade.jpeg_quality", "101", "whole", "[1, 100]"}),
        ("keep=0", {"degrade.keep", "0", "whole", "[1, inf)"}),
        ("scale=0", {"degrade.scale", "0.0", "[0.01, 1]"}),
        ("scale=null", {"degrade.scale"}),
        ("add_water=5", {"degrade.add_water", "nine"}),
        ("add_water=[1,2,3]", {"degrade.add_water", "nine"}),
        (
            "add_water=[.1,.1,.1,.2,.2,-1,.1,.1,.1]",
            {"degrade.add_water", "B", "[0, 1]", "beta"},
        ),
        ("add_water=[1.1,.1,.1,.2,.2,1,.1,.1,.1]", {"degrade.add_water", "B", "[0, 1]"}),
        ("add_water=absent.json", {"degrade.add_water", "nine"}),
    ],
)
def test_a_wrong_option_is_said_in_one_line(toys: str, override: str, named: set[str]):
    with refused(*named):
        compose_jobs.jobs(
            ["dataset=toy", "method=gain", "metrics=[psnr]", f"degrade.{override}"],
            multirun=False,
        )


RANDOM = {
    "noise": 0.1,
    "depth_noise": 0.1,
    "depth_holes": 0.2,
    "pose_noise_m": 0.1,
    "pose_noise_deg": 1.0,
}


def planes(view: View) -> list[Array]:
    assert view.cam_from_world is not None
    return [view.rgb, view.depth, view.cam_from_world]


def test_random_numbers_are_a_views_own_whatever_else_there_is():
    scene = many()
    part = replace(scene, views=[scene.views[5], scene.views[2]])
    one, of_part, reseeded = (
        planes(degraded(given, seed=seed, **RANDOM)["v2.png"])
        for given, seed in ((scene, 0), (part, 0), (scene, 1))
    )
    neighbour = planes(degraded(scene, **RANDOM)["v3.png"])
    for k in range(3):
        assert np.array_equal(one[k], of_part[k])
        assert not np.array_equal(one[k], reseeded[k])
        assert not np.array_equal(one[k], neighbour[k])
    # one kind of noise does not shift another's numbers
    assert np.array_equal(degraded(scene, noise=0.1)["v2.png"].rgb, one[0])


def test_all_at_once_is_one_after_the_other_in_the_order_of_light():
    scene = of(photo(), np.full((60, 80), 2.0), camera=Camera(np.diag([50.0, 50, 1]), 80, 60))
    at_once = degraded(
        scene, jpeg_quality=40, bits=5, noise=0.05, scale=0.5, blur_px=1.5, add_water=NINE
    )["a.png"]
    for step in (
        {"add_water": NINE}, {"blur_px": 1.5}, {"scale": 0.5}, {"noise": 0.05}, {"bits": 5}, {"jpeg_quality": 40},
    ):  # fmt: skip
        scene = degraded(scene, **step)
    assert np.array_equal(at_once.rgb, scene["a.png"].rgb)
    depths = [{"scale": 0.5}, {"depth_noise": 0.1}, {"depth_holes": 0.2}]
    scene = start = of(photo(), np.full((60, 80), 2.0))
    for step in depths:
        scene = degraded(scene, **step)
    both = degraded(start, depth_holes=0.2, depth_noise=0.1, scale=0.5)
    assert np.array_equal(both["a.png"].depth, scene["a.png"].depth)


@dataclass(frozen=True, eq=False)
class Counting:
    """Pixels that record which planes were asked for."""

    asked: list[Plane]

    def load(self, plane: Plane) -> Array | None:
        self.asked.append(plane)
        return (
            None if plane == "reference" else photo()[..., 0] if plane == "depth" else photo()
        )


def test_nothing_is_decoded_before_it_is_asked_for_and_planes_are_locked():
    asked: list[Plane] = []
    scene = Scene(
        "lazy", [View("a.png", Counting(asked))], frozenset({"depth"}), data_id="lazy"
    )
    made = degraded(scene, noise=0.1, scale=0.5, depth_noise=0.1, add_water=NINE)
    assert asked == []
    assert made["a.png"].depth.shape == (30, 40)
    assert asked == ["depth"]
    with pytest.raises(ValueError, match="read-only"):
        made["a.png"].rgb[:] = 0


def test_within_and_keep_choose_views_in_capture_order():
    scene = many()

    def names(**options: int) -> list[str]:
        return [view.name for view in degraded(scene, target="v4.png", **options)]

    assert names(within=2) == ["v2.png", "v3.png", "v4.png", "v5.png", "v6.png"]
    assert names(within=0) == names(keep=1) == ["v4.png"]
    assert [v.name for v in degraded(scene, target="v1.png", within=2)] == [
        "v0.png",
        "v1.png",
        "v2.png",
        "v3.png",
    ]
    drawn = [names(keep=count) for count in range(1, 10)]
    for count, chosen in enumerate(drawn, start=1):
        assert len(chosen) == count
        assert chosen == sorted(chosen)
        assert "v4.png" in chosen
    assert all(set(few) < set(more) for few, more in itertools.pairwise(drawn))
    assert len({tuple(names(keep=3, seed=seed)) for seed in range(20)}) > 5
    both = names(within=2, keep=3)
    assert len(both) == 3
    assert set(both) <= set(names(within=2))
    assert degraded(scene, target="v4.png", within=2)["v3.png"] is scene["v3.png"]
