"""The bench from Python, beyond what the examples in docstrings show."""

from __future__ import annotations

import base64
import doctest
import inspect
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

import sucre_bench as sb


@pytest.fixture
def scene() -> sb.Scene:
    """Two views, the second half without depth."""
    rng = np.random.default_rng(1)
    depth = np.ones((48, 64), np.float32)
    depth[:, :32] = 0
    arrays = [sb.Arrays(rng.uniform(0.2, 0.8, (48, 64, 3)), depth=depth) for _ in range(2)]
    return sb.Scene(
        "reef",
        [sb.View(f"{n}.png", a) for n, a in zip("ab", arrays, strict=True)],
        frozenset({"depth"}),
    )


def test_a_view_is_given_by_object_name_or_place(scene: sb.Scene):
    by = [
        sb.restore("gray_world", scene, which).image
        for which in (scene["b.png"], "b.png", 1, -1)
    ]
    assert all(np.array_equal(image, by[0]) for image in by)


def test_a_preset_and_a_display_are_given_as_on_the_command_line():
    scene = next(sb.load_scenes("demo", views=2, width=96, height=72))
    preset = sb.restore("sucre_exact", scene, 0, display="white-99")
    plain = {"footprint": False, "physical": False, "robust": False, "light": "even"}
    same = sb.restore("sucre", scene, 0, display="white-99", **plain)
    assert np.allclose(preset.shown, same.shown, atol=1e-5, equal_nan=True)
    assert preset.display == "white-99" != sb.restore("sucre_exact", scene, 0).display
    assert set(sb.score(preset, scene[0], "uciqe")["method"]) == {"sucre_exact"}
    assert (
        sb.list_methods().loc["sucre_exact", "needs"] == sb.list_methods().loc["sucre", "needs"]
    )


