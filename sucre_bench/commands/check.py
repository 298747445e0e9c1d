"""`sucre-bench check`: test a plugin against the contract."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import click

from sucre_bench.commands.completion_words import complete_words
from sucre_bench.commands.shared_options import KINDS, json_option, print_json, refuse_options

if TYPE_CHECKING:
    from sucre_bench.programs.contract.contract import Outcome, Subject


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("plugin")
@click.argument("overrides", nargs=-1, type=click.UNPROCESSED, shell_complete=complete_words)
@click.option("--kind", type=KINDS, help="Needed if plugins of two kinds have this name.")
@click.option(
    "--on", default="demo", show_default=True, metavar="DATASET", help="Dataset of the real view in the last rule."
)
@click.option("--quick", is_flag=True, help="Leave out rules that start processes or make scenes.")
@json_option
def check(plugin: str, overrides: tuple[str, ...], kind: Any, on: str, quick: bool, as_json: bool) -> None:
    """Check whether a plugin keeps the contract, and say what to change.

    \b
    sucre-bench check gray_world
    sucre-bench check my_method.py
    sucre-bench check my_method.py method.factor=0.3 --json
    sucre-bench check colmap dataset.root=dive/

    PLUGIN is a name, or a .py file with plugins. Options follow as in `sucre-bench run`: method.NAME=VALUE,
    dataset.NAME=VALUE, metrics.METRIC.NAME=VALUE.

    Exit codes: 0, the plugin keeps every rule; 1, it breaks a rule; 2, the command has a mistake.
    """
    from sucre_bench.machine import terminal
    from sucre_bench.programs.contract import contract, outcome_text
    from sucre_bench.programs.contract.subjects import subjects

    refuse_options(overrides, "check")
    checked: list[tuple[Subject, list[Outcome]]] = []
    for subject in subjects(plugin, overrides, kind, on):
        if not as_json:
            terminal.out.print(outcome_text.title(subject), soft_wrap=True)
        outcomes: list[Outcome] = []
        for outcome in contract.check(subject, contract.rules(subject.plugin, lasting=not quick)):
            outcomes.append(outcome)
            for line in () if as_json else outcome_text.lines(outcome, terminal.out.encoding):
                terminal.out.print(line, soft_wrap=True)
        if not as_json:
            terminal.out.print(outcome_text.summary(outcomes), soft_wrap=True)
        checked.append((subject, outcomes))
    if as_json:
        print_json([outcome_text.as_object(subject, outcomes) for subject, outcomes in checked])
    sys.exit(1 if any(outcome.status == "broken" for _, outcomes in checked for outcome in outcomes) else 0)
