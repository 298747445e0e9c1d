"""`sucre-bench score`: score a folder of images, and find the variants that give published numbers."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table

from sucre_bench.commands import completion, shared
from sucre_bench.machine import progress, terminal
from sucre_bench.machine.files import check_output, write_atomically
from sucre_bench.machine.terminal import say

if TYPE_CHECKING:
    import pandas as pd

    from sucre_bench.programs.match_published import PublishedTable
    from sucre_bench.programs.score_folder import FolderScores

_MOST_VARIANTS = 10  # that a table shows


@click.command()
@shared.argument("images")
@shared.path_option(
    "--reference",
    help="Folder of images with the same names (any suffix), or one image.",
)
@shared.option(
    "--metrics",
    default="",
    metavar="A,B",
    shell_complete=completion.complete_metrics,
    help="Metrics: name, name:variant or name:all. Default: all that apply.",
)
@shared.option(
    "--like",
    metavar="TABLE.csv|METRIC=NUMBER,...",
    help="Say what these published numbers are: means, or a table of one row an image or folder, one column a metric.",
)
@shared.json_option
@shared.path_option("--csv", "file", help="Also write every score to this CSV file.")
@shared.plugin_option
@shared.force_option
def score(
    images: Path,
    reference: Path | None,
    metrics: str,
    like: str | None,
    as_json: bool,
    file: Path | None,
    force: bool,
) -> None:
    """Score a folder of images, or one image, with any metric in any published variant.

    \b
    sucre-bench score restored/
    sucre-bench score restored/ --reference truth/ --metrics psnr,ssim:all
    sucre-bench score restored/ --metrics uciqe:all,uiqm:all --csv scores.csv
    sucre-bench score a.png --json | jq '.[] | {metric, variant, value}'
    sucre-bench score restored/ --reference truth/ --like psnr=26.36,ssim=0.912
    sucre-bench score restored/ --like published.csv

    --like computes every variant of these metrics, also at 256x256 pixels; where none fits, also Y, cropped edges and
    other ranges. Then it prints which variant, size and test set give the published numbers, in a sentence.

    The command scores every pixel, black ones too. `sucre-bench run` leaves out pixels that have no colour.
    """
    from sucre_bench.imaging.image_files import image_size
    from sucre_bench.programs import match_published, score_folder
    from sucre_bench.results.rows import csv_text

    if file:
        check_output(file, "table", [Path(like)] if like else (), force)
    names = [name.strip() for name in metrics.split(",") if name.strip()]
    published = None
    sizes = set[tuple[int, int] | None]()
    if like:
        files = score_folder.images_in(images)
        published = match_published.read_table(like, images, files, reference is not None)
        every = [*files.values()]
        if reference:
            every += score_folder.images_in(reference).values()
        sizes = {image_size(path) for path in every}
        for warning in published.warnings:
            say(warning, "yellow")
    # What a metric prints is not part of the table.
    with contextlib.redirect_stdout(sys.stderr), progress.live():
        found: list[FolderScores] = []

        def score_rows(names: Sequence[str]) -> pd.DataFrame:
            found.append(
                score_folder.score_folder(images, reference, names, is_known=bool(found))
            )
            return found[-1].rows

        searched = None if metrics else published
        rows = (
            match_published.search(searched, sizes, score_rows)
            if searched
            else score_rows(names)
        )
    scored = replace(found[0], rows=rows)
    for one in scored.sets:
        say(f"set  {one.sentence()}", "dim")
    if file:
        write_atomically(file, csv_text(rows, for_spreadsheets=True).encode())
    if published:
        _print_matches(published, scored, sizes.pop() if len(sizes) == 1 else None, as_json)
    elif as_json:
        shared.print_json(rows.to_dict("records"))
    elif (rows["status"] == "ok").any():
        terminal.out.print(_summary(rows))
    faults = rows[rows["status"] != "ok"]
    # by default, what does not apply is no fault
    asked = faults if metrics else faults[faults["status"] == "failed"]
    _say_faults(asked)
    sys.exit(1 if len(asked) else 0)


def _say_faults(asked: pd.DataFrame) -> None:
    """Print a line for each metric that lacks something, and for each other fault. asked: rows without a score."""
    from sucre_bench.results.reasons import Reason, needs_of, without_view
    from sucre_bench.results.rows import RESTORATION

    is_lack = Reason.among(asked["reason"], Reason.LACK)
    needs = asked["reason"].map(needs_of)
    for (metric, lack), _ in asked[is_lack].groupby(["metric", needs], sort=False):
        remedy = "`sucre-bench run` scores it, on a dataset that has this"
        if lack == ("reference",):
            remedy = "give --reference DIR"
        say(f"failed  {metric}: needs {' and '.join(lack)}; {remedy}", "red")
    for (view, metric, reason), _ in asked[~is_lack].groupby(
        ["view", "metric", "reason"], sort=False
    ):
        say(
            f"failed  {view}: {f'{metric}: ' if metric != RESTORATION else ''}{without_view(reason, view)}",
            "red",
        )


def _summary(rows: pd.DataFrame) -> Table:
    """A line a metric and variant, for the terminal: mean and spread over the images."""
    from sucre_bench.compare.statistics import standard_deviation
    from sucre_bench.compare.words import ARROW, number

    table = terminal.table(["metric", "variant"], ["mean", "std", "images"])
    ok = rows[rows["status"] == "ok"]
    for (metric, variant), scores in ok.groupby(["metric", "variant"], sort=False):
        values = scores["value"].to_numpy()
        title = f"{metric} {ARROW[scores['better'].iloc[0]]}"
        std = number(float(standard_deviation(values)))
        table.add_row(title, variant, number(values.mean()), std, str(len(values)))
    return table


def _print_matches(
    published: PublishedTable, scored: FolderScores, size: tuple[int, int] | None, as_json: bool
) -> None:
    """Print, for each column of a published table, how far the variants are from it, and the answer in a sentence."""
    from sucre_bench.programs.match_published import answer, compare

    matches = [(column, compare(column, scored.rows)) for column in published.columns]
    if as_json:
        shared.print_json(
            [
                {"column": column.header, "metric": column.metric, **asdict(one)}
                for column, found in matches
                for one in found
            ]
        )
        return
    for column, found in matches:
        table = terminal.table([column.metric], ["mean difference", "largest"])
        table.add_column("at", no_wrap=True)
        table.add_column("compared", justify="right", no_wrap=True)
        table.add_column("", no_wrap=True)
        for one in found[:_MOST_VARIANTS]:
            table.add_row(
                one.variant,
                f"{one.mean:.2g}",
                f"{one.largest:.2g}",
                one.at,
                str(one.compared),
                f"no score of {one.lacking}" if one.lacking else "",
                style="green" if one.fits else None,
            )
        terminal.out.print(table)
        terminal.out.print()
    for column, found in matches:
        terminal.show(answer(column, found, scored.sets, size))
