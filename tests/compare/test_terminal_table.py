"""The block that a terminal of 80 columns shows: which columns, in which order, and what it says."""

import itertools
import json
import re
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pytest
from support.made_rows import on_terminal, rows_of, table

from sucre_bench import compare
from sucre_bench.compare.documents import as_text
from sucre_bench.compare.terminal_table import as_blocks, as_table


def kind(
    metric: str, variant: str, unit: str = "", better: str = "higher", region: str = "image"
) -> dict[str, str]:
    return {
        "metric": metric,
        "variant": variant,
        "unit": unit,
        "better": better,
        "region": region,
    }


KINDS = {
    one["metric"]: one
    for one in (
        kind("psnr", "masked", "dB"),
        kind("ssim", "gaussian"),
        kind("colours", "raw", "dB"),
        kind("colours_de00", "gain", "dE00", "lower"),
        kind("psi", "colour", "deg", "lower", "chart"),
        kind("de00", "lab", "dE00", "lower", "chart"),
        kind("uciqe", "cielab"),
        kind("uiqm", "panetta2016"),
        kind("saturated_red", "hsv", "share", "lower"),
        kind("water", "attenuation", "relative", "lower"),
        kind("coverage", "image", "share"),
        kind("mine", "own"),
        kind("seconds", "wall", "s", "lower"),
    )
}


def compared(
    scores: dict[str, dict[str, list[float]]],
    photograph: str = "",
    datasets: tuple[str, ...] = ("sea",),
    **how: str,
) -> list[compare.Comparison]:
    """Comparisons of scores by metric, method and view; one method may be the photograph itself."""
    rows = pd.concat(
        rows_of(by_method, dataset=dataset, **KINDS[each])
        for dataset, (metric, by_method) in itertools.product(datasets, scores.items())
        for each in (metric, "seconds")
    )
    itself = json.dumps({"name": "underwater", "dataset": {"name": "photos"}})
    rows["options"] = rows["options"].mask(rows["method"] == photograph, itself)
    return compare.compare(rows, order=list(next(iter(scores.values()))), **how)


@dataclass(frozen=True)
class Block:
    """What is printed, as lines; heads: the columns' names."""

    lines: list[str]

    @property
    def heads(self) -> list[str]:
        place = next(n for n, line in enumerate(self.lines) if line.startswith("method"))
        above = self.lines[place - 1]
        if above.startswith(" "):  # their units stand beside "method"
            return re.split(r"\s{2,}", above.strip())
        return re.split(r"\s{2,}", self.lines[place])[1:]

    @property
    def names(self) -> list[str]:
        return [
            line.split()[0] for line in self.lines if re.search(r"^(?!views)\S.*\d\s*$", line)
        ]

    @property
    def text(self) -> str:
        return " ".join(line.strip() for line in self.lines)


def printed(
    comparisons: list[compare.Comparison],
    width: int = 80,
    colours: bool = False,
    every: bool = False,
) -> Block:
    blocks = as_blocks(comparisons, width, every)
    return Block(on_terminal(*blocks, width=width, colours=colours).splitlines())


MANY = {
    metric: {"plain": [1.0 * n, 2, 3, 4, 5, 6], "clever": [2.0 * n, 4, 6, 8, 10, 12]}
    for n, metric in enumerate(
        ("uciqe", "water", "psnr", "ssim", "psi", "de00", "coverage"), start=1
    )
}


def test_one_score_sorts_the_methods_whichever_columns_were_asked_for():
    values = {"a": [1.0, 2, 3, 4, 5, 6], "b": [2.0, 3, 4, 5, 6, 7]}
    tables = compared({"psnr": values, "colours": {"a": values["b"], "b": values["a"]}})
    assert printed(tables).names == printed(tables, every=True).names == ["a", "b"]


def test_the_columns_that_decide_are_those_that_know_the_true_colours():
    assert printed(compared(MANY)).heads == [
        "psnr ↑",
        "ssim ↑",
        "psi ↓",
        "de00 ↓",
        "filled",
        "seconds",
    ]
    computed = dict.fromkeys(("colours_de00", "colours"), MANY["psnr"])
    heads = ["colours_de00 ↓", "colours ↑", "psnr ↑", "psi ↓", "filled", "seconds"]
    assert printed(compared(MANY | computed)).heads == heads


