"""`sucre-bench list`: plugins, experiments and degradations, as text and as JSON."""

from __future__ import annotations

import json
import math
import shutil
import textwrap
from dataclasses import MISSING
from typing import Any

import click

from sucre_bench import plugins
from sucre_bench.commands.common import json_option, load_plugins, plugin_option
from sucre_bench.degrade import Degradation
from sucre_bench.jobs.schema import CONF_FOLDER
from sucre_bench.plugins.options import Option, options_of
from sucre_bench.plugins.plugin import Broken, Kind, Plugin

__all__ = ["list_"]


@click.command("list", short_help="List plugins, their options, and if they can run here.")
@click.argument("what", type=click.Choice(["methods", "datasets", "metrics", "experiments", "degradations"]))
@json_option
@plugin_option
def list_(what: str, as_json: bool, plugin_files: tuple[str, ...]) -> None:
    """List what there is, what it needs, every option, and whether it is installed.

    \b
    sucre-bench list methods
    sucre-bench list metrics --plugin my_metric.py
    sucre-bench list experiments
    sucre-bench list methods --json | jq -r '.[] | select(.installed) | .name'
    """
    from sucre_bench.machine import terminal

    load_plugins(plugin_files)
    if as_json:
        click.echo(_as_json(what))
    else:
        click.echo(_as_text(what, colour=terminal.has_styles()), color=terminal.has_styles())


def _as_json(what: str) -> str:
    """Everything that is known of each plugin, or the experiments, as a JSON array."""
    if what == "degradations":
        return json.dumps({o.name: _option(o) for o in options_of(Degradation)}, indent=1)
    if what == "experiments":
        return json.dumps(_configured("experiment"), indent=1)
    kind = _kind(what)
    return json.dumps([*map(_about, plugins.discover(kind).values()), *_configured(kind)], indent=1)


def _as_text(what: str, colour: bool) -> str:
    """Each with its needs, licence, options and whether it can run here, wrapped to the terminal."""
    if what == "experiments":
        return "\n".join(f"{e['name']}  {e['description']}" for e in _configured("experiment"))
    if what == "degradations":
        return "\n".join(line for option in options_of(Degradation) for line in _option_lines(option))
    kind = _kind(what)
    entries = [_entry(plugin, colour) for plugin in plugins.discover(kind).values()]
    for told in _configured(kind):
        entries.append("\n".join([_styled(told["name"], colour, bold=True), *_wrapped("", told["description"])]))
    if what == "metrics":
        entries.append("metric:variant, * computed unless others are asked for")
    return "\n\n".join(entries) or f"no {what}"


def _entry(plugin: Plugin | Broken, colour: bool) -> str:
    if isinstance(plugin, Broken):
        return _styled(f"{plugin.name}  cannot be used: {plugin.reason}", colour, fg="red")
    about, lines = _about(plugin), [_styled(plugin.name, colour, bold=True)]
    if about["install"]:
        lines[0] += _styled(f"  not installed: {about['install']}", colour, fg="red")
    lines += _wrapped("", plugin.summary)
    if plugin.kind == "metric":
        direction = "describes" if plugin.better == "none" else f"{plugin.better} is better"
        lines += _wrapped("", f"{direction}{', in ' + plugin.unit if plugin.unit else ''}")
    for key in ("needs", "has", "source", "licence", "cites"):
        text = ", ".join(about[key]) if key in ("needs", "has") else about[key]
        lines += _wrapped(f"{key}  ", text) if text else []
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


def _about(plugin: Plugin | Broken) -> dict[str, Any]:
    if isinstance(plugin, Broken):
        return {"name": plugin.name, "broken": plugin.reason}
    about: dict[str, Any] = {
        "name": plugin.name,
        "description": plugin.summary,
        "needs": sorted(plugin.needs),
        "has": sorted(plugin.has),
        "source": plugin.source,
        "licence": plugin.licence,
        "cites": plugin.cites,
        "options": {o.name: _option(o) for o in options_of(plugin.cls)},
        "installed": not plugins.missing_packages(plugin),
        "install": plugins.missing_packages(plugin),
        "variants": dict(plugin.variants),
    }
    if plugin.kind == "method":
        about["display"] = plugin.display
    if plugin.kind == "metric":
        low, high = (x if math.isfinite(x) else None for x in plugin.range)
        about |= {"unit": plugin.unit, "better": plugin.better, "range": [low, high], "default": list(plugin.default)}
    return about


def _option(option: Option) -> dict[str, Any]:
    default = "must be given" if option.default is MISSING else option.default
    about: dict[str, Any] = {"default": default if isinstance(default, (int, float, str, bool)) else _text(default)}
    if option.is_closed:
        about["choices"] = list(option.choices)
    return about | ({"help": option.help} if option.help else {})


def _text(value: Any) -> str | None:
    return None if value is None else str(value)


def _configured(group: str) -> list[dict[str, str]]:
    """What a file of conf/ chooses: experiments, methods with options set. Its first comment says what it is."""
    found = []
    for path in sorted((CONF_FOLDER / group).glob("*.yaml")):
        said = [line[1:].strip() for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
        found.append({"name": path.stem, "description": next((s for s in said if not s.startswith("@")), "")})
    return found
