"""`sucre-bench score`: score a folder of images."""

import contextlib
import sys
from pathlib import Path

import click

from sucre_bench.commands import completion_words
from sucre_bench.commands.output_files import check_output
from sucre_bench.commands.shared_options import plugin_option
from sucre_bench.machine.notices import say


@click.command()
@click.argument("images", type=click.Path(path_type=Path))
@click.option(
    "--reference",
    type=click.Path(path_type=Path),
    help="Folder of images with the same names (any suffix), or one image.",
)
@click.option(
    "--metrics",
    default="",
    metavar="A,B",
    shell_complete=completion_words.complete_metrics,
    help="Metrics: name, name:variant or name:all. Default: all that apply.",
)
@click.option(
    "--like",
    type=click.Path(path_type=Path),
    metavar="TABLE.csv",
    help="Find the variants that give these published numbers. One row an image or folder, one column a metric.",
)
@click.option(
    "--format",
    "how",
    type=click.Choice(["terminal", "csv", "json"]),
    default="terminal",
    show_default=True,
    help="Format of the scores.",
)
@click.option("--json", "as_json", is_flag=True, help="The same as --format json.")
@click.option("--csv", "file", type=click.Path(path_type=Path), help="Also write every score to this CSV file.")
@plugin_option
def score(
    images: Path, reference: Path | None, metrics: str, like: Path | None, how: str, as_json: bool, file: Path | None
) -> None:
    """Score a folder of images, or one image, with any metric in any published variant.

    \b
    sucre-bench score restored/
    sucre-bench score restored/ --reference truth/ --metrics psnr,ssim:all
    sucre-bench score restored/ --metrics uciqe:all,uiqm:all --csv scores.csv
    sucre-bench score a.png --json | jq '.[] | {metric, variant, value}'
    sucre-bench score restored/ --like published.csv

    --like computes every variant of the metrics in TABLE.csv, also at 256x256 pixels. Then it prints which variant
    gives the published numbers.

    The command scores every pixel, black ones too. `sucre-bench run` leaves out pixels that have no colour.
    """
    from sucre_bench.commands import score_tables
    from sucre_bench.machine import progress_display, terminal
    from sucre_bench.machine.files import write_atomically
    from sucre_bench.programs import match_published, score_folder
    from sucre_bench.results.reasons import Reason, brief
    from sucre_bench.results.rows import RESTORATION, csv_text

    if file:
        check_output(file, "table", [like] if like else ())
    names = [name.strip() for name in metrics.split(",") if name.strip()]
    published = None
    if like:
        files = score_folder.images_in(images)
        published = match_published.read_table(like, images, files, reference is not None)
        names = names or match_published.variants_to_try(published, files)
        for warning in published.warnings:
            say(warning, "yellow")
    # What a metric prints is not part of the table.
    with contextlib.redirect_stdout(sys.stderr), progress_display.live():
        rows = score_folder.score_folder(images, reference, names)
    if file:
        write_atomically(file, csv_text(rows).encode())
    form = "json" if as_json else how
    if published:
        score_tables.print_matches(published, rows, form)
    elif form != "terminal":
        score_tables.print_records(rows, form)
    elif (rows["status"] == "ok").any():
        terminal.out.print(score_tables.summary(rows))
    faults = rows[rows["status"] != "ok"]
    asked = faults if metrics else faults[faults["status"] == "failed"]  # by default, what does not apply is no fault
    lacks = [text for text in asked["reason"].unique() if Reason.of(text) is Reason.LACK]
    is_lack = asked["reason"].isin(lacks)
    for (metric, lack), _ in asked[is_lack].groupby(["metric", asked["reason"].map(brief)], sort=False):
        is_reference = lack == "needs reference"
        remedy = "give --reference DIR" if is_reference else "`sucre-bench run` scores it, on a dataset that has this"
        say(f"failed  {metric}: {lack}; {remedy}", "red")
    for (view, metric, reason), _ in asked[~is_lack].groupby(["view", "metric", "reason"], sort=False):
        say(f"failed  {view}: {f'{metric}: ' if metric != RESTORATION else ''}{reason}", "red")
    sys.exit(1 if len(asked) else 0)