NO_TRUTH = ": nobody can say from these numbers which colours are true."
WINNING = re.compile(r"lead|ahead|best|better|≈|more than chance")


@pytest.mark.parametrize("names", [("uciqe", "coverage"), ("uciqe", "saturated_red")])
@pytest.mark.parametrize("baseline", ["", "plain"])
def test_without_a_reference_or_charts_nobody_wins_and_the_order_is_as_asked(
    names: tuple[str, ...], baseline: str
):
    (comparison,) = compared(
        {name: MANY["uciqe" if name == "saturated_red" else name] for name in names},
        baseline=baseline,
    )
    block = printed([comparison])
    assert block.heads[0] == "uciqe ↑"
    assert block.names == ["plain", "clever"]  # by uciqe clever would be first
    for text in (
        block.text,
        on_terminal(as_table(comparison, 80), width=80),
        as_text([comparison], "md"),
    ):
        assert NO_TRUTH in " ".join(text.split())
        assert not WINNING.search(text)
    assert "1;32m" not in printed([comparison], colours=True).text
    records = json.loads(as_text([comparison], "json"))
    assert {
        (r["place"], r["rank"], r["tie_with_best"])
        for r in records
        if r["metric"] in names[::2]
    } <= {(0, 0, False)}


def test_a_score_that_is_taste_stands_last_and_nobody_wins_by_it_beside_truth_either():
    scores = {"mine": MANY["psnr"], "psnr": MANY["psnr"]}
    block = printed(compared(scores))
    assert NO_TRUTH not in block.text
    assert block.names == ["clever", "plain"]
    assert block.heads[:2] == ["psnr ↑", "mine ↑"]
    records = json.loads(as_text(compared(scores), "json"))
    assert {r["metric"]: r["knows"] for r in records} == {
        "psnr": "truth",
        "mine": None,
        "seconds": "truth",
    }
    assert {r["place"] for r in records if r["metric"] == "mine"} == {0}
    assert all("mine" not in line for line in block.lines[-2:])


def test_evidence_leads_only_by_its_name_with_how_well_it_agrees_with_truth():
    """Kendall's tau of uiqm is 0.21: of ten pairs of methods, it puts six in the order of the true colours."""
    values = {"first": [1.0, 2, 1.5, 1.1, 2.1] * 4, "second": [3.0, 4.1, 3.4, 3.0, 4.2] * 4}
    block = printed(compared({"uciqe": values, "uiqm": values}))
    assert block.heads[:2] == ["uiqm ↑", "uciqe ↑"]
    assert block.names == ["first", "second"]  # as asked
    assert NO_TRUTH in block.text
    assert re.search(r"By uiqm, .*\b6 of 10 pairs of methods: second leads first", block.text)
    assert "uciqe" not in block.text.partition(NO_TRUTH)[2]
    against = printed(compared({"uiqm": values}, baseline="first")).text
    assert re.search(r"By uiqm, .*\b6 of 10 .*: second", against)
    (comparison,) = compared({"uiqm": values})
    for text in (as_text([comparison], "md"), as_text([comparison], "latex")):
        assert re.search(r"By uiqm, .*\b6 of 10 .*second leads first", text)


def test_a_table_says_in_words_what_is_wrong_with_the_pictures():
    """Of one method in half of the views, of another in too few; faults have no columns unless asked for."""
    scores = (
        ("holed", "holes", "image", [0.0] * 5 + [0.5] * 5),
        ("orange", "cast", "image/", [30.0]),
        ("orange", "cast", "image", [30.0] * 10),
        ("orange", "cast", "image/orange", [30.0] * 10),
        ("whole", "clipped", "image", [0.9] + [0.0] * 9),
    )
    rows = pd.concat(
        [
            rows_of(dict.fromkeys(("holed", "orange", "whole"), [3.0] * 10)),
            *(
                rows_of({method: values}, metric="faults", variant=variant, region=region)
                for method, variant, region, values in scores
            ),
        ]
    )
    block = printed(compare.compare(rows))
    said = "What is wrong with the pictures: holed: 50 % of it is black in 5 of 10 views; orange: orange cast "
    assert said in block.text + " "
    assert "whole:" not in block.text
    assert block.heads == ["psnr ↑"]
    assert {c.metric for c in compare.compare(rows, ["faults"])[0].columns} == {"faults"}


