"""Several methods on a scene in one call from Python."""

from dataclasses import dataclass

import numpy as np
import pytest

import sucre_bench as sb


@sb.method()
@dataclass(frozen=True)
class Brighten:
    """Multiply by a factor; has no answer for one view."""

    factor: float = 2.0

    def restore(self, scene: sb.Scene, view: sb.View) -> sb.Restoration:
        if view.name == "c.png":
            raise sb.SolveError("c.png: too dark; leave it out")
        return sb.Restoration(view.rgb * np.float32(self.factor))


@sb.method()
@dataclass(frozen=True)
class LeftHalf:
    """The photograph's left half, twice as bright."""

    def restore(self, scene: sb.Scene, view: sb.View) -> sb.Restoration:
        image = view.rgb * np.float32(2)
        image[:, view.rgb.shape[1] // 2 :] = np.nan
        return sb.Restoration(image)


@pytest.fixture
def scene() -> sb.Scene:
    """Three views at half the brightness of their references, without depth."""
    rng = np.random.default_rng(2)
    references = [rng.uniform(0.1, 0.9, (24, 32, 3)) for _ in range(3)]
    arrays = [sb.Arrays(reference / 2, reference=reference) for reference in references]
    views = [sb.View(f"{n}.png", own) for n, own in zip("abc", arrays, strict=True)]
    return sb.Scene("reef", views, frozenset({"reference"}))


def test_tables_and_pictures_are_of_every_view_and_method(scene: sb.Scene):
    methods = {"full": Brighten(), "some": Brighten(1.5), "as it is": {"name": "underwater"}}
    compared = sb.compare_methods(scene, methods, metrics=["psnr"])
    psnr = compared.table["psnr"]
    assert set(psnr.index.get_level_values("method")) == set(methods)
    assert psnr.notna().sum() == 2 + 2 + 3
    assert psnr.xs(("a.png", "as it is"), level=("view", "method")).iloc[0] == pytest.approx(
        -10 * np.log10(np.mean((scene[0].rgb - scene[0].reference) ** 2)), abs=1e-3
    )
    assert set(compared.pictures) == {(v, m) for v in ("a.png", "b.png") for m in methods} | {
        ("c.png", "as it is")
    }
    assert np.abs(compared.pictures["a.png", "full"] / 255 - scene[0].reference).max() < 0.003
    failed = compared.rows[compared.rows["status"] == "failed"]
    assert set(failed["view"]) == {"c.png"}
    assert failed["reason"].str.contains("too dark").all()


def test_it_prints_a_table_and_plots_before_and_after(scene: sb.Scene):
    compared = sb.compare_methods(
        scene, ["underwater", Brighten()], metrics=["psnr"], views=["b.png", 0]
    )
    assert "brighten" in str(compared)
    assert "peak_mb" not in str(compared)
    assert set(compared.rows["view"]) == {"a.png", "b.png"}
    picture = compared.plot("b.png", height=120)
    assert picture.size == (4 * 160 + 3 * 4, 120)
    # below the captions
    panels = [np.asarray(picture)[60:, n * 164 : n * 164 + 160] / 255 for n in range(4)]
    means = [panel.mean() for panel in panels]  # photograph, underwater, brighten, reference
    assert means[0] == pytest.approx(means[1], abs=0.01)
    assert means[2] == pytest.approx(means[3], abs=0.01)
    assert means[3] == pytest.approx(2 * means[0], rel=0.05)


def test_methods_that_fill_different_pixels_are_compared_on_those_that_all_fill(
    scene: sb.Scene,
):
    methods = {"whole": Brighten(1.9), "half": LeftHalf()}
    compared = sb.compare_methods(scene, methods, ["psnr"], views=[0])
    (column,) = (column for column in compared.comparison.columns if column.metric == "psnr")
    whole = compared.pictures["a.png", "whole"] / 255
    left = (whole - scene[0].reference)[:, :16]
    assert column.pixels == "common"
    assert compared.comparison.cells["whole", column].mean == pytest.approx(
        -10 * np.log10(np.mean(left**2)), rel=1e-5
    )
    by_itself = sb.compare_methods(scene, methods, ["psnr"], views=[0], pixels="own").comparison
    assert {column.pixels for column in by_itself.columns} == {"own"}


def test_what_a_scene_lacks_is_a_skipped_row(scene: sb.Scene):
    compared = sb.compare_methods(scene, ["stitching", "underwater"], metrics=["psnr"])
    own = compared.rows[compared.rows["method"] == "stitching"]
    assert (own["status"] == "skipped").all()
    assert ("a.png", "underwater") in compared.pictures


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({"methods": ["sucer"]}, "sucre"),
        ({"methods": "sucre"}, "list"),
        ({"methods": ["underwater", "underwater"]}, "underwater"),
        ({"methods": {"a": {"nme": "x"}}}, "a"),
        ({"methods": ["underwater"], "views": ["d.png"]}, r"d\.png"),
        ({"methods": ["underwater"], "metrics": ["psrn"]}, "psnr"),
    ],
)
def test_a_mistake_is_said_before_any_work(
    scene: sb.Scene, asked: dict[str, object], named: str
):
    with pytest.raises(sb.InputError, match=named):
        sb.compare_methods(scene, **asked)
