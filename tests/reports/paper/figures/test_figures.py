"""Figures of a paper: strips, panels, what their pictures and captions hold, and figures of the model's validity."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from support.made_results import drawn, row

from sucre_bench import compare
from sucre_bench.reports.paper import style
from sucre_bench.reports.paper.study_results import Value
from sucre_bench.results.rows import Row, frame

NAMES = [f"method_{n}" for n in range(60)]


def table(values: dict[str, Sequence[float]], **about: Any) -> list[Row]:
    return [
        row(m, f"v{n}.png", v, **about) for m, own in values.items() for n, v in enumerate(own)
    ]


# -- style -------------------------------------------------------------------------------------------------


def test_a_method_has_one_colour_and_marker_whatever_stands_beside_it():
    """Only methods that would share a colour give way, and to nobody else's cost."""
    own = {name: style.own_look(name) for name in NAMES}
    assert all(style.looks([name]) == {name: own[name]} for name in NAMES)
    wanted = [own[name].colour for name in NAMES[:12]]
    for name, look in style.looks(NAMES[:12]).items():
        assert look == own[name] or wanted.count(own[name].colour) > 1
    assert sum(look == own[name] for name, look in style.looks(NAMES[:12]).items()) == len(
        set(wanted)
    )


def test_methods_of_one_figure_have_colours_of_their_own_while_there_are_enough():
    twenty = style.looks(NAMES[:20])
    assert len({own.colour for own in twenty.values()}) == 20
    sixty = style.looks(NAMES)
    assert len({(own.colour, own.marker) for own in sixty.values()}) == 60


def test_figures_have_the_width_of_a_paper_and_keep_their_text(tmp_path: Path):
    figure, axes = style.figure(1, 1.0, 1, 2)
    assert axes.shape == (1, 2)
    axes[0, 0].set_title("a b")
    written = style.save(figure, tmp_path / "within=1.5", svg=True)
    assert [path.name for path in written] == [
        "within=1.5.png",
        "within=1.5.pdf",
        "within=1.5.svg",
    ]
    with Image.open(written[0]) as png:
        assert png.size == (1005, 300)  # 3.35 inches at 300 dpi
    pdf = written[1].read_bytes()
    assert b"/Type3" not in pdf  # glyphs as drawings
    assert b"/TrueType" in pdf or b"/CIDFontType2" in pdf
    assert b">a b<" in written[2].read_bytes()


# -- scores ------------------------------------------------------------------------------------------------


def test_methods_are_sorted_by_their_mean_and_ties_are_hollow():
    noise = np.random.default_rng(0).normal(0, 1, 8)
    values = {"low": 10 + noise, "top": 20 + noise, "near": 19.9 + noise[::-1]}
    (figure,) = drawn("scores", frame(table(values))).values()
    (panel,) = figure.axes
    assert [tick.get_text() for tick in panel.get_yticklabels()] == ["top", "near", "low"]
    dots = [line for line in panel.lines if len(line.get_xdata()) == 1]
    assert [float(dot.get_xdata()[0]) for dot in dots] == pytest.approx(
        [values[name].mean() for name in ("top", "near", "low")]
    )
    assert [dot.get_markerfacecolor() == "white" for dot in dots] == [False, True, False]
    bars = [line.get_xdata() for line in panel.lines if len(line.get_xdata()) == 2]
    assert all(
        low < float(dot.get_xdata()[0]) < high
        for (low, high), dot in zip(bars, dots, strict=True)
    )


@pytest.mark.parametrize(("slow", "scale"), [(50.0, "log"), (5.0, "linear")])
def test_seconds_of_unlike_methods_are_on_a_logarithmic_axis(slow: float, scale: str):
    cost = {"metric": "seconds", "variant": "wall", "unit": "s", "better": "lower"}
    seconds = table({"a": [0.5, 0.5], "b": [slow, slow]}, **cost)
    rows = frame([*table({"a": [1, 2], "b": [300, 400]}), *seconds])
    (figure,) = drawn("scores", rows, metrics=("psnr", "seconds")).values()
    panels = [panel for panel in figure.axes if panel.get_visible()]
    assert [panel.get_xscale() for panel in panels] == ["linear", scale]


# -- against a value ---------------------------------------------------------------------------------------


def values(*numbers: float | None) -> list[Value]:
    return [Value(str(n), n, n is not None) for n in numbers]