@pytest.mark.parametrize(("dataset", "is_track"), [("demo", True), ("photos", False)])
def test_views_along_a_track_are_worth_fewer_than_photographs_without_poses(
    dataset: str, is_track: bool
):
    gains = [0.2, 0.3, 0.9, 1.0, 1.1, 1.0, 0.4, 0.2]
    options = json.dumps({"name": "gray_world", "dataset": {"name": dataset}})
    scores = {"a": [20.0] * 8, "b": [20 + gain for gain in gains]}
    text = printed([table(scores, options=options)]).text
    assert ("which may be chance" in text) == is_track


@pytest.mark.parametrize(
    ("dataset", "views", "said"),
    [
        ("demo", 4, "b is ahead of a .* may be chance .*5 views"),
        ("photos", 4, "b is ahead of a .* more than chance .*20 views"),
        ("photos", 19, "b is ahead of a .* more than chance .*20 views"),
        ("photos", 20, "b leads a "),
    ],
)
def test_few_views_name_no_leader_and_the_line_says_why(dataset: str, views: int, said: str):
    """b is better by 10 in each view. Four views of a track are alike; nineteen hide a rare failure."""
    options = json.dumps({"name": "gray_world", "dataset": {"name": dataset}})
    scores = {
        method: [gain + view % 3 for view in range(views)]
        for method, gain in (("a", 20.0), ("b", 30.0))
    }
    assert re.search(said, printed([table(scores, options=options)]).text)


def test_the_best_stands_first_and_the_photograph_last_however_good_it_is():
    scores = {
        "psnr": {"low": [1.0] * 5, "photo": [9.0] * 5, "high": [5.0] * 5, "middle": [3.0] * 5}
    }
    block = printed(compared(scores, photograph="photo"))
    assert block.names == ["high", "middle", "low", "photo"]
    assert re.search(r"psnr: no method beats the photograph", block.text)
    painted = printed(compared(scores, photograph="photo"), colours=True).text
    assert re.search(r"\x1b\[1;32m5\.00", painted)
    assert not re.search(r"\x1b\[1;32m9\.00", painted)


@pytest.mark.parametrize("views", [2, 4, 5])
def test_ties_are_marked_over_any_number_of_views(views: int):
    a, b = [20.0, 25, 30, 27, 26][:views], [21.5, 24, 31, 26, 27][:views]
    block = printed(compared({"psnr": {"a": a, "b": b, "far": [value - 1000 for value in b]}}))
    assert len(re.findall(r"≈ \d", block.text)) == 1
    assert "which may be chance" in block.text
    assert ("rough" in block.text) == (views < 5)


def test_the_whole_table_marks_ties_with_and_without_intervals():
    scores = {"a": [20.0, 25, 30], "b": [21.0, 24, 31], "far": [-979.0, -976, -969]}
    comparison = table(scores)
    shown = [
        on_terminal(as_table(comparison, 80, intervals=intervals), width=80)
        for intervals in (False, True)
    ]
    assert [bool(re.search(r"25\.0 \[", text)) for text in shown] == [False, True]
    assert all("≈" in text for text in shown)
    assert all("rough" in text for text in shown)


def test_what_is_over_more_views_than_the_scores_says_so():
    taste = {"a": [1.0, 2, 3, 4], "b": [2.0, 3, 4, 5]}
    block = printed(compared({"psi": {"a": [4.0, 5], "b": [4.1, 4.8]}, "uciqe": taste}))
    (views,) = (line.split() for line in block.lines if line.startswith("views"))
    assert dict(zip(block.heads, views[1:], strict=True)) == {
        "psi ↓": "2",
        "seconds": "4",
    }


