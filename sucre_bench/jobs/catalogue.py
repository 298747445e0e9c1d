"""What can be chosen by name: plugins, the presets of conf/ (methods or metrics with options set), and experiments."""

import functools
import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any, get_args

from sucre_bench import plugins
from sucre_bench.jobs.run_options import CONF_FOLDER
from sucre_bench.machine.text_formats import read_yaml
from sucre_bench.plugins.options import Choice, Option, options_of, plugin_choice
from sucre_bench.plugins.plugin import Broken, Kind, Plugin

# What the bench adds to the options of a plugin.
_ADDED: dict[Kind, tuple[str, ...]] = {"dataset": ("label",), "method": ("label", "display"), "metric": ("variants",)}


@dataclass(frozen=True)
class Preset:
    """A file of conf/: its name, what its first comment says, the names in its defaults list, and what it sets."""

    name: str
    description: str
    builds_on: tuple[str, ...]
    sets: Mapping[str, Any]


def presets(group: str) -> list[Preset]:
    """Return the presets of a folder of conf/, "experiment" or "method" say, by name."""
    return [_read(path) for path in sorted((CONF_FOLDER / group).glob("*.yaml"))]


def plugin_of(kind: Kind, name: str) -> Plugin | None:
    """Return the plugin of this name, or that a preset of this name is of; None where there is none."""
    known = plugins.usable(kind)
    if name not in known and (preset := preset_of(kind, name)):
        name = next((base for base in preset.builds_on if base in known), name)
    return known.get(name)


def preset_of(kind: Kind, name: str) -> Preset | None:
    """Return the preset of this name, unless a plugin has it; None where there is none."""
    group = "metrics" if kind == "metric" else kind
    return None if name in plugins.discover(kind) else next((p for p in presets(group) if p.name == name), None)


def method_choice(name: str, options: Mapping[str, Any]) -> Choice:
    """Return a method or a preset of conf/ with options (label and display too), as Python takes them."""
    plugin = plugin_of("method", name) or plugins.find("method", name)  # which says why there is none
    preset = preset_of("method", name)
    values = preset.sets if preset else {}
    return plugin_choice("method", {"display": plugin.display, **values, **options, "name": plugin.name})


def option_names(kind: Kind, name: str) -> list[str]:
    """Return the names of the options of a method or dataset, those that the bench adds included.

    Empty where no plugin and no preset of conf/ has this name.
    """
    plugin = plugin_of(kind, name)
    return [*(option.name for option in options_of(plugin.cls)), *_ADDED[kind]] if plugin else []


def given_paths(kind: Kind, name: str, values: Mapping[str, Any]) -> dict[str, str]:
    """Return those of a method's or dataset's given options that are paths: by type, or as a file that it `reads`."""
    plugin = plugin_of(kind, name)
    paths = {}
    for option in options_of(plugin.cls) if plugin else ():
        value = values.get(option.name)
        is_typed = Path in (option.type, *get_args(option.type))
        is_read = plugin is not None and option.name in plugin.reads and plugin_of("method", str(value)) is None
        if isinstance(value, str) and value not in ("", *option.choices) and (is_typed or is_read):
            paths[option.name] = value
    return paths


def default_choice(group: str) -> str:
    """Return the method or dataset that a command without `method=` or `dataset=` takes."""
    defaults = _loaded((CONF_FOLDER / "config.yaml").read_text(encoding="utf-8")).get("defaults") or ()
    return next((str(entry[group]) for entry in defaults if isinstance(entry, dict) and group in entry), "")


@functools.cache  # the files do not change while a command runs
def _read(path: Path) -> Preset:
    text = path.read_text(encoding="utf-8")
    comments = [line[1:].strip() for line in text.splitlines() if line.startswith("#")]
    description = next((comment for comment in comments if not comment.startswith("@")), "")
    sets = _loaded(text)
    names = tuple(entry for entry in sets.pop("defaults", None) or () if isinstance(entry, str) and entry != "_self_")
    return Preset(path.stem, description, names, sets)


def _loaded(text: str) -> dict[str, Any]:
    return read_yaml(text) or {}


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
