"""`sucre-bench list`, `new` and `check`: plugins that are there, a new one, and whether one keeps the contract."""

from __future__ import annotations

import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.padding import Padding
from rich.text import Text

from sucre_bench import plugins
from sucre_bench.commands import shared
from sucre_bench.commands.completion import complete_words
from sucre_bench.degrade import Degradation
from sucre_bench.jobs.catalogue import GROUPS, entry, option_entry, preset_entries
from sucre_bench.machine import terminal
from sucre_bench.plugins.options import options_of

if TYPE_CHECKING:
    from sucre_bench.programs.contract.contract import Outcome, Status


@click.command("list")
@click.argument(
    "what",
    type=click.Choice(
        ["methods", "datasets", "metrics", "experiments", "degradations", "sets"]
    ),
)
@click.argument("names", nargs=-1, metavar="[NAME]...")
@shared.json_option
@shared.plugin_option
def list_(what: str, names: tuple[str, ...], as_json: bool) -> None:
    """List plugins with their options and whether they run here, experiments, degradations, or named test sets.

    \b
    sucre-bench list methods
    sucre-bench list methods sucre
    sucre-bench list metrics --plugin my_metric.py
    sucre-bench list experiments
    sucre-bench list sets
    sucre-bench list methods --json | jq -r '.[] | select(.installed) | .name'

    A plugin has a line. With NAME, list prints all of it: needs, options, publication.
    """
    known = _known(what)
    for name in names:
        if name not in known:
            raise plugins.unknown(what[:-1], name, known)
    chosen = {name: about for name, about in known.items() if not names or name in names}
    if as_json:
        shared.print_json(chosen if what == "degradations" else [*chosen.values()])
    elif what == "degradations":
        _print_options(chosen)
    elif what == "sets" or (names and what != "experiments"):
        for about in chosen.values():
            _print_entry(about)
    else:
        width = max(map(len, chosen))
        for name, about in chosen.items():
            _print_line(f"{name:{width}}  ", about)
        if what != "experiments":
            terminal.show(f"\noptions and publication: sucre-bench list {what} NAME")


def _known(what: str) -> dict[str, dict[str, Any]]:
    """What there is, by name, as --json shows it."""
    if what == "degradations":
        return {option.name: option_entry(option) for option in options_of(Degradation)}
    if what == "sets":
        from sucre_bench.loading.named_sets import named_sets

        return {name: one.as_object() for name, one in named_sets().items()}
    kind = next((kind for kind in plugins.KINDS if what == f"{kind}s"), None)
    presets = preset_entries(GROUPS[kind] if kind else what[:-1])
    known = (
        {name: entry(plugin) for name, plugin in plugins.discover(kind).items()} if kind else {}
    )
    for preset in presets:
        known.setdefault(str(preset["name"]), preset)
    return known


def _lack(about: Mapping[str, Any]) -> str:
    """Why a plugin cannot be used here; empty if it can."""
    if "broken" in about:
        return f"cannot be used: {about['broken']}"
    return f"not installed: {about['install']}" if about.get("install") else ""


def _print_line(name: str, about: Mapping[str, Any]) -> None:
    """Print a name with the first words about it, or why it cannot be used."""
    if lack := _lack(about):
        terminal.show(name + lack, style="red")
        return
    room = max(60, terminal.out.width) - len(name)
    said = textwrap.shorten(about["description"], room, placeholder=" …")
    terminal.show((name, "bold"), said)


# What `list NAME` shows of a plugin or a set, below its description.
_SHOWN = (
    "recognised",
    "better",
    "unit",
    "needs",
    "has",
    "signs",
    "source",
    "proven",
    "licence",
    "cites",
    "differs",
    "opinions",
    "used_by",
)


def _print_entry(about: Mapping[str, Any]) -> None:
    """Print all of a plugin, preset or set, a paragraph a fact."""
    terminal.show((about["name"], "bold"), (f"  {_lack(about)}", "red"))
    _print_fact("", about.get("description", ""))
    for key in _SHOWN:
        value = about.get(key, "")
        if isinstance(value, dict):
            value = [f"{study}: {score:g}" for study, score in value.items()]
        text = value if isinstance(value, str) else ", ".join(value)
        if text:
            _print_fact(key.replace("_", " "), text)
    for name, said in about.get("variants", {}).items():
        when = "" if name in about["default"] else " (if asked for)"
        _print_fact(f"{about['name']}:{name}{when}", said)
    _print_options(about.get("options", {}))
    click.echo()


