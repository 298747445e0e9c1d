"""`sucre-bench check`: test a plugin against the contract."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from sucre_bench.commands.completion_words import complete_words
from sucre_bench.commands.shared_options import KINDS, json_option, print_json, refuse_options

if TYPE_CHECKING:
    from rich.text import Text

    from sucre_bench.programs.contract.contract import Outcome, Status


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
    from rich.text import Text

    from sucre_bench.machine import terminal
    from sucre_bench.programs.contract import contract
    from sucre_bench.programs.contract.write_plugin import shown_path

    refuse_options(overrides, "check")
    checked: list[dict[str, Any]] = []
    for subject in contract.subjects(plugin, overrides, kind, on):
        about = {"kind": subject.plugin.kind, "name": subject.plugin.name, "file": str(subject.file)}
        if not as_json:
            title = Text.assemble((f"{about['kind']} {about['name']}", "bold"), f"  {shown_path(subject.file)}")
            terminal.out.print(title, soft_wrap=True)
        outcomes: list[Outcome] = []
        for outcome in contract.check(subject, lasting=not quick):
            outcomes.append(outcome)
            for line in () if as_json else _lines(outcome):
                terminal.out.print(line, soft_wrap=True)
        if not as_json:
            terminal.out.print(_counts(outcomes), soft_wrap=True)
        is_kept = all(outcome.status != "broken" for outcome in outcomes)
        checked.append({**about, "ok": is_kept, "rules": [_as_object(outcome) for outcome in outcomes]})
    if as_json:
        print_json(checked)
    sys.exit(0 if all(one["ok"] for one in checked) else 1)


# Sign, colour and name of a status.
_SIGNS: dict[Status, tuple[str, str, str]] = {
    "kept": ("✓", "green", "kept"),
    "broken": ("✗", "red", "to mend"),
    "doubtful": ("!", "yellow", "to look at"),
    "skipped": ("-", "dim", "not looked at"),
}


def _lines(outcome: Outcome) -> list[Text]:
    """Return a rule's line and its findings."""
    from rich.text import Text

    sign, style, _ = _SIGNS[outcome.status]
    notes = [finding.text for finding in outcome.findings if finding.level == "note"]
    said = f"  {'; '.join(notes)}" if notes and outcome.status != "broken" else ""
    said += f"  {outcome.skipped}" if outcome.skipped else ""
    head = Text.assemble((f"  {sign} ", style), outcome.rule, (said, "dim"))
    return [head, *(Text(f"      {f.text}", style) for f in outcome.findings if f.level != "note")]


def _counts(outcomes: Sequence[Outcome]) -> Text:
    """Return the number of outcomes by status, and the time."""
    from rich.text import Text

    counts = Counter(outcome.status for outcome in outcomes)
    parts = [Text(f"{counts[status]} {name}", style) for status, (_, style, name) in _SIGNS.items() if counts[status]]
    return Text.assemble("  ", Text(", ").join(parts), f" in {sum(o.seconds for o in outcomes):.1f} s")


def _as_object(outcome: Outcome) -> dict[str, Any]:
    """Return the outcome of a rule as plain data for JSON."""
    return {
        "name": outcome.name,
        "rule": outcome.rule,
        "status": outcome.status,
        "seconds": round(outcome.seconds, 3),
        **({"skipped": outcome.skipped} if outcome.skipped else {}),
        "findings": [finding._asdict() for finding in outcome.findings],
    }
