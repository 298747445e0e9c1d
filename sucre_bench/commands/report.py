"""`sucre-bench report`: write the page of a results folder."""

from pathlib import Path

import click


@click.command("report")
@click.argument("folder", type=click.Path(path_type=Path))
def report(folder: Path) -> None:
    """Write the page of a results folder: FOLDER/report/index.html.

    \b
    sucre-bench report results

    The page has tables, plots and pictures. It opens from disk, without a network.
    """
    from sucre_bench import compare, results
    from sucre_bench.reports import page
    from sucre_bench.results.common_scores import read_common

    rows = compare.on_pixels(results.read(folder), read_common(folder))
    click.echo(page.write(folder, rows, compare.compare(rows)))
