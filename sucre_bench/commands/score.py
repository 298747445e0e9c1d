"""`sucre-bench score`: score a folder of images."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path

import click

from sucre_bench.commands import complete
from sucre_bench.commands.common import load_plugins, plugin_option, say

__all__ = ["score"]


@click.command()
@click.argument("images", type=click.Path(path_type=Path))
@click.option("--reference", type=click.Path(path_type=Path), help="Folder with the same names, or one image.")
@click.option(
    "--metrics",
    default="",
    metavar="A,B",
    shell_complete=complete.complete_metrics,
    help="Names, name:variant or name:all; default all that apply.",
)
@click.option("--format", "how", type=click.Choice(["terminal", "csv", "json"]), default="terminal", show_default=True)
@click.option("--json", "as_json", is_flag=True, help="The same as --format json.")
@click.option("--csv", "file", type=click.Path(path_type=Path), help="Also write every score to this CSV file.")
@plugin_option
def score(
    images: Path,
    reference: Path | None,
    metrics: str,
    how: str,
    as_json: bool,
    file: Path | None,
    plugin_files: tuple[str, ...],
) -> None:
    """Score a folder of images (or one image) with any metric, in any published variant.

    \b
    sucre-bench score restored/
    sucre-bench score restored/ --reference truth/ --metrics psnr,ssim:all
    sucre-bench score restored/ --metrics uciqe:all,uiqm:all --csv scores.csv
    sucre-bench score a.png --json | jq '.[] | {metric, variant, value}'

    A folder knows no holes: what is black counts as picture. `sucre-bench run` scores only pixels that have a colour.
    """
    from sucre_bench.machine import terminal
    from sucre_bench.machine.files import write_atomically
    from sucre_bench.programs import score_folder

    load_plugins(plugin_files)
    with contextlib.redirect_stdout(sys.stderr), terminal.live():  # what a metric prints is no part of the table
        rows = score_folder.score_folder(images, reference, [m.strip() for m in metrics.split(",") if m.strip()])
    if file:
        write_atomically(file, rows.to_csv(index=False).encode())
    if how == "csv" and not as_json:
        click.echo(rows.to_csv(index=False), nl=False)
    elif as_json or how == "json":
        click.echo(rows.to_json(orient="records", indent=1))
    else:
        terminal.out.print(score_folder.summary(rows))
    faults = rows[rows["status"] != "ok"]
    asked = faults if metrics else faults[faults["status"] == "failed"]  # unasked, what does not apply is no fault
    for (view, metric, reason), _ in asked.groupby(["view", "metric", "reason"], sort=False):
        say(f"failed  {view}: {f'{metric}: ' if metric != 'seconds' else ''}{reason}", "red")
    sys.exit(1 if len(asked) else 0)