def test_the_photograph_beside_them_changes_no_difference_between_two_methods() -> None:
    rng = np.random.default_rng(0)
    scores = {name: list(rng.normal(mean, 1, 24)) for name, mean in (("a", 1.0), ("b", 0.5))}
    photograph = {"photo": list(rng.normal(0, 1, 24))}
    (plain,) = compared({"psnr": scores})
    (beside,) = compared({"psnr": scores | photograph}, photograph="photo")
    (against,) = compared({"psnr": scores | photograph}, photograph="photo", baseline="a")
    behind = next(
        cell for cell in plain.of(plain.columns[0]).values() if cell.place == 2
    ).behind
    for comparison in (beside, against):
        column = comparison.columns[0]
        cell = comparison.cells["b", column]
        found = cell.change if comparison.baseline else cell.behind
        assert sorted(map(abs, found)) == pytest.approx(sorted(map(abs, behind)), abs=1e-9)


def test_against_a_baseline_equal_shares_of_pixels_differ_by_nothing():
    scores = {
        "psnr": {key: [1.0, 2, 4] for key in "abc"},
        "coverage": {"a": [1.0] * 3, "b": [1.0] * 3, "c": [0.6] * 3},
    }
    block = printed(compared(scores, baseline="a"))
    assert [line.split()[2] for line in block.lines if line[:2] in ("a ", "b ", "c ")] == [
        "1.00",
        "0",
        "-0.400",
    ]
    assert not re.search(r"≈ [\d+-]", block.text)


def test_scores_that_differ_by_rounding_are_equal():
    base = [20.0, 25, 30, 27, 22]
    scores = {"psnr": {"a": base, "b": [x + 1.2e-6 for x in base], "c": [x - 3 for x in base]}}
    assert not re.search(
        "a (leads|is ahead of) b|b (leads|is ahead of) a", printed(compared(scores)).text
    )
    assert re.search(
        r"psnr: (a equals b|b equals a)", printed(compared(scores, baseline="a")).text
    )


def test_many_datasets_are_one_block_with_the_main_score_of_each():
    titles = tuple(f"sea,noise={n}" for n in (0, 0.01, 0.02, 0.05))
    block = printed(
        compared(
            {"psnr": {"a": [1.0, 2], "b": [3.0, 4]}, "ssim": {"a": [0.5], "b": [0.6]}},
            datasets=titles,
        )
    )
    assert block.heads == [f"noise={n}" for n in ("0", "0.01", "0.02", "0.05")]
    assert len(block.lines) < 10
    tables = compared(
        {key: {"a": [1.0, 2], "b": [3.0, 4]} for key in ("psnr", "ssim", "water")},
        datasets=titles,
    )
    named = printed(
        [compare.only(table, ["water", "psnr"]) for table in tables], every=True
    ).text
    assert re.findall(r"(\w+) [↑↓][^:]*? of 4 tables", named) == ["water", "psnr"]


def test_many_datasets_say_on_which_pixels_their_scores_are():
    rows = pd.concat(
        rows_of({"whole": [1.0], "holed": [2.0]}, dataset=f"sea{n}", **KINDS[metric])
        for n in range(4)
        for metric in ("psnr", "seconds")
    )
    is_whole = (rows["method"] == "whole") | (rows["dataset"] == "sea3")
    rows["coverage"] = rows["coverage"].where(is_whole, 0.5)
    assert re.search(r"\b3 of 4 tables\b.*pixels", printed(compare.compare(rows)).text)


LONG = "sucre,pairing=depth,solver=exact,physical=true,footprints=false,neighbours=40"


@pytest.mark.parametrize("width", [60, 80, 120])
@pytest.mark.parametrize("label", ["short", LONG[:40], LONG[:50]])
def test_no_line_is_wider_than_the_terminal_and_no_word_is_cut(width: int, label: str):
    renamed = {
        metric: {label if m == "plain" else m: v for m, v in own.items()}
        for metric, own in MANY.items()
    }
    (comparison,) = compared(renamed)
    block = printed([comparison], width)
    assert max(map(len, block.lines)) <= width
    assert label in block.text
    words = {*re.split(r"\s+", printed([comparison], 2000).text)}
    assert {*re.split(r"\s+", block.text)} <= words
