"""What every plugin must keep to, whoever wrote it, on a small made scene and on the images nobody wants."""

from __future__ import annotations

import functools
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_networks import ARCHITECTURES, network_options

from sucre_bench import Arrays, Camera, NotApplicableError, Restoration, Scene, View, plugins, restore, score
from sucre_bench.options import options_of
from sucre_bench.plugins import Plugin, discover
from sucre_bench.scene import Water

HEAVY = {"torch", "jax", "open3d", "mlflow", "pycolmap", "colour", "pandas", "skimage", "cv2", "hydra", "scipy"}
HEAVY |= {"onnx", "onnxruntime", "numba", "psutil"}


def built_in(kind: plugins.Kind) -> list[Plugin]:
    found = [p for p in discover(kind).values() if isinstance(p, Plugin)]
    return [p for p in found if p.cls.__module__.startswith("sucre_bench.")]


def named(plugin: Plugin) -> str:
    return plugin.name


def scene_of(rgb: np.ndarray, depth: np.ndarray | None = None) -> Scene:
    """Two views of a flat wall 3 m and 2 m away, with the same picture."""
    height, width = rgb.shape[:2]
    K = np.array([[width, 0, width / 2], [0, width, height / 2], [0, 0, 1.0]])
    camera = Camera(K, width, height)
    views = []
    for name, distance in (("far.png", 3.0), ("near.png", 2.0)):
        pose = np.eye(4)
        pose[2, 3] = distance - 3
        own = np.full((height, width), distance, np.float32) if depth is None else depth
        views.append(View(name, Arrays(rgb, own, rgb), camera, pose))
    has = frozenset({"depth", "poses", "reference", "truth"})
    return Scene("wall", views, has, Water(np.full(3, 0.5), np.full(3, 0.1), np.full(3, 0.1)))


RNG = np.random.default_rng(0)
NOISE = RNG.random((48, 64, 3), dtype=np.float32)
HARD = {
    "noise": NOISE,
    "black": np.zeros_like(NOISE),
    "white": np.ones_like(NOISE),
    "no red": NOISE * np.float32([0, 1, 1]),
    "tiny": NOISE[:4, :6],
    "gray": np.full_like(NOISE, 0.5),
}
ORDINARY_WORDS = {"command", "photos"}  # as plugins' names; the engine may use them for something else
QUICK: dict[str, dict[str, Any]] = {"sucre_paper": {"steps": 3}, "command": {"run": "cp {input} {output}"}}


def options_for(plugin: Plugin, scene: Scene, folder: Path) -> dict[str, Any]:
    """Options that make a method quick, and those that must be given: a folder of results, a program, weights."""
    if plugin.name == "precomputed":
        for view in scene:
            np.save(folder / f"{Path(view.name).stem}.npy", view.rgb)
        return {"folder": folder}
    if plugin.name in (*ARCHITECTURES, "onnx"):
        return _network(plugin.name, folder.parent)  # the folder of all tests of this process
    return QUICK.get(plugin.name, {})


_network = functools.cache(network_options)  # up to 45 MB to write


@pytest.mark.parametrize("plugin", built_in("method"), ids=named)
@pytest.mark.parametrize("kind", HARD)
def test_a_method_gives_every_valid_pixel_a_finite_colour(plugin: Plugin, kind: str, tmp_path: Path):
    scene = scene_of(HARD[kind])
    view = scene["far.png"]
    result = restore(plugin.name, scene, view, **options_for(plugin, scene, tmp_path))
    assert result.image.shape == view.rgb.shape
    assert np.isfinite(result.image[view.valid]).all()


@pytest.mark.parametrize("plugin", built_in("method"), ids=named)
def test_a_method_is_deterministic_and_changes_neither_input_nor_global_randomness(plugin: Plugin, tmp_path: Path):
    before = NOISE.copy()
    np.random.seed(3)
    state = np.random.get_state()[1].copy()
    scenes = scene_of(NOISE), scene_of(NOISE)
    options = options_for(plugin, scenes[0], tmp_path)
    first, second = (restore(plugin.name, scene, scene["far.png"], **options) for scene in scenes)
    np.testing.assert_array_equal(first.image, second.image)
    np.testing.assert_array_equal(before, NOISE)
    np.testing.assert_array_equal(state, np.random.get_state()[1])


