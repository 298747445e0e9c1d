"""`sucre-bench report` and `track`: results as a page, and in mlflow."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from sucre_bench.commands import shared
from sucre_bench.machine import progress
from sucre_bench.machine.files import check_links
from sucre_bench.machine.text_formats import counted


@click.command("report")
@shared.argument("folder")
def report(folder: Path) -> None:
    """Write the page of a results folder: FOLDER/report/index.html.

    \b
    sucre-bench report results

    The page has tables, plots and pictures. It opens from disk, without a network.
    """
    from sucre_bench import compare, results
    from sucre_bench.reports import page
    from sucre_bench.results.table import read_common

    check_links(folder)
    rows = compare.on_pixels(results.read(folder), lambda: read_common(folder))
    click.echo(page.write(folder, rows, compare.compare(rows)))


@click.command()
@shared.argument("folder")
@shared.option("--uri", default="", metavar="URI", help="mlflow's tracking URI [default: a store in FOLDER].")
@shared.option("--experiment", default="sucre_bench", help="Name of the experiment in mlflow.")
@shared.flag("--ui", help="Then serve mlflow's page on this machine until Ctrl-C.")
@shared.option("--port", default=5000, of=click.IntRange(1, 65535), help="Port of that page.")
def track(folder: Path, uri: str, experiment: str, ui: bool, port: int) -> None:
    """Log a results folder in mlflow, for example after a run on a cluster.

    \b
    sucre-bench track results --uri http://127.0.0.1:5000
    sucre-bench track results --ui

    The command logs only rows that mlflow does not have yet.
    """
    from sucre_bench import compare, results
    from sucre_bench.machine.provenance import require
    from sucre_bench.machine.text_formats import masked
    from sucre_bench.reports import mlflow
    from sucre_bench.results.table import read_common

    require("track", "mlflow")
    uri = uri or mlflow.default_uri(folder)
    is_server = uri.startswith(("http://", "https://"))
    if ui and not is_server:
        mlflow.check_port(port)
    check_links(folder)
    rows = results.read(folder)
    comparisons = compare.compare(compare.on_pixels(rows, lambda: read_common(folder)))
    with progress.live():
        new = mlflow.log(folder, rows, comparisons, uri, experiment)
    page = mlflow.runs_page(uri, experiment, port) if ui else ""
    click.echo(f"mlflow   {masked(uri)}, experiment {experiment}: {counted(new, 'new run')}")
    if ui and is_server:
        click.echo(f"page     {masked(page)}")
    elif ui:
        click.echo("page     starting, about 10 s")
        sys.exit(mlflow.open_ui(uri, port, lambda: click.echo(f"page     {page}  (Ctrl-C ends it)")))
