"""`sucre-bench compare`: one table of results folders."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sucre_bench.commands import completion, shared
from sucre_bench.errors import InputError
from sucre_bench.machine import progress, terminal
from sucre_bench.machine.terminal import say

if TYPE_CHECKING:
    import pandas as pd

    from sucre_bench.compare import Gated


@click.command()
@shared.argument("folders", nargs=-1, required=True)
@shared.option(
    "--by",
    of=("method", "view", "region"),
    help="One table for each dataset, for each view, or for each region (a chart).",
)
@shared.option(
    "--metric",
    "metrics",
    multiple=True,
    metavar="NAME[:VARIANT]",
    shell_complete=completion.complete_metrics,
    help="Show only this column; may be repeated.",
)
@shared.option(
    "--baseline",
    default="",
    metavar="METHOD",
    help="Show how the others differ from this method.",
)
@shared.option(
    "--fail-below",
    "limits",
    multiple=True,
    metavar="[METHOD/]METRIC=LIMIT",
    help="With --baseline: exit with 1 if a method is worse than the baseline by more than LIMIT and by more than"
    " chance. psnr=-0.5 means 0.5 dB. May be repeated.",
)
@shared.flag(
    "--common", help="If methods ran on different images, compare on the images they share."
)
@shared.flag("--intervals", help="Show 95 % intervals, and a sentence for each lead.")
@shared.flag("--all-metrics", help="Show all columns, also seconds and memory.")
@shared.option(
    "--pixels",
    of=("common", "own"),
    help="If methods fill different pixels of an image: score all on the common pixels, or each on its own.",
)
@shared.flag("--spread", help="Show standard deviations too (with n - 1).")
@shared.option(
    "--format",
    "how",
    of=("terminal", "md", "latex", "csv", "json"),
    help="Format of the tables. All but terminal have 95 % intervals; csv and json have every column.",
)
@shared.flag("--json", "as_json", help="The same as --format json.")
@shared.plugin_option
def compare(
    folders: Sequence[Path],
    by: Any,
    metrics: Sequence[str],
    baseline: str,
    limits: Sequence[str],
    common: bool,
    intervals: bool,
    all_metrics: bool,
    pixels: Any,
    spread: bool,
    how: Any,
    as_json: bool,
) -> None:
    """Compare the methods of one or more results folders: one table, and who leads.

    \b
    sucre-bench compare results
    sucre-bench compare results --baseline sucre_paper --metric psnr --metric psi
    sucre-bench compare monday/ tuesday/ --metric psi --by region --format latex
    sucre-bench compare results --baseline sucre --fail-below mine/psnr=-0.5
    sucre-bench compare results --json | jq '.[] | {method, metric, mean}'

    All methods are compared on the same images. The command refuses runs that are not comparable, and says why.
    """
    from sucre_bench import compare
    from sucre_bench.compare.model import FILLED
    from sucre_bench.compare.terminal_table import as_blocks
    from sucre_bench.compare.words import left_out

    gates = [compare.Gate.read(text) for text in limits]
    if gates and not baseline:
        raise click.UsageError(
            "--fail-below: needs --baseline METHOD, which the others are compared with"
        )
    with progress.live() if len(folders) > 1 else contextlib.nullcontext():
        rows, common_rows = compare.load(folders)
        compare.refuse(rows, metrics, common)
        if pixels == "common":
            rows = compare.on_pixels(rows, _common(folders, rows, common_rows))
    compared = compare.compare(rows, metrics, by, baseline=baseline)
    # the share that methods fill stands beside other scores alone
    if all(column.metric == FILLED for table in compared for column in table.columns):
        notes = "; ".join(f"{t.title}: {note}" for t in compared for note in left_out(t))
        remedy = "mend that, and run again" if notes else "run methods into it first"
        raise InputError(notes or "no score there", ", ".join(map(str, folders)), remedy)
    verdicts = compare.gated(rows, gates, baseline) if gates else []
    how = "json" if as_json else how
    all_columns = bool(metrics) or all_metrics
    if how != "terminal":
        from sucre_bench.compare.documents import as_text, without_costs

        if how not in ("csv", "json") and not all_columns:
            compared = [without_costs(table) for table in compared]
        click.echo(as_text(compared, how, spread), nl=False)
    else:
        width = terminal.out.width
        for block in as_blocks(compared, width, all_columns, intervals, spread):
            terminal.out.print(block)
            click.echo()
    if any(note.kind == "trained on" for table in compared for note in table.notes):
        from sucre_bench.engine.training_pictures import seen_in_training

        seen = [line for folder in folders for line in seen_in_training(folder, rows)]
        for line in dict.fromkeys(seen):
            say(line, "yellow")
    for verdict in verdicts:
        _say_gated(verdict, baseline)
    sys.exit(1 if any(verdict.fails for verdict in verdicts) else 0)


def _common(folders: Sequence[Path], rows: pd.DataFrame, known: pd.DataFrame) -> pd.DataFrame:
    """The scores on common pixels: those in the folders, and of methods in several folders those made now."""
    from sucre_bench.compare import leaves_holes

    if len(folders) < 2 or not leaves_holes(rows):
        return known
    import pandas as pd

    from sucre_bench.engine.common_pixels import score_folders
    from sucre_bench.jobs.job import load_them, plugin_files

    for folder in folders:
        if remedy := load_them(plugin_files(folder)):
            say(f"note: {folder}: its plugin files are not loaded; {remedy}", "yellow")
    made = score_folders(rows)
    tables = [table for table in (known, made) if len(table)]
    return pd.concat(tables, ignore_index=True) if tables else known


_COLOURS = {"passed": "green", "unknown": "yellow", "failed": "red", "no score": "red"}


def _say_gated(verdict: Gated, baseline: str) -> None:
    """Print what a gate says, on stderr: stdout has the tables."""
    from sucre_bench.compare.words import number, signed

    column = verdict.column
    gain, low, high = map(signed, verdict.gain)
    interval = f"[{low}, {high}]"
    if verdict.outcome == "unknown":
        interval = "(so few views have no interval)"
    gained = " ".join(filter(None, ["gain", gain, column.unit, interval]))
    said = f"{gained} over {baseline}, limit {number(verdict.gate.limit)}"
    if verdict.outcome == "no score":
        said = f"has no score on a view where {baseline} has one"
    elif verdict.worst:
        said += "; worst views: " + ", ".join(
            f"{name} {signed(g)}" for name, g in verdict.worst
        )
    outcome = "FAILED" if verdict.fails else verdict.outcome
    what = f"{verdict.dataset} / {verdict.method}: {column.metric} ({column.variant})"
    say(f"{outcome:8} {what} {said}", _COLOURS[verdict.outcome])
