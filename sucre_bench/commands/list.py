"""`sucre-bench list`: plugins, experiments and degradations, as text and as JSON."""

import shutil
import textwrap
from collections.abc import Sequence
from dataclasses import MISSING
from typing import Any

import click

from sucre_bench import plugins
from sucre_bench.commands.shared_options import json_option, plugin_option, print_json
from sucre_bench.degrade import Degradation
from sucre_bench.jobs.catalogue import entry, option_entry, preset_entries
from sucre_bench.plugins.options import Option, options_of
from sucre_bench.plugins.plugin import Broken, Plugin


@click.command("list")
@click.argument("what", type=click.Choice(["methods", "datasets", "metrics", "experiments", "degradations"]))
@click.argument("names", nargs=-1, metavar="[NAME]...")
@json_option
@plugin_option
def list_(what: str, names: tuple[str, ...], as_json: bool) -> None:
    """List plugins, experiments or degradations, with their options, and whether they run here.

    \b
    sucre-bench list methods
    sucre-bench list methods sucre
    sucre-bench list metrics --plugin my_metric.py
    sucre-bench list experiments
    sucre-bench list methods --json | jq -r '.[] | select(.installed) | .name'

    With NAME, list prints only this one.
    """
    from rich.text import Text

    from sucre_bench.machine import terminal

    items = _named(what, names)
    if as_json:
        print_json(_plain(what, items))
    elif terminal.has_styles():
        terminal.out.print(Text.from_ansi(_as_text(what, items, colour=True)), soft_wrap=True)
    else:
        click.echo(_as_text(what, items, colour=False))


_Preset = dict[str, Any]
_Item = Plugin | Broken | Option | _Preset


def _named(what: str, names: Sequence[str]) -> list[_Item]:
    """Return what has these names; everything if there are none. Raises InputError for a name that nothing has."""
    known = _everything(what)
    every = [name for name, _ in known]
    for name in names:
        if name not in every:
            raise plugins.unknown(what[:-1], name, every)
    return [item for name, item in known if not names or name in names]


def _everything(what: str) -> list[tuple[str, _Item]]:
    if what == "degradations":
        return [(option.name, option) for option in options_of(Degradation)]
    presets = [(str(preset["name"]), preset) for preset in preset_entries(what[:-1])]
    kind = next((kind for kind in plugins.KINDS if what == f"{kind}s"), None)
    return [*(plugins.discover(kind).items() if kind else ()), *presets]


def _plain(what: str, items: Sequence[_Item]) -> Any:
    """Everything that is known of each plugin, or the experiments, as a list; of degradations by name."""
    if what == "degradations":
        return {o.name: option_entry(o) for o in items if isinstance(o, Option)}
    return [entry(i) if isinstance(i, Plugin | Broken) else i for i in items]


def _as_text(what: str, items: Sequence[_Item], colour: bool) -> str:
    """Each with its needs, licence, options and whether it can run here, wrapped to the terminal."""
    texts = [_text(what, item, colour) for item in items]
    if what in ("experiments", "degradations"):
        return "\n".join(texts)
    if what == "metrics":
        texts.append("metric:variant, * computed unless others are asked for")
    return "\n\n".join(texts) or f"no {what}"


def _text(what: str, item: _Item, colour: bool) -> str:
    if isinstance(item, Option):
        return "\n".join(_option_lines(item))
    if isinstance(item, Plugin | Broken):
        return _entry(item, colour)
    if what == "experiments":
        return f"{item['name']}  {item['description']}"
    return "\n".join([_styled(item["name"], colour, bold=True), *_wrapped("", item["description"])])


def _entry(plugin: Plugin | Broken, colour: bool) -> str:
    if isinstance(plugin, Broken):
        return _styled(f"{plugin.name}  cannot be used: {plugin.reason}", colour, fg="red")
    about, lines = entry(plugin), [_styled(plugin.name, colour, bold=True)]
    if about["install"]:
        lines[0] += _styled(f"  not installed: {about['install']}", colour, fg="red")
    lines += _wrapped("", plugin.summary)
    if plugin.kind == "metric":
        direction = "describes" if plugin.better == "none" else f"{plugin.better} is better"
        lines += _wrapped("", f"{direction}{', in ' + plugin.unit if plugin.unit else ''}")
    for key in ("needs", "has", "signs", "source", "licence", "cites"):
        text = ", ".join(about[key]) if key in ("needs", "has", "signs") else about[key]
        lines += _wrapped(f"{'known by' if key == 'signs' else key}  ", text) if text else []
    for name, said in plugin.variants.items():
        lines += _wrapped(f"{plugin.name}:{name}{'*' if name in plugin.default else ''}  ", said)
    for option in options_of(plugin.cls):
        lines += _option_lines(option)
    return "\n".join(lines)


def _styled(text: str, colour: bool, **style: Any) -> str:
    return click.style(text, **style) if colour else text


def _option_lines(option: Option) -> list[str]:
    words = [*option.choices, *([] if option.is_closed else ["..."])]
    choices = f" ({'|'.join(words)})" if option.choices else ""
    default = "" if option.default is MISSING else f"={'none' if option.default is None else option.default}"
    return _wrapped(f"{option.name}{default}{choices}  ", option.help)


def _wrapped(head: str, text: str) -> list[str]:
    width = max(60, shutil.get_terminal_size().columns)
    return textwrap.wrap(head + text, width, initial_indent="    ", subsequent_indent="        ")
