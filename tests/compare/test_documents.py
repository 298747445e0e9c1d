import io
import json
import os
import re
import shutil
import string
import subprocess
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.made_rows import on_terminal, rows_of, table

from sucre_bench import compare
from sucre_bench.compare.documents import as_text
from sucre_bench.compare.terminal_table import as_table
from sucre_bench.compare.words import number, verdict_text


def terminal(
    comparison: compare.Comparison, colours: bool = False, spread: bool = False
) -> str:
    return on_terminal(as_table(comparison, 120, spread=spread), colours=colours)


def test_seconds_and_memory_are_in_a_document_only_when_asked_for(bench, tmp_path: Path):
    (tmp_path / "r").mkdir()
    kinds = (("psnr", "higher"), ("seconds", "lower"), ("peak_mb", "lower"))
    rows = pd.concat(
        rows_of({"m": [1.0]}, metric=name, better=better) for name, better in kinds
    )
    rows.to_parquet(tmp_path / "r" / "scores.parquet")
    plain = bench("compare", "r", "--format", "latex").stdout
    for asked in ("--all-metrics", "--metric=seconds"):
        assert "seconds" in bench("compare", "r", "--format", "latex", asked).stdout
    assert [name in plain for name in ("psnr", "seconds", "peak")] == [True, False, False]
    assert "seconds" in bench("compare", "r", "--format", "csv").stdout


def test_several_tables_are_one_text_a_program_can_read():
    both = compare.compare(
        pd.concat(rows_of({"m": [1.0]}, dataset=dataset) for dataset in ("sea", "lake"))
    )
    assert [line["table"] for line in json.loads(as_text(both, "json"))] == ["sea", "lake"]
    assert as_text(both, "csv").count("metric,variant") == 1
    assert "**lake**" in as_text(both, "md")


def test_records_hold_all_that_is_known_of_a_cell():
    comparison = table({"a": [1.0, 2, 4], "b": [3.0, 2, None]}, baseline="a")
    read = pd.read_csv(io.StringIO(as_text([comparison], "csv"))).set_index("method")
    column = comparison.columns[0]
    for name in comparison.methods:
        cell = comparison.cells[name, column]
        for field in ("mean", "std", "low", "high", "place", "rank", "wins", "effect", "holes"):
            assert read.loc[name, field] == pytest.approx(getattr(cell, field), nan_ok=True)
        found = [read.loc[name, f"change{end}"] for end in ("", "_low", "_high")]
        assert found == pytest.approx(cell.change, nan_ok=True)
    assert read.loc["b", "holes"] == 1
    assert set(read["baseline"]) == {"a"}


def test_json_has_no_number_that_json_does_not_know():
    text = as_text([table({"perfect": [np.inf, 1.0], "good": [2.0, 1.0]})], "json")
    json.loads(text, parse_constant=lambda name: pytest.fail(name))


@pytest.mark.parametrize(
    ("how", "kept", "not_kept"),
    [
        ("md", r"\|", "<img"),
        ("latex", r"\textbackslash", r"\input{"),
        ("csv", "'=1+1", "\n=1+1"),
    ],
)
def test_a_label_is_text_in_each_format(how: str, kept: str, not_kept: str):
    comparison = table(
        {"<img src=x>": [1, 2], "=1+1": [2, 3], r"\input{x}": [3, 4], "a|b": [4, 5]}
    )
    lines = as_text([comparison], how).splitlines()
    text = "\n".join(line for line in lines if not line.startswith("% "))  # LaTeX's comments
    assert kept in text
    assert not_kept not in text


@pytest.mark.parametrize("baseline", ["", "a"])
def test_latex_compiles_as_is(baseline: str, tmp_path: Path):
    """In a document that asks for booktabs and nothing else, with signs of its own and letters of Latin-1 in names.

    SUCRE_BENCH_TEST_LATEX=1 makes it a failure that there is no LaTeX, rather than a reason to skip.
    """
    program = shutil.which("pdflatex")
    if program is None:
        said = "no pdflatex here; install Debian's packages texlive-latex-base and texlive-latex-recommended"
        pytest.fail(said) if os.environ.get("SUCRE_BENCH_TEST_LATEX") == "1" else pytest.skip(
            said
        )
    signs = string.punctuation + "äöüßéèçñøåÄÖÜ"
    scores = {
        label: [n + 1.0, n * n + 0.5, 7.0 - n]
        for n, label in enumerate(["a", signs, "[c] *d*"])
    }
    (tmp_path / "scores.tex").write_text(
        as_text([table(scores, baseline=baseline)], "latex", spread=True)
    )
    (tmp_path / "paper.tex").write_text(
        "\\documentclass{article}\n\\usepackage{booktabs}\n\\begin{document}\n\\input{scores}\n\\end{document}\n"
    )
    done = subprocess.run(
        [program, "-interaction=nonstopmode", "-halt-on-error", "paper.tex"],
        cwd=tmp_path,
        capture_output=True,
    )
    assert done.returncode == 0, done.stdout.decode(errors="replace")[-1500:]
    assert (tmp_path / "paper.pdf").stat().st_size > 10_000