def test_values_lie_where_their_numbers_are_and_the_unlimited_one_step_beyond():
    from sucre_bench.reports.paper.scores import positions

    assert positions(values(1, 2, 4, None)) == ([1, 2, 4, 6], False)
    assert positions(values(50, 500, 3000, None)) == ([50, 500, 3000, 18000], True)
    # nought is on no logarithmic axis
    assert positions(values(0, 0.01, 0.1)) == (
        [0, 0.01, 0.1],
        False,
    )
    words = [Value("clear", None), Value("turbid", None), Value("none", None, False)]
    assert positions(words) == ([0, 1, 2], False)


def test_lines_go_through_the_means_and_bands_through_the_intervals():
    rows = frame(
        [
            *table({"a": [20, 24, 28], "b": [10, 14, 18]}),
            *table({"a": [17, 21, 25], "b": [7, 11, 15]}, degrade={"within": 2}),
        ]
    )
    (figure,) = drawn("against", rows, along="degrade.within").values()
    (panel,) = figure.axes
    assert [tick.get_text() for tick in panel.get_xticklabels()] == ["2", "all"]
    assert {line.get_label(): list(line.get_ydata()) for line in panel.lines} == {
        "a": [21, 24],
        "b": [11, 14],
    }
    low, high = (
        f(panel.collections[0].get_paths()[0].vertices[:, 1]) for f in (np.min, np.max)
    )
    assert low < 21 - 4 / np.sqrt(3)
    assert high > 24 + 4 / np.sqrt(3)
    assert figure.get_supxlabel() == "within"
    (named,) = drawn(
        "against", rows, along="degrade.within", axis="frames before and after"
    ).values()
    assert "frames" in named.get_supxlabel()


# -- pictures ----------------------------------------------------------------------------------------------


def grays(figure: Any) -> list[list[int | None]]:
    """The gray of every picture, by rows; None where it says that there is none."""
    rows: dict[float, list[tuple[float, int | None]]] = {}
    for panel in figure.axes:
        place = panel.get_position()
        gray = int(panel.images[0].get_array()[0, 0, 0]) if panel.images else None
        rows.setdefault(round(-place.y0, 3), []).append((place.x0, gray))
    return [
        [gray for _, gray in sorted(own, key=lambda one: one[0])]
        for _, own in sorted(rows.items())
    ]


def test_each_picture_stands_by_its_view_and_method(tmp_path: Path):
    def paint(place: str, gray: int) -> None:
        path = tmp_path / place
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.new("L", (40, 30), gray).convert("RGB").save(path)

    for n in range(2):
        paint(f"views/sea/v{n}.jpg", 10 + n)
        paint(f"references/sea/v{n}.jpg", 200 + n)
        paint(f"restored/sea/b/v{n}.png", 100 + n)
    paint("restored/sea/a/v0.png", 110)
    rows = frame(table({"b": [20, 20], "a": [20, 20]}))
    (figure,) = drawn("pictures", rows, tmp_path).values()
    assert grays(figure) == [[10, 100, 110, 200], [11, 101, None, 201]]
    heads = [panel.get_title() for panel in figure.axes[:4]]
    assert heads == ["input", "b", "a", "reference"]


# By metric: scores of the methods, and what Kendall's tau with the true order a < b < c < d is.
SCORES = {
    "colours": ([1.0, 2.0, 3.0, 4.0], None),
    "ssim": ([5.0, 6.0, 7.0, 8.0], 1),
    "psi": ([1.0, 2.0, 3.0, 4.0], -1),
    "uiqm": ([2.0, 1.0, 3.0, 4.0], 2 / 3),
}


def test_the_agreement_is_kendalls_tau_over_scenes_whatever_is_better() -> None:
    from sucre_bench.reports.paper.scores import agreements

    rows = [
        one
        for metric, (scores, _) in SCORES.items()
        for scene in range(3)
        for one in table(
            {name: [score + scene] for name, score in zip("abcd", scores, strict=True)},
            metric=metric,
            scene=f"s{scene}",
            better="lower" if metric == "psi" else "higher",
        )
    ]
    found = agreements(compare.compare(frame(rows)), "colours")
    by_name = {name.partition(":")[0]: tau for name, tau in found["tau"].items()}
    assert by_name == pytest.approx(
        {metric: tau for metric, (_, tau) in SCORES.items() if tau is not None}
    )
    assert (found["n_scenes"] == 3).all()
    assert (found["low"] <= found["tau"] + 1e-9).all()
    assert (found["tau"] <= found["high"] + 1e-9).all()
