"""`sucre-bench track`: log a results folder in mlflow."""

import sys
from pathlib import Path

import click

from sucre_bench.machine.plural import counted


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--uri", default="", metavar="URI", help="mlflow's tracking URI [default: a store in FOLDER].")
@click.option("--experiment", default="sucre_bench", show_default=True, help="Name of the experiment in mlflow.")
@click.option("--ui", is_flag=True, help="Then serve mlflow's page on this machine until Ctrl-C.")
@click.option("--port", default=5000, show_default=True, type=click.IntRange(1, 65535), help="Port of that page.")
def track(folder: Path, uri: str, experiment: str, ui: bool, port: int) -> None:
    """Log a results folder in mlflow, for example after a run on a cluster.

    \b
    sucre-bench track results --uri http://127.0.0.1:5000
    sucre-bench track results --ui

    The command logs only rows that mlflow does not have yet.
    """
    from sucre_bench import compare, results
    from sucre_bench.machine import progress_display
    from sucre_bench.machine.records import masked
    from sucre_bench.reports import mlflow
    from sucre_bench.results.common_scores import read_common

    uri = uri or mlflow.default_uri(folder)
    is_server = uri.startswith(("http://", "https://"))
    if ui and not is_server:
        mlflow.check_port(port)
    rows = results.read(folder)
    comparisons = compare.compare(compare.on_pixels(rows, read_common(folder)))
    with progress_display.live():
        new = mlflow.log(folder, rows, comparisons, uri, experiment)
    page = mlflow.runs_page(uri, experiment, port) if ui else ""
    click.echo(f"mlflow   {masked(uri)}, experiment {experiment}: {counted(new, 'new run')}")
    if ui and is_server:
        click.echo(f"page     {masked(page)}")
    elif ui:
        click.echo("page     starting, about 10 s")
        sys.exit(mlflow.open_ui(uri, port, lambda: click.echo(f"page     {page}  (Ctrl-C ends it)")))