def _print_options(options: Mapping[str, Mapping[str, Any]]) -> None:
    for name, about in options.items():
        words = about.get("choices") or [*about.get("words", ()), "..."]
        choices = f" ({'|'.join(words)})" if len(words) > 1 else ""
        default = "null" if about["default"] is None else about["default"]
        given = "" if default == "must be given" else f"={default}"
        _print_fact(f"{name}{given}{choices}", about.get("help", ""))


def _print_fact(title: str, text: str) -> None:
    said = Text.assemble((f"{title}  " if title else "", "bold"), text)
    terminal.out.print(Padding(said, (0, 0, 0, 4)), soft_wrap=False)


@click.command()
@shared.argument("kind", of=shared.KINDS)
@shared.argument("name", of=None)
@shared.flag("--depth", help="Write a method that needs depth.")
def new(kind: Any, name: str, depth: bool) -> None:
    """Write a working plugin to start from, and its test.

    \b
    sucre-bench new method warm_up_reds
    sucre-bench new method fade_less --depth
    sucre-bench new metric redness

    In a checkout of sucre_bench, the files go into methods/, datasets/ or metrics/, and into the same folder of tests/.
    Elsewhere they go into the current folder. The command overwrites nothing.
    """
    from sucre_bench.programs.contract.write_plugin import shown_path, write_new

    if depth and kind != "method":
        raise click.UsageError("--depth is for methods")
    written = write_new(kind, name, Path.cwd(), depth)
    for path in written.files:
        click.echo(f"{'wrote':8} {shown_path(path)}")
    for what, command in written.commands:
        click.echo(f"{what:8} {command}")


@click.command()
@shared.argument("plugin", of=None)
@shared.words_argument("overrides", None, complete_words)
@shared.option("--kind", of=shared.KINDS, help="Needed if plugins of two kinds have this name.")
@shared.flag("--quick", help="Leave out the rule that starts a process.")
@shared.json_option
def check(
    plugin: str, overrides: tuple[str, ...], kind: Any, quick: bool, as_json: bool
) -> None:
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

    from sucre_bench.programs.contract import contract
    from sucre_bench.programs.contract.write_plugin import shown_path

    checked: list[dict[str, Any]] = []
    show: Callable[..., None] = (lambda *_: None) if as_json else terminal.show
    for subject in contract.subjects(plugin, overrides, kind):
        about = {
            "kind": subject.plugin.kind,
            "name": subject.plugin.name,
            "file": str(subject.file),
        }
        show((f"{about['kind']} {about['name']}", "bold"), f"  {shown_path(subject.file)}")
        outcomes: list[Outcome] = []
        for outcome in contract.check(subject, lasting=not quick):
            outcomes.append(outcome)
            sign, style, _ = _SIGNS[outcome.status]
            said = f"  {outcome.skipped}" if outcome.skipped else ""
            show((f"  {sign} ", style), outcome.rule, (said, "dim"))
            for _, text in outcome.findings:
                show((f"      {text}", style))
        counts = Counter(outcome.status for outcome in outcomes)
        seconds = sum(outcome.seconds for outcome in outcomes)
        words = [f"{counts[key]} {name}" for key, (_, _, name) in _SIGNS.items() if counts[key]]
        show(f"  {', '.join(words)} in {seconds:.1f} s")
        rules = [
            {
                **outcome._asdict(),
                "status": outcome.status,
                "findings": [finding._asdict() for finding in outcome.findings],
            }
            for outcome in outcomes
        ]
        checked.append({**about, "ok": not counts["broken"], "rules": rules})
    if as_json:
        shared.print_json(checked)
    sys.exit(0 if all(one["ok"] for one in checked) else 1)


# Sign, colour and name of a status.
_SIGNS: dict[Status, tuple[str, str, str]] = {
    "kept": ("✓", "green", "kept"),
    "broken": ("✗", "red", "to mend"),
    "doubtful": ("!", "yellow", "to look at"),
    "skipped": ("-", "dim", "not looked at"),
}
