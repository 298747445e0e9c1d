"""`sucre-bench report` and `track`: results as a page, and in mlflow."""

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
    from sucre_bench import compare
    from sucre_bench.reports import page
    from sucre_bench.results.table import read_both

    check_links(folder)
    rows, common = read_both(folder)
    rows = compare.on_pixels(rows, common)
    click.echo(page.write(folder, rows, compare.compare(rows)))


@click.command()
@shared.argument("folder")
@shared.option(
    "--uri",
    default="",
    metavar="URI",
    help="mlflow's tracking URI [default: a store in FOLDER].",
)
@shared.option(
    "--experiment", default="", help="Name of the experiment in mlflow [default: sucre_bench]."
)
def track(folder: Path, uri: str, experiment: str) -> None:
    """Log in mlflow what it lacks of a results folder, for example after a run without its server.

    \b
    sucre-bench track results --uri http://127.0.0.1:5000

    MLFLOW_TRACKING_URI and MLFLOW_EXPERIMENT_NAME are the defaults where they are set.
    """
    from sucre_bench.machine.provenance import require
    from sucre_bench.machine.text_formats import masked
    from sucre_bench.reports.mlflow.runs import log
    from sucre_bench.reports.mlflow.store import Place

    require("track", "mlflow")
    place = Place.of(folder, uri, experiment)
    check_links(folder)
    with progress.live():
        new = log(folder, place)
    where = f"{masked(place.uri)}, experiment {place.experiment}"
    click.echo(f"mlflow   {where}: {counted(new, 'new run')}")
    click.echo(f"to look  {place.how_to_look}")
