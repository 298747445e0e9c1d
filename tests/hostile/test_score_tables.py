"""A scores.parquet that something else wrote, or changed: run, compare and report name the file and the column."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.command_line import run_here
from support.places import TOYS

from sucre_bench import results
from sucre_bench.results.rows import Row

ROWS = results.frame(
    replace(
        Row("toy", "toy", f"v{n}.png", "gain", metric=metric, value=1.0 + n), variant=variant
    )
    for n in range(3)
    for metric, variant in (("seconds", "wall"), ("psnr", "masked"))
)


def column(name: str, values: Any) -> Callable[[Path], None]:
    """Write the table with other values in one column, `values` in all rows or one a row."""

    def write(path: Path) -> None:
        rows = ROWS.drop(columns=name).assign(**{name: values})
        rows.to_parquet(path, index=False)

    return write


def without(name: str) -> Callable[[Path], None]:
    return lambda path: ROWS.drop(columns=name).to_parquet(path, index=False)


def with_bytes(change: Callable[[bytes], bytes]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        ROWS.to_parquet(path, index=False, compression=None)
        path.write_bytes(change(path.read_bytes()))

    return write


NOISE = np.random.default_rng(0).bytes(360)
FAULTS: dict[str, tuple[Callable[[Path], None], str]] = {
    "text for numbers": (column("value", "high"), "column 'value'"),
    "no time": (column("time", "yesterday"), "column 'time'"),
    "negative pixels": (column("n_pixels", -1), "column 'n_pixels'"),
    "null views": (column("view", [None, *ROWS["view"][1:]]), "column 'view'"),
    "an unknown status": (column("status", "fine"), "column 'status'"),
    "options that are no JSON": (column("options", "{"), "column 'options'"),
    "options that are no UTF-8": (column("options", '{"gain": "\\udc80"}'), "column 'options'"),
    "deep options": (column("options", "[" * 100_000), "column 'options'"),
    "a column is missing": (without("region"), "column 'region'"),
    "cut short": (with_bytes(lambda whole: whole[:-200]), "scores.parquet: not"),
    "overwritten inside": (
        with_bytes(lambda whole: whole[:40] + NOISE + whole[400:]),
        "scores.parquet: not",
    ),
    "bytes that are no text": (
        with_bytes(lambda whole: whole.replace(b"gain", b"\xff\xfe\xff\xfe")),
        "scores.parquet: not",
    ),
    "a folder": (lambda path: path.mkdir(), ""),
}
COMMANDS = {
    "compare": ("compare", "results"),
    "report": ("report", "results"),
    "run": (
        "run",
        "--plugin",
        str(TOYS),
        "dataset=toy",
        "method=gain",
        "metrics=[redness]",
        "out=results",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_table_that_cannot_be_used_is_one_line_with_file_and_column(
    tmp_path: Path, fault: str
):
    write, said = FAULTS[fault]
    path = tmp_path / "results/scores.parquet"
    path.parent.mkdir()
    write(path)
    before = path.read_bytes() if path.is_file() else None
    # all commands read it by one function
    for command in COMMANDS.values() if fault == "cut short" else [COMMANDS["compare"]]:
        done = run_here(tmp_path, *command)
        assert done.returncode == 2, command
        assert "scores.parquet" in done.stderr
        assert said in done.stderr
        assert len(done.errors) == 1
        assert not re.search(r"Traceback|\w+Error\b", done.stderr)
        assert (path.read_bytes() if path.is_file() else None) == before


def test_a_table_of_nothing_but_nan_is_one_line_with_a_remedy(tmp_path: Path):
    (tmp_path / "results").mkdir()
    column("value", float("nan"))(tmp_path / "results/scores.parquet")
    done = run_here(tmp_path, "compare", "results")
    assert done.returncode == 2
    assert [
        re.fullmatch(r"error: results: [^;]+; [^;]+", line) is not None for line in done.errors
    ] == [True]