@pytest.mark.parametrize("plugin", built_in("method"), ids=named)
def test_a_method_declares_what_it_needs(plugin: Plugin, tmp_path: Path):
    """It must run on a scene that has no more than it says: no depth, no poses, unless it asks for them."""
    scene = scene_of(NOISE)
    poor = [
        replace(
            view,
            pixels=Arrays(NOISE, view.depth if "depth" in plugin.needs else None),
            camera=view.camera if "poses" in plugin.needs else None,
            cam_from_world=view.cam_from_world if "poses" in plugin.needs else None,
        )
        for view in scene
    ]
    least = Scene("poor", poor, plugin.needs)
    result = restore(plugin.name, least, poor[0], **options_for(plugin, least, tmp_path))
    assert result.valid.any()


@pytest.mark.parametrize("plugin", [p for p in built_in("method") if "depth" in p.needs], ids=named)
def test_a_pixel_without_depth_gets_no_invented_colour(plugin: Plugin, tmp_path: Path):
    depth = np.full(NOISE.shape[:2], 2.5, np.float32)
    depth[:, :20] = 0
    scene = scene_of(NOISE, depth)
    result = restore(plugin.name, scene, scene["far.png"], **options_for(plugin, scene, tmp_path))
    assert np.isnan(result.image[:, :20]).all()


@pytest.mark.parametrize("plugin", [p for p in built_in("method") if "depth" in p.needs], ids=named)
def test_a_view_without_any_depth_is_skipped_with_that_reason(plugin: Plugin, tmp_path: Path):
    scene = scene_of(NOISE, np.zeros(NOISE.shape[:2], np.float32))
    with pytest.raises(NotApplicableError, match=r"^far\.png: no pixel has depth"):
        restore(plugin.name, scene, scene["far.png"], **options_for(plugin, scene, tmp_path))


@pytest.mark.parametrize("plugin", [p for p in built_in("method") if "depth" not in p.needs], ids=named)
def test_a_method_without_need_of_depth_colours_the_whole_image(plugin: Plugin, tmp_path: Path):
    """Depth that a view happens to have is no reason for holes in what does not need it."""
    depth = np.full(NOISE.shape[:2], 2.5, np.float32)
    depth[:, :20] = 0
    scene = scene_of(NOISE, depth)
    assert restore(plugin.name, scene, scene["far.png"], **options_for(plugin, scene, tmp_path)).valid.all()


@pytest.mark.parametrize("plugin", built_in("metric"), ids=named)
@pytest.mark.parametrize("kind", HARD)
def test_a_metric_stays_in_its_range_and_says_what_it_measured(plugin: Plugin, kind: str):
    scene = scene_of(HARD[kind])
    view = scene["far.png"]
    image = np.where(RNG.random((*view.rgb.shape[:2], 1)) < 0.3, np.nan, view.rgb)
    rows = score(Restoration(image, scene.water, info={"true_water": scene.water}), view, [f"{plugin.name}:all"])
    rows = rows[rows["metric"] == plugin.name]
    assert set(rows["variant"]) == set(plugin.variants)
    assert set(rows["status"]) <= {"ok", "skipped"}, rows["reason"].tolist()
    low, high = plugin.range
    values = rows.loc[rows["status"] == "ok", "value"].dropna()
    assert values.between(low, high).all()
    assert rows["coverage"].between(0, 1).all()


@pytest.mark.parametrize("kind", plugins.KINDS)
def test_every_plugin_is_described(kind: plugins.Kind):
    for plugin in built_in(kind):
        assert plugin.summary.endswith("."), f"{plugin.name}: the docstring's first paragraph is its description"
        undocumented = [o.name for o in options_of(plugin.cls) if not o.help]
        assert not undocumented, f"{plugin.name}: a string below each field says what it is: {undocumented}"


def test_importing_the_plugins_imports_nothing_heavy():
    code = (
        "import sys\nfrom sucre_bench import plugins\n"
        "[plugins.discover(k) for k in plugins.KINDS]\n"
        "print(*{m.split('.')[0] for m in sys.modules})"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert not set(said.split()) & HEAVY


def test_the_engine_names_no_plugin():
    """The engine must run any plugin alike: it may not know one by name."""
    engine = Path(plugins.__file__).parent
    names = [p.name for kind in ("method", "dataset") for p in built_in(kind) if p.name not in ORDINARY_WORDS]
    for path in (*engine.glob("*.py"), *engine.glob("multiview/*.py"), *engine.glob("report/*")):
        if path.name in ("cli.py", "__init__.py", "colour.py") or path.is_dir():
            continue  # their help shows examples; gray_world is also a normalisation
        text = path.read_text(encoding="utf-8")
        found = [name for name in names if f'"{name}"' in text or f"'{name}'" in text]
        assert not found, f"{path.name} names {found}"
