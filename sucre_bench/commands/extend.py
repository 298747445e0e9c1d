"""`sucre-bench list`, `new` and `check`: plugins that are there, a new one, and whether one keeps the contract."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.text import Text

from sucre_bench import plugins
from sucre_bench.commands import shared
from sucre_bench.commands.completion import complete_words
from sucre_bench.degrade import Degradation
from sucre_bench.jobs.catalogue import GROUPS, entry, option_entry, preset_entries
from sucre_bench.machine import terminal
from sucre_bench.plugins.options import Option, options_of
from sucre_bench.plugins.plugin import Broken, Plugin

if TYPE_CHECKING:
    from sucre_bench.programs.contract.contract import Outcome, Status


_Item = Plugin | Broken | Option | dict[str, Any]  # the last of conf/: a preset


@click.command("list")
@click.argument(
    "what",
    type=click.Choice(["methods", "datasets", "metrics", "experiments", "degradations", "sets"]),
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
    known: list[tuple[str, _Item]]
    if what == "degradations":
        known = [(option.name, option) for option in options_of(Degradation)]
    elif what == "sets":
        from sucre_bench.loading.named_sets import named_sets

        known = [(one.name, one.as_object()) for one in named_sets().values()]
    else:
        kind = next((kind for kind in plugins.KINDS if what == f"{kind}s"), None)
        known = [*(plugins.discover(kind).items() if kind else ())]
        known += [
            (str(preset["name"]), preset)
            for preset in preset_entries(GROUPS[kind] if kind else what[:-1])
        ]
    every = [name for name, _ in known]
    for name in names:
        if name not in every:
            raise plugins.unknown(what[:-1], name, every)
    items = [item for name, item in known if not names or name in names]
    if not as_json:
        terminal.show(Text.from_ansi(_as_text(what, items, not names)))
    elif what == "degradations":
        shared.print_json(
            {item.name: option_entry(item) for item in items if isinstance(item, Option)}
        )
    else:
        shared.print_json(
            [entry(item) if isinstance(item, Plugin | Broken) else item for item in items]
        )


def _as_text(what: str, items: Sequence[_Item], is_short: bool) -> str:
    """A line a plugin if is_short; else each with its needs, licence, options and whether it can run here.

    Lines are wrapped to the terminal, in colour.
    """
    if what == "experiments":
        return "\n".join(
            f"{item['name']}  {item['description']}" for item in items if isinstance(item, dict)
        )
    if what == "degradations":
        return "\n".join(
            line for item in items if isinstance(item, Option) for line in _option_lines(item)
        )
    if is_short and what != "sets":
        lines = [_line(item, max(len(_name(each)) for each in items)) for item in items]
        return "\n".join([*lines, "", f"options and publication: sucre-bench list {what} NAME"])
    texts = []
    for item in items:
        if isinstance(item, dict):
            about = (
                ("description", "recognised", "source", "licence", "used_by")
                if what == "sets"
                else ("description",)
            )
            texts.append(
                "\n".join(
                    [
                        click.style(item["name"], bold=True),
                        *(x for key in about for x in _wrapped("", item[key])),
                    ]
                )
            )
        elif isinstance(item, Plugin | Broken):
            texts.append(_entry(item))
    if what == "metrics":
        texts.append("metric:variant, * computed unless others are asked for")
    return "\n\n".join(texts) or f"no {what}"


def _name(item: _Item) -> str:
    return str(item["name"]) if isinstance(item, dict) else item.name


def _line(item: _Item, width: int) -> str:
    """A name with the first words about it, or why it cannot be used. width: of the longest name."""
    said = item["description"] if isinstance(item, dict) else ""
    lack = ""
    if isinstance(item, Broken):
        lack = f"cannot be used: {item.reason}"
    elif isinstance(item, Plugin):
        said = item.summary
        install = entry(item)["install"]
        if install:
            lack = f"not installed: {install}"
    name = f"{_name(item):{width}}  "
    if lack:
        return click.style(name + lack, fg="red")
    room = max(60, shutil.get_terminal_size().columns) - len(name)
    return click.style(name, bold=True) + textwrap.shorten(said, room, placeholder=" …")


def _entry(plugin: Plugin | Broken) -> str:
    if isinstance(plugin, Broken):
        return click.style(f"{plugin.name}  cannot be used: {plugin.reason}", fg="red")
    about = entry(plugin)
    lines = [click.style(plugin.name, bold=True)]
    if about["install"]:
        lines[0] += click.style(f"  not installed: {about['install']}", fg="red")
    lines += _wrapped("", plugin.summary)
    if plugin.kind == "metric":
        direction = "describes" if plugin.better == "none" else f"{plugin.better} is better"
        lines += _wrapped("", f"{direction}{', in ' + plugin.unit if plugin.unit else ''}")
    if plugin.opinions:
        about["opinions"] = ", ".join(
            f"{study}: {score:g}" for study, score in plugin.opinions.items()
        )
    for key in (
        "needs",
        "has",
        "signs",
        "source",
        "proven",
        "licence",
        "cites",
        "differs",
        "opinions",
    ):
        text = ", ".join(about[key]) if key in ("needs", "has", "signs") else about.get(key, "")
        lines += _wrapped(f"{'known by' if key == 'signs' else key}  ", text) if text else []
    for name, said in plugin.variants.items():
        lines += _wrapped(f"{plugin.name}:{name}{'*' if name in plugin.default else ''}  ", said)
    for option in options_of(plugin.cls):
        lines += _option_lines(option)
    return "\n".join(lines)


def _option_lines(option: Option) -> list[str]:
    words = [*option.choices, *([] if option.is_closed else ["..."])]
    choices = f" ({'|'.join(words)})" if option.choices else ""
    default = (
        "" if option.is_required else f"={'none' if option.default is None else option.default}"
    )
    return _wrapped(f"{option.name}{default}{choices}  ", option.help)


def _wrapped(head: str, text: str) -> list[str]:
    width = max(60, shutil.get_terminal_size().columns)
    return textwrap.wrap(head + text, width, initial_indent="    ", subsequent_indent="        ")


@click.command()
@shared.argument("kind", of=shared.KINDS)
@shared.argument("name", of=None)
@shared.option(
    "--package",
    of=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Write a package with this plugin into DIR.",
)
@shared.flag("--depth", help="Write a method that needs depth.")
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
        raise click.UsageError("--depth is for methods")
    written = write_new(kind, name, Path.cwd(), package, depth)
    for path in written.files:
        click.echo(f"{'wrote':8} {shown_path(path)}")
    for what, command in written.commands:
        click.echo(f"{what:8} {command}")


@click.command()
@shared.argument("plugin", of=None)
@shared.words_argument("overrides", None, complete_words)
@shared.option("--kind", of=shared.KINDS, help="Needed if plugins of two kinds have this name.")
@shared.option(
    "--on", default="demo", metavar="DATASET", help="Dataset of the real view in the last rule."
)
@shared.flag("--quick", help="Leave out rules that start processes or make scenes.")
@shared.json_option
def check(
    plugin: str, overrides: tuple[str, ...], kind: Any, on: str, quick: bool, as_json: bool
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
    for subject in contract.subjects(plugin, overrides, kind, on):
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
            notes = [
                text
                for level, text in outcome.findings
                if level == "note" and outcome.status != "broken"
            ]
            said = "".join(f"  {text}" for text in ("; ".join(notes), outcome.skipped) if text)
            show((f"  {sign} ", style), outcome.rule, (said, "dim"))
            for level, text in outcome.findings:
                if level != "note":
                    show(f"      {text}", style=style)
        counts = Counter(outcome.status for outcome in outcomes)
        parts = [
            Text(f"{counts[status]} {name}", style)
            for status, (_, style, name) in _SIGNS.items()
            if counts[status]
        ]
        show(
            "  ",
            Text(", ").join(parts),
            f" in {sum(outcome.seconds for outcome in outcomes):.1f} s",
        )
        rules = [
            {name: value for name, value in outcome._asdict().items() if value != ""}
            | {"status": outcome.status, "seconds": round(outcome.seconds, 3)}
            | {"findings": [finding._asdict() for finding in outcome.findings]}
            for outcome in outcomes
        ]
        is_kept = all(outcome.status != "broken" for outcome in outcomes)
        checked.append({**about, "ok": is_kept, "rules": rules})
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