def test_the_saved_picture_is_the_restored_image_in_8_bits(scene: sb.Scene, tmp_path: Path):
    result = sb.restore("histogram_stretch", scene, 0)
    result.save(tmp_path / "a.png")
    stored = cv2.imread(str(tmp_path / "a.png"))[..., ::-1]
    assert np.abs(stored / 255 - np.nan_to_num(result.shown)).max() <= 0.5 / 255 + 1e-6
    result.save(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays:
        assert np.array_equal(arrays["image"], result.image, equal_nan=True)


def test_wide_counts_charts_and_never_their_patches():
    rows = pd.DataFrame(
        [
            ("a.png", "sucre", "psi", "colour", "near", 4.0, "ok"),
            ("a.png", "sucre", "psi", "colour", "far", 6.0, "ok"),
            ("a.png", "sucre", "psi", "colour", "near/red", 90.0, "ok"),
            ("a.png", "sucre", "uciqe", "yang2015", "image", 0.5, "ok"),
            ("a.png", "sucre", "uciqe", "ratio", "image", 2.0, "ok"),
            ("b.png", "sucre", "psi", "colour", "image", np.nan, "skipped"),
        ],
        columns=["view", "method", "metric", "variant", "region", "value", "status"],
    ).assign(dataset="d", scene="s")
    table = sb.wide(rows)
    assert list(table.columns) == ["psi", "uciqe:yang2015", "uciqe:ratio"]
    assert table.loc[("d", "s", "a.png", "sucre")].tolist() == [5.0, 0.5, 2.0]
    assert table.loc[("d", "s", "b.png", "sucre")].isna().all()


def levels(dtype: type) -> np.ndarray:
    """A picture with the values 0 to 255 of this type, as OpenCV and Pillow give it."""
    return np.random.default_rng(2).integers(0, 256, (48, 64, 3)).astype(dtype)


@pytest.mark.parametrize(
    ("image", "remedy"),
    [
        (levels(np.uint8), "divide by 255"),
        (levels(np.float32), "divide by 255"),
        (levels(np.float64) * 0.77, "divide by 255"),
        (np.where(levels(np.float32) < 200, levels(np.float32), np.nan), "divide by 255"),
        (levels(np.uint16) * 257, "divide by 65535"),
    ],
)
def test_images_of_0_to_255_are_refused_and_not_scored_as_white(
    scene: sb.Scene, image: np.ndarray, remedy: str
):
    for make, place in (
        (sb.Restoration, "Restoration.image"),
        (sb.Arrays, "Arrays.rgb"),
        (lambda given: sb.Restoration(scene[0].rgb, filled=given), "Restoration.filled"),
        (lambda given: sb.Arrays(scene[0].rgb, reference=given), "Arrays.reference"),
    ):
        with pytest.raises(sb.InputError, match=rf"{place}: .*{remedy}"):
            make(image)
    assert sb.Restoration(levels(np.uint8) / 255).valid.all()


def test_colours_that_noise_drives_far_from_1_are_a_restoration():
    blown = np.random.default_rng(3).normal(0.5, 200, (48, 64, 3)).astype(np.float32)
    bright = np.full((48, 64, 3), 3, np.float32)
    assert all(sb.Restoration(image).valid.all() for image in (blown, bright))


def test_only_a_restoration_of_the_views_size_is_scored(scene: sb.Scene):
    with pytest.raises(sb.InputError, match=r"\(24, 64, 3\).*\(48, 64, 3\)"):
        sb.score(sb.Restoration(scene[0].rgb[:24]), scene[0], "uciqe")


def test_a_notebook_shows_small_pictures_and_escaped_names():
    hidden = np.full((300, 400, 3), 0.5)
    hidden[:100] = np.nan
    names = [f"<b>{n}</b>.png" for n in range(9)]
    scene = sb.Scene(
        "<i>reef</i>",
        [sb.View(name, sb.Arrays(np.full((300, 400, 3), 0.5))) for name in names],
        frozenset(),
    )
    for shown, count in (
        (scene, 4),
        (scene[0], 1),
        (sb.Restoration(hidden), 1),
        (sb.restore("gray_world", scene, 0), 1),
    ):
        page = shown._repr_html_()
        pictures = re.findall(r'src="data:image/jpeg;base64,([^"]+)"', page)
        assert len(pictures) == count
        assert "<b>" not in page
        assert "<i>" not in page
        decoded = cv2.imdecode(
            np.frombuffer(base64.b64decode(pictures[0]), np.uint8), cv2.IMREAD_COLOR
        )
        assert decoded.shape == (180, 240, 3)
        assert abs(int(decoded[150, 100, 0]) - 127) < 4
    compared = sb.compare_methods(
        scene, ["underwater", "gray_world"], metrics=["uciqe"], views=[0]
    )
    assert "| method |" in compared._repr_markdown_()


def test_scenes_are_opened_when_they_are_asked_for(tmp_path: Path):
    scene = sb.load_scene("demo", views=2, width=96, height=72, root=tmp_path)
    assert scene.dataset == "demo"
    assert set(sb.score(sb.restore("gray_world", scene, 0), scene[0], "psnr")["dataset"]) == {
        "demo"
    }
    assert (
        sb.load_scene("demo", scene.name, views=2, width=96, height=72, root=tmp_path).data_id
        == scene.data_id
    )
    with pytest.raises(sb.InputError, match=r"no scene 'costal'.*'coastal'"):
        sb.load_scene("demo", "costal", views=2, width=96, height=72, root=tmp_path)


@pytest.mark.parametrize("name", sorted(set(sb.__all__) - {"__version__"}))
def test_each_public_name_has_an_example_that_runs(name: str):
    public = getattr(sb, name)
    home = inspect.getmodule(public)
    finder = doctest.DocTestFinder(recurse=False)
    space = {**vars(home), "np": np}
    (test,) = finder.find(public, name, module=home, globs=space)
    assert test.examples, f"sucre_bench.{name} has no example in its docstring"
    assert (
        doctest.DocTestRunner(optionflags=doctest.IGNORE_EXCEPTION_DETAIL).run(test).failed == 0
    )


def test_a_notebook_scores_with_objects_of_its_own_and_prints_tables_for_papers(
    scene: sb.Scene,
):
    @sb.metric(better="lower", range=(0, 1))
    @dataclass(frozen=True)
    class Redness:
        """How red it is."""

        def score(
            self, restored: sb.Restoration, shown: np.ndarray, view: sb.View, variant: str
        ):
            yield sb.Score(float(shown[..., 0][restored.valid].mean()), n_pixels=1)

    @sb.method()
    @dataclass(frozen=True)
    class Twice:
        """Twice as bright."""

        def restore(self, scene: sb.Scene, view: sb.View) -> sb.Restoration:
            return sb.Restoration(view.rgb * 2)

    result = sb.restore("gray_world", scene, 0)
    assert "redness" in set(sb.score(result, scene[0], metrics=["uciqe", Redness()])["metric"])
    usual = sb.score(result, scene[0])
    assert {"uciqe", "coverage"} <= set(usual.loc[usual["status"] == "ok", "metric"])
    compared = sb.compare_methods(scene, ["gray_world", Twice()], metrics=[Redness()])
    assert set(compared.table.reset_index()["method"]) == {"gray_world", "twice"}
    assert "tabular" in compared.latex()
    assert "| twice |" in compared.markdown()
    with pytest.raises(sb.InputError, match="'twice'"):
        sb.restore("twice", scene, 0)
    with pytest.raises(sb.InputError, match=r"better"):
        sb.metric(unit="dB")


def test_a_degraded_scene_says_so(scene: sb.Scene):
    noisy = sb.degraded(sb.degraded(scene, depth_noise=0.05), noise=0.02)
    assert "depth_noise=0.05,noise=0.02" in repr(noisy)
    assert "degraded" not in repr(scene)
