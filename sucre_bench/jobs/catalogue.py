"""The catalogue of plugins, presets and experiments, with options and needs, as plain data."""

import math
from dataclasses import MISSING
from typing import Any

from sucre_bench import plugins
from sucre_bench.jobs.presets import plugin_of, presets
from sucre_bench.plugins.options import Option, options_of
from sucre_bench.plugins.plugin import Broken, Kind, Plugin


def entries(kind: Kind) -> list[dict[str, Any]]:
    """Return what is known of each plugin of a kind, and after them the presets of conf/ for that kind."""
    return [*map(entry, plugins.discover(kind).values()), *preset_entries(kind)]


def entry(plugin: Plugin | Broken) -> dict[str, Any]:
    """Return what is known of a plugin: name, description, needs, options ... or "broken": why it cannot be used."""
    if isinstance(plugin, Broken):
        return {"name": plugin.name, "broken": plugin.reason}
    install = plugins.missing_packages(plugin)
    about: dict[str, Any] = {
        "name": plugin.name,
        "description": plugin.summary,
        "needs": sorted(plugin.needs),
        "has": sorted(plugin.has),
        "signs": list(plugin.signs),
        "source": plugin.source,
        "licence": plugin.licence,
        "cites": plugin.cites,
        "options": {option.name: option_entry(option) for option in options_of(plugin.cls)},
        "installed": not install,
        "install": install,
        "variants": dict(plugin.variants),
    }
    if plugin.kind == "method":
        about["display"] = plugin.display
    if plugin.kind == "metric":
        low, high = (limit if math.isfinite(limit) else None for limit in plugin.range)
        about |= {"unit": plugin.unit, "better": plugin.better, "range": [low, high], "default": list(plugin.default)}
    return about


def option_entry(option: Option) -> dict[str, Any]:
    """Return an option's default, its choices if there are no others, and its help."""
    default = "must be given" if option.default is MISSING else option.default
    if default is not None and not isinstance(default, (int, float, str, bool)):
        default = str(default)
    about: dict[str, Any] = {"default": default}
    if option.is_closed:
        about["choices"] = list(option.choices)
    return about | ({"help": option.help} if option.help else {})


def preset_entries(group: str) -> list[dict[str, Any]]:
    """Return name and description of each preset of a folder of conf/, "experiment" say."""
    return [{"name": preset.name, "description": preset.description} for preset in presets(group)]


def configured_entries(kind: Kind) -> list[dict[str, Any]]:
    """Return what is known of the presets of conf/ for a kind: as of their plugin, with their own description."""
    found = ((preset, plugin_of(kind, preset.name)) for preset in presets(kind))
    return [entry(p) | {"name": preset.name, "description": preset.description} for preset, p in found if p]
