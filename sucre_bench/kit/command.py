"""The commands `sucre-bench new` and `sucre-bench check`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sucre_bench.completion import complete_words

if TYPE_CHECKING:
    from sucre_bench.kit.contract import Outcome, Subject

__all__ = ["check", "new"]

_KINDS = click.Choice(["method", "dataset", "metric"])  # as in `plugins.KINDS`, which would bring numpy to every --help


@click.command(short_help="A plugin to start from, and its test.")
@click.argument("kind", type=_KINDS)
@click.argument("name")
@click.option(
    "--package", type=click.Path(path_type=Path, file_okay=False), metavar="DIR", help="Make a package of it there."
)
@click.option("--depth", is_flag=True, help="A method that needs depth, and leaves holes where there is none.")
def new(kind: Any, name: str, package: Path | None, depth: bool) -> None:
    """Write a plugin to start from, which works as it is, and its test.

    \b
    sucre-bench new method warm_up_reds
    sucre-bench new method fade_less --depth
    sucre-bench new metric redness --package ~/my-metrics

    In a checkout of sucre_bench the files go into methods/, datasets/ or metrics/, and tests/; elsewhere into the
    current folder. Nothing is overwritten.
    """
    from sucre_bench.kit.new import write_new
    from sucre_bench.kit.report import shown_path

    if depth and kind != "method":
        raise click.UsageError("--depth is for methods; see sucre-bench new --help")
    written = write_new(kind, name, Path.cwd(), package, depth)
    for path in written.files:
        click.echo(f"{'wrote':8} {shown_path(path)}")
    for what, command in written.commands:
        click.echo(f"{what:8} {command}")


@click.command(
    short_help="Does a plugin keep the contract? What to mend.", context_settings={"ignore_unknown_options": True}
)
@click.argument("plugin")
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED, shell_complete=complete_words)
@click.option("--kind", type=_KINDS, help="Where plugins of two kinds have the name.")
@click.option("--on", default="demo", show_default=True, metavar="DATASET", help="What a method is tried on at last.")
@click.option("--quick", is_flag=True, help="Leave out what starts processes or makes scenes.")
@click.option("--json", "as_json", is_flag=True, help="For programs.")
def check(plugin: str, overrides: tuple[str, ...], kind: Any, on: str, quick: bool, as_json: bool) -> None:
    """Say whether a plugin keeps the contract, and what to do where it does not.

    \b
    sucre-bench check gray_world
    sucre-bench check my_method.py
    sucre-bench check my_method.py method.factor=0.3 --json
    sucre-bench check colmap dataset.root=dive/

    PLUGIN is a name, or a .py file with plugins. Options follow as in `sucre-bench run`: method.NAME=VALUE,
    dataset.NAME=VALUE, metrics.METRIC.NAME=VALUE. The exit code is 1 where something must be mended.
    """
    from sucre_bench import console
    from sucre_bench.kit import contract, report
    from sucre_bench.kit.choose import subjects

    stray = [word for word in overrides if word.startswith("-")]
    if stray:
        raise click.UsageError(f"no option {stray[0]}; see sucre-bench check --help")
    checked: list[tuple[Subject, list[Outcome]]] = []
    for subject in subjects(plugin, overrides, kind, on):
        if not as_json:
            console.out.print(report.title(subject), soft_wrap=True)
        outcomes: list[Outcome] = []
        for outcome in contract.check(subject, contract.rules(subject.plugin, lasting=not quick)):
            outcomes.append(outcome)
            for line in () if as_json else report.lines(outcome, console.out.encoding):
                console.out.print(line, soft_wrap=True)
        if not as_json:
            console.out.print(report.summary(outcomes), soft_wrap=True)
        checked.append((subject, outcomes))
    if as_json:
        click.echo(report.as_json(checked))
    sys.exit(1 if any(outcome.status == "broken" for _, outcomes in checked for outcome in outcomes) else 0)
