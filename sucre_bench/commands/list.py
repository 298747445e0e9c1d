"""`sucre-bench list`: plugins, experiments and degradations, as text and as JSON."""

from __future__ import annotations

import json
import shutil
import textwrap
from dataclasses import MISSING
from typing import Any

import click

from sucre_bench import plugins
from sucre_bench.commands.common import json_option, load_plugins, plugin_option
from sucre_bench.degrade import Degradation
from sucre_bench.jobs.catalogue import entries, entry, option_entry, preset_entries
from sucre_bench.plugins.options import Option, options_of
from sucre_bench.plugins.plugin import Broken, Kind, Plugin

__all__ = ["list_"]


@click.command("list")
@click.argument("what", type=click.Choice(["methods", "datasets", "metrics", "experiments", "degradations"]))
@json_option
@plugin_option
def list_(what: str, as_json: bool, plugin_files: tuple[str, ...]) -> None:
    """List plugins or experiments with their needs and options, and whether they run here.

    \b
    sucre-bench list methods
    sucre-bench list metrics --plugin my_metric.py
    sucre-bench list experiments
    sucre-bench list methods --json | jq -r '.[] | select(.installed) | .name'
    """
    from rich.text import Text

    from sucre_bench.machine import terminal

    load_plugins(plugin_files)
    if as_json:
        click.echo(_as_json(what))
    elif terminal.has_styles():
        terminal.out.print(Text.from_ansi(_as_text(what, colour=True)), soft_wrap=True)
    else:
        click.echo(_as_text(what, colour=False))


def _as_json(what: str) -> str:
    """Everything that is known of each plugin, or the experiments, as a JSON array."""
    if what == "degradations":
        return json.dumps({o.name: option_entry(o) for o in options_of(Degradation)}, indent=1)
    if what == "experiments":
        return json.dumps(preset_entries("experiment"), indent=1)
    kind = _kind(what)
    return json.dumps(entries(kind), indent=1)


def _as_text(what: str, colour: bool) -> str:
    """Each with its needs, licence, options and whether it can run here, wrapped to the terminal."""
    if what == "experiments":
        return "\n".join(f"{e['name']}  {e['description']}" for e in preset_entries("experiment"))
    if what == "degradations":
        return "\n".join(line for option in options_of(Degradation) for line in _option_lines(option))
    kind = _kind(what)
    entries = [_entry(plugin, colour) for plugin in plugins.discover(kind).values()]
    for told in preset_entries(kind):
        entries.append("\n".join([_styled(told["name"], colour, bold=True), *_wrapped("", told["description"])]))
    if what == "metrics":
        entries.append("metric:variant, * computed unless others are asked for")
    return "\n\n".join(entries) or f"no {what}"


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
    import click

    return click.style(text, **style) if colour else text


def _option_lines(option: Option) -> list[str]:
    words = [*option.choices, *([] if option.is_closed else ["..."])]
    choices = f" ({'|'.join(words)})" if option.choices else ""
    default = "" if option.default is MISSING else f"={_plain_default(option.default)}"
    return _wrapped(f"{option.name}{default}{choices}  ", option.help)


def _wrapped(head: str, text: str) -> list[str]:
    width = max(60, shutil.get_terminal_size().columns)
    return textwrap.wrap(head + text, width, initial_indent="    ", subsequent_indent="        ")


def _plain_default(value: Any) -> str:
    return "none" if value is None else str(value)


def _kind(what: str) -> Kind:
    return next(kind for kind in plugins.KINDS if what == f"{kind}s")
