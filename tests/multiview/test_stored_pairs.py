"""Observations on disk: the same as those in memory, made once, and anew when anything differs or is damaged."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.made_scene import Watched, make_scene

from sucre_bench import Scene, View
from sucre_bench.multiview import observations as mapped, stored_pairs as store
from sucre_bench.multiview.observations import Observations
from sucre_bench.multiview.observe import observe
from sucre_bench.multiview.stored_pairs import paired, sharing

FIELDS = ("pixels", "counts", "starts", "distance", "colour", "weight", "view", "ray")


def counted_scene() -> Scene:
    scene = make_scene()
    return replace(
        scene, views=[replace(v, pixels=Watched(v.pixels)) for v in scene], data_id="0123"
    )


def stored(scene: Scene, target: View, folder: Path, **options: object) -> Observations:
    """Pair while methods share a folder."""
    with sharing(folder, 1e9):
        return paired(scene, target, **options)


def n_loads(scene: Scene) -> int:
    return sum(len(view.pixels.loaded) for view in scene)


def assert_equal(one: Observations, other: Observations) -> None:
    assert (one.shape, one.views, one.unreadable) == (
        other.shape,
        other.views,
        other.unreadable,
    )
    for field in FIELDS:
        expected, found = getattr(one, field), getattr(other, field)
        assert (expected is None) == (found is None)
        if expected is not None:
            assert found.dtype == expected.dtype
            assert np.array_equal(found, expected)


@pytest.mark.parametrize(
    "options",
    [{}, {"encoding": "linear"}, {"with_view": True, "with_ray": True}],
    ids=str,
)
def test_what_is_kept_equals_what_memory_holds_and_is_reused_without_reading(
    tmp_path: Path, options: dict
) -> None:
    scene = counted_scene()
    in_memory = observe(scene["a.png"], scene.views, **options)
    first = stored(scene, scene["a.png"], tmp_path / "pairs", **options)
    assert_equal(in_memory, first)
    assert first.read_s > 0

    again = counted_scene()  # of equal data, as another process would find them
    reused = stored(again, again["a.png"], tmp_path / "pairs", **options)
    assert n_loads(again) == 0
    assert reused.read_s == 0
    assert_equal(in_memory, reused)


def test_methods_share_what_they_pair_while_there_is_room(tmp_path: Path) -> None:
    def n_read(most_bytes: float, **options: object) -> int:
        scene = counted_scene()
        with sharing(tmp_path, most_bytes):
            paired(scene, scene["a.png"], **options)
        return n_loads(scene)

    assert n_read(1e9) > 0
    assert n_read(1e9) == 0
    assert n_read(1e9, encoding="view", with_ray=False) == 0  # as it is by default
    assert n_read(1.0, encoding="linear") > 0  # the folder is full by now
    assert n_read(1e9, encoding="linear") > 0
    assert n_read(1e9, encoding="linear") == 0


def test_other_data_views_targets_options_or_source_are_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    scene = counted_scene()
    stored(scene, scene["a.png"], tmp_path)
    others = {
        "data": lambda s: stored(replace(s, data_id="4567"), s["a.png"], tmp_path),
        "views": lambda s: stored(replace(s, views=s.views[1:]), s["a.png"], tmp_path),
        "target": lambda s: stored(s, s["side.png"], tmp_path),
        "option": lambda s: stored(s, s["a.png"], tmp_path, encoding="linear"),
        "value": lambda s: stored(s, s["a.png"], tmp_path, encoding="linear", with_ray=True),
    }
    for make in others.values():
        fresh = counted_scene()
        make(fresh)
        assert n_loads(fresh) > 0
    monkeypatch.setattr(store, "engine_hash", lambda: "other source")
    fresh = counted_scene()
    stored(fresh, fresh["a.png"], tmp_path)
    assert n_loads(fresh) > 0
    assert len(list(tmp_path.glob("*/meta.json"))) == 1 + len(others) + 1


def saved(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], object]:
    """Return what changes a stored array."""
    return lambda entry: np.save(entry / f"{name}.npy", change(np.load(entry / f"{name}.npy")))


DAMAGE: dict[str, Callable[[Path], object]] = {
    "a truncated array": lambda entry: os.truncate(entry / "distance.npy", 200),
    "a missing array": lambda entry: (entry / "colour.npy").unlink(),
    "an array of another size": saved("distance", lambda _: np.zeros(3, np.float32)),
    "counts of zero": saved("counts", np.zeros_like),
    "starts that do not fit": saved(
        "starts", lambda starts: starts + 5 * (np.arange(len(starts)) == 1)
    ),
    "a pickle": lambda entry: np.save(
        entry / "colour.npy", np.array([print], dtype=object), allow_pickle=True
    ),
    "no meta.json": lambda entry: (entry / "meta.json").unlink(),
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_entry_is_made_anew(tmp_path: Path, damage: Callable[[Path], object]) -> None:
    scene = counted_scene()
    stored(scene, scene["a.png"], tmp_path)
    (meta,) = tmp_path.glob("*/meta.json")
    damage(meta.parent)
    fresh = counted_scene()
    assert_equal(observe(scene["a.png"], scene.views), stored(fresh, fresh["a.png"], tmp_path))
    assert n_loads(fresh) > 0
    assert_equal(observe(scene["a.png"], scene.views), stored(scene, scene["a.png"], tmp_path))


def test_what_a_killed_process_left_is_cleared_away(tmp_path: Path) -> None:
    scene = counted_scene()
    stored(scene, scene["a.png"], tmp_path)
    (meta,) = tmp_path.glob("*/meta.json")
    meta.parent.rename(f"{meta.parent}.part")
    stored(scene, scene["a.png"], tmp_path)
    assert meta.is_file()
    assert not list(tmp_path.glob("*.part"))


def test_two_at_once_pair_once_and_both_are_served(tmp_path: Path) -> None:
    scenes = [counted_scene() for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        made = list(pool.map(lambda scene: stored(scene, scene["a.png"], tmp_path), scenes))
    assert sum(n_loads(scene) > 0 for scene in scenes) == 1
    for one in made[1:]:
        assert_equal(made[0], one)


def test_a_folder_that_cannot_be_written_is_no_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = counted_scene()
    in_memory = observe(scene["a.png"], scene.views)
    (tmp_path / "file").touch()
    assert_equal(in_memory, stored(scene, scene["a.png"], tmp_path / "file"))

    def full(fd: int, start: int, size: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(mapped.os, "posix_fallocate", full)
    assert_equal(in_memory, stored(scene, scene["a.png"], tmp_path))
    assert not [path for path in tmp_path.iterdir() if path.is_dir()]
