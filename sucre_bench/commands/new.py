"""`sucre-bench new`: write a plugin to start from, and its test."""

from pathlib import Path
from typing import Any

import click

from sucre_bench.commands.shared_options import KINDS


@click.command()
@click.argument("kind", type=KINDS)
@click.argument("name")
@click.option(
    "--package",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Write a package with this plugin into DIR.",
)
@click.option("--depth", is_flag=True, help="Write a method that needs depth.")
def new(kind: Any, name: str, package: Path | None, depth: bool) -> None:
    """Write a working plugin to start from, and its test.

    \b
    sucre-bench new method warm_up_reds
    sucre-bench new method fade_less --depth
    sucre-bench new metric redness --package ~/my-metrics

    In a checkout of sucre_bench, the files go into methods/, datasets/ or metrics/, and into the same folder of tests/.
    Elsewhere they go into the current folder. The command overwrites nothing.
    """
    from sucre_bench.programs.contract.write_plugin import shown_path, write_new

    if depth and kind != "method":
        raise click.UsageError("--depth is for methods; see sucre-bench new --help")
    written = write_new(kind, name, Path.cwd(), package, depth)
    for path in written.files:
        click.echo(f"{'wrote':8} {shown_path(path)}")
    for what, command in written.commands:
        click.echo(f"{what:8} {command}")
