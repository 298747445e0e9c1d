"""The scale of a model, from a depth track, a seen length, or nothing."""

from pathlib import Path

import numpy as np
import pytest
from support.photographed_valley import HEIGHT, WIDTH, make_shots

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.programs.prepare.scale import Scale, find_scale, known_scale
from sucre_bench.programs.prepare.shots import Shot


def test_a_depth_track_gives_the_scale_where_cameras_leave_every_plane(tmp_path: Path):
    random = np.random.default_rng(0)
    places = random.uniform(-1, 1, (12, 3))
    down = np.array([0.6, 0.0, 0.8])
    depths = 7 + 1.7 * places @ down  # a unit is 1.7 m
    write_track(tmp_path / "track.csv", depths)
    found = find_scale(known_scale(depth_track=tmp_path / "track.csv"), make_shots(places), same_names(12), no_depth)
    assert found.metres_per_unit == pytest.approx(1.7, rel=1e-6)
    flat = places * [1, 1, 0.001]  # what the depths tell of the direction they do not leave in is noise
    write_track(tmp_path / "flat.csv", 7 + 1.7 * flat @ down)
    with pytest.raises(InputError, match=r"flat\.csv: .*cameras .*\d %"):
        find_scale(known_scale(depth_track=tmp_path / "flat.csv"), make_shots(flat), same_names(12), no_depth)


def write_track(path: Path, depths: Array) -> None:
    path.write_text("image,depth\n" + "".join(f"{i}.png,{depth:.6f}\n" for i, depth in enumerate(depths)))


def same_names(count: int) -> dict[str, str]:
    return {f"{i}.png": f"{i}.png" for i in range(count)}


def no_depth(shot: Shot) -> Array:
    raise AssertionError(shot.name)


def test_a_length_that_is_seen_gives_the_scale():
    shots = make_shots(np.zeros((1, 3)))
    # Half a unit of tangent, at a depth of 2 units: 1 unit long.
    known = known_scale(lengths=[("0.png", 100.0, 100.0, 100.0 + 145.0, 100.0, 0.25)])
    found = find_scale(known, shots, same_names(1), lambda _: np.full((HEIGHT, WIDTH), 2.0, np.float32))
    assert found.metres_per_unit == pytest.approx(0.25)
    assert found.is_metric


def test_without_a_known_length_the_scale_is_called_arbitrary_and_two_are_refused():
    shots = make_shots(np.array([[0.0, 0, 0], [1, 0, 0]]))
    found = find_scale({}, shots, same_names(2), no_depth)
    assert isinstance(found, Scale)
    assert not found.is_metric
    with pytest.raises(InputError, match=r"^scale: .*--scale, --distance, --length, --depth-track"):
        known_scale(factor=1, distances=[("0.png", "1.png", 1.0)])
    with pytest.raises(InputError, match=r"^--distance: 9\.png "):
        find_scale(known_scale(distances=[("0.png", "9.png", 1.0)]), shots, same_names(2), no_depth)