def test_cells_show_mean_interval_tie_and_holes():
    comparison = table(
        {"a": [20.0, 25, 30, None], "b": [21.0, 24, 31, 9], "far": [-979.0, -976, -969, -991]}
    )
    assert re.search(r"a +≈ 25\.0 \[\d+\.\d, \d+\.\d\] ○1", terminal(comparison))
    assert re.search(r"b +25\.3 \[", terminal(comparison))
    assert "±" not in terminal(comparison)
    assert re.search(r"≈ 25\.0 ± 5\.00 \[", terminal(comparison, spread=True))
    for how in ("md", "latex"):
        assert "5.00" in as_text([comparison], how, spread=True)
        assert "5.00" not in as_text([comparison], how)


def test_the_best_is_bold_and_green_the_second_underlined():
    text = terminal(table({"a": [1.0, 2, 4], "b": [3.0, 5, 6], "c": [0.0, 0, 0]}), colours=True)
    assert re.search(r"\x1b\[1;32m\S*4\.67", text)
    assert re.search(r"\x1b\[4m\S*2\.33", text.replace("≈ ", "≈"))


def test_against_a_baseline_better_is_green_worse_red_and_chance_marked():
    noise = [0.01, -0.01, 0.02, 0.0]
    base = [20.0, 25, 30, 27]
    scores = {
        "base": base,
        "better": [x + 1 + e for x, e in zip(base, noise, strict=True)],
        "worse": [x - 1 + e for x, e in zip(base, noise, strict=True)],
        "same": [21.0, 24, 31, 26.5],
    }
    text = terminal(table(scores, baseline="base"), colours=True)
    assert re.search(r"\x1b\[1;32m\+1\.0", text)
    assert re.search(r"\x1b\[31m-0\.99", text)
    assert re.search(r"≈ \+0\.125", text)
    lower = terminal(table(scores, baseline="base", better="lower"), colours=True)
    assert re.search(r"\x1b\[31m\+1\.0", lower)


def test_chance_is_marked_also_where_nobody_wins_by_a_score():
    metric = {"metric": "uciqe", "variant": "yang2015", "better": "higher"}
    comparison = table({"base": [1.0, 2, 3], "m": [1.5, 1.4, 3.3]}, baseline="base", **metric)
    assert "≈" in terminal(comparison)


def test_a_verdict_says_gap_interval_wins_and_chance():
    comparison = table({"a": [1.0, 9, 5], "b": [2.0, 8, 4.9]})
    (verdict,) = compare.verdicts(comparison)
    assert (verdict.leader, verdict.second, verdict.wins, verdict.may_be_chance) == (
        "a",
        "b",
        2,
        True,
    )
    assert verdict.difference == pytest.approx(0.1 / 3)
    said = verdict_text(comparison, verdict)
    assert re.fullmatch(
        r"psnr: a .*b .*0\.033 dB \[-\S+, \S+\], .*2 of 3 views, .*chance", said
    )


def test_a_verdict_against_a_baseline_is_a_sentence_a_method():
    comparison = table(
        {"base": [1.0, 2, 3], "m": [2.0, 3.1, 3.9], "n": [1.0, 2, 3]},
        baseline="base",
        better="lower",
    )
    verdicts = compare.verdicts(comparison)
    assert [(v.leader, v.second, v.wins) for v in verdicts] == [
        ("base", "m", 3),
        ("n", "base", 1.5),
    ]
    first, second = (verdict_text(comparison, verdict) for verdict in verdicts)
    assert re.fullmatch(
        r"psnr: base is ahead of m by 1\.00 dB \[.*\], better in 3 of 3 views, .*", first
    )
    assert re.fullmatch(r"psnr: n .*equal.* base", second)


def test_nobody_is_said_to_lead_by_what_only_describes_or_by_infinity():
    assert compare.verdicts(table({"a": [1.0, 2], "b": [2.0, 3]}, better="none")) == []
    assert compare.verdicts(table({"perfect": [np.inf, 30.0], "good": [29.0, 28.0]})) == []


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"), (0.0002, "0.00020"), (0.02, "0.020"), (0.0312, "0.031"), (0.5, "0.500"), (1.234, "1.23"),
        (31.74, "31.7"), (123.4, "123"), (np.nan, "-"), (np.inf, "inf"), (-12.34, "-12.3"),
    ],
)  # fmt: skip
def test_numbers_keep_the_figures_that_matter(value: float, text: str):
    assert number(value) == text
