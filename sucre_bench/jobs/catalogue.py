"""What can be chosen by name: plugins, the presets of conf/ (methods or metrics with options set), and experiments.

A folder stands for the dataset that recognises it by its files.
"""

import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.errors import InputError, MissingFileError, unknown_name
from sucre_bench.imaging.resizing import split_variant
from sucre_bench.jobs import hydra_configs
from sucre_bench.jobs.run_options import check_group
from sucre_bench.jobs.word_syntax import quoted
from sucre_bench.loading.image_folder import no_image
from sucre_bench.machine import progress
from sucre_bench.machine.files import frames_of
from sucre_bench.machine.provenance import absent
from sucre_bench.plugins.options import (
    Choice,
    Option,
    default_values,
    options_of,
    plugin_choice,
)
from sucre_bench.plugins.plugin import Broken, Kind, Plugin

# Every dataset runs with every method.
KINDS: tuple[Kind, ...] = ("dataset", "method")
# What the bench adds to the options of a plugin.
_ADDED: dict[Kind, tuple[str, ...]] = {
    "dataset": ("label",),
    "method": ("label", "display"),
    "metric": ("variants", "named"),
}
# The folder of conf/ with presets for a kind, and the word that chooses some.
GROUPS: dict[Kind, str] = {"dataset": "dataset", "method": "method", "metric": "metrics"}
_MOST_FOLDERS = 100  # that are looked into for a hint
SEED = "${seed}"  # of the run: what a plugin's seed is unless it is given


def preset_of(kind: Kind, name: str) -> dict[str, Any] | None:
    """Return the options of a preset, a file of conf/ or of the user; None where a plugin or nothing has the name."""
    return hydra_configs.preset(GROUPS[kind], name) if not plugins.is_name(kind, name) else None


def plugin_of(kind: Kind, name: str) -> Plugin | None:
    """Return the plugin of this name, or that a preset of this name is of; None where there is none."""
    if plugin := plugins.get(kind, name):
        return plugin
    preset = preset_of(kind, name)
    return plugins.get(kind, str(preset.get("name"))) if preset else None


def named(kind: Kind, name: str) -> Plugin:
    """Return the plugin of this name, or that a preset of this name is of.

    Raises InputError with the nearest name, or PluginError with the reason why it cannot be used.
    """
    plugin = plugin_of(kind, name)
    if plugin:
        return plugin
    if plugins.is_name(kind, name):
        return plugins.find(kind, name)  # raises with the reason
    if not name:  # a variable that is not set, say
        raise InputError("is empty", kind, f"give a name that `sucre-bench list {kind}s` shows")
    if Path(name).suffix in (".yaml", ".yml"):
        group = GROUPS[kind]
        stem = Path(name).stem
        remedy = f"put the file into MINE/{group}/ and write --config-dir MINE {group}={stem}"
        raise InputError(f"no {kind} is called '{name}'", remedy=remedy)
    if kind == "dataset" and Path(name).exists():
        remedy = f"sucre-bench run {name}" if Path(name).is_file() else f"dataset=./{name}"
        fault = f"no dataset is called '{name}', but there is a path of this name"
        raise InputError(fault, remedy=f"write {remedy}")
    for made in vars(sys.modules["__main__"]).copy().values():  # a class of a notebook's cell
        plugin = getattr(made, "__plugin__", None)
        if isinstance(plugin, Plugin) and (plugin.kind, plugin.name) == (kind, name):
            fault = f"'{name}' is a class of this session, and has no name outside it"
            raise InputError(fault, remedy=f"pass an object: {plugin.cls.__name__}(...)")
    raise plugins.unknown(
        kind, name, {*plugins.discover(kind), *hydra_configs.preset_names(GROUPS[kind])}
    )


def is_choice(kind: Kind, name: str) -> bool:
    """Whether a name is a plugin's, or the path of a folder of data, or for a metric "name:variant"."""
    is_data = kind == "dataset" and is_path(name)
    return is_data or plugins.is_name(
        kind, name.partition(":")[0] if kind == "metric" else name
    )


def configuration(kind: Kind, name: str) -> dict[str, Any]:
    """Return what a plugin starts from: its name, what the bench adds, and each option; ??? for one without a default.

    name: for a dataset also a folder, for a metric also "name:variant". Raises InputError for an unknown name.
    """
    root = {}
    if kind == "dataset" and is_path(name):
        root = {"root": name}
        name = recognised(Path(name))
    name, _, variant = name.partition(":") if kind == "metric" else (name, "", "")
    plugin = plugins.find(kind, name)
    added = dict.fromkeys(_ADDED[kind])
    if kind == "method":
        added["display"] = plugin.display
    if kind == "metric":  # as keys: Hydra joins those of several choices
        added["named"] = dict.fromkeys([variant] if variant else plugin.default, True)
    values = default_values(plugin.cls)
    if "seed" in values:
        values["seed"] = SEED
    return {"name": plugin.name, **added, **values, **root}


def method_choice(name: str, options: Mapping[str, Any]) -> Choice:
    """Return a method or a preset of conf/ with options (label and display too), as Python takes them."""
    plugin, known = named("method", name), option_names("method", name)
    for option in options:
        if option not in known:
            raise unknown_name(f"{plugin.name}.{option}", option, known)
    preset = preset_of("method", name) or {"display": plugin.display}
    values = {name: value for name, value in preset.items() if value not in (SEED, "???")}
    return plugin_choice("method", {**values, **options, "name": plugin.name})


def option_names(kind: Kind, name: str) -> list[str]:
    """Return the names of the options of a method or dataset, those that the bench adds included.

    Empty where no plugin and no preset of conf/ has this name.
    """
    plugin = plugin_of(kind, name)
    return (
        [*(option.name for option in options_of(plugin.cls)), *_ADDED[kind]] if plugin else []
    )


# -- metrics: "name", "name:variant" or "name:all" -----------------------------------------------------------


def metrics_of(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return the configuration of metrics given as "name", "name:variant", "name:all" or a preset of several.

    A bare name means the metric's default variants.
    """
    made: dict[str, dict[str, Any]] = {}
    for text in names:
        preset = preset_of("metric", text)
        if preset is None:
            name = named("metric", text.partition(":")[0]).name
            preset = {name: configuration("metric", text)}
        for name, values in preset.items():
            made[name] = {
                **values,
                "named": {**made.get(name, {}).get("named", {}), **values["named"]},
            }
    return made


def metric_choices(metrics: Iterable[Any]) -> tuple[Choice, ...]:
    """Return metrics and their variants: those named as `metrics_of` takes them, then metric objects."""
    metrics = list(metrics)
    names = [metric for metric in metrics if isinstance(metric, str)]
    objects = list[Choice]()
    for metric in metrics:
        if not isinstance(metric, str):
            plugin = plugins.plugin_of(metric)
            objects.append(Choice(plugin, plugin.name, vars(metric), variants=plugin.default))
    chosen = chosen_metrics(metrics_of(names)) if names or not objects else ()
    return (*chosen, *objects)


def chosen_metrics(values: Mapping[str, Any]) -> tuple[Choice, ...]:
    """Return the metrics and variants of a configuration's `metrics`. Raises InputError if there are none."""
    chosen = []
    for metric, given in values.items():
        check_group(f"metrics.{metric}", given, plugins.find("metric", metric).cls, "variants")
        choice = plugin_choice(
            "metric", {k: v for k, v in given.items() if k not in _ADDED["metric"]}
        )
        plugin = choice.plugin
        variants = []
        wanted = given.get("named", ()) if given["variants"] is None else given["variants"]
        words = [wanted] if isinstance(wanted, str) else wanted
        if not isinstance(words, Iterable):
            fault = f"{words!r} is no list of variants"
            raise InputError(fault, f"metrics.{metric}.variants", "write [NAME] or [all]")
        for text in words:
            name, form, _ = text.partition("@")
            if form:
                split_variant(text)  # raises for a form that there is not
            if name != "all" and name not in plugin.variants:
                raise unknown_name(plugin.name, name, ("all", *plugin.variants), "variant")
            if form and not plugin.needs <= {"reference"}:
                fault = f"has no score at another size, it needs {' and '.join(sorted(plugin.needs))}"
                raise InputError(fault, f"{plugin.name}:{text}", "leave @ and size out")
            variants += [
                variant + text[len(name) :]
                for variant in (plugin.variants if name == "all" else [name])
            ]
        chosen.append(replace(choice, variants=tuple(dict.fromkeys(variants))))
    if not chosen:
        raise InputError(
            "no metric is chosen; add metrics=[NAME,...], `sucre-bench list metrics` shows what there is"
        )
    return tuple(chosen)


# -- the dataset of a folder ---------------------------------------------------------------------------------


def is_path(name: str) -> bool:
    """Whether a dataset's name is the path of a folder: no plugin's name has a slash or is made of dots."""
    return "/" in name or "\\" in name or name in (".", "..")


def recognised(folder: Path) -> str:
    """Return the name of the dataset that a folder is, and say which in a line.

    Raises InputError when it is no folder, when no dataset fits, with what was looked for, or when several fit.
    """

    def typed(path: Path) -> str:
        return f"dataset={quoted(str(path) if is_path(str(path)) else f'./{path}')}"

    if not folder.is_dir():
        if folder.exists():
            raise InputError("is a file", typed(folder), frames_of(folder) or "give its folder")
        raise MissingFileError("no such folder", typed(folder), "correct the path")
    fits = _fitting(folder)
    root = f"dataset.root={quoted(str(folder))}"
    if len(fits) > 1:
        either = " or ".join(f"dataset={name} (for {sign})" for name, sign in fits.items())
        raise InputError("fits several datasets", typed(folder), f"give {root} and {either}")
    if not fits:
        below = sorted(path for path in folder.iterdir() if path.is_dir())[:_MOST_FOLDERS]
        inner = next((path for path in below if _fitting(path)), None)
        # Datasets with a licence are published data.
        of_users = (p for p in plugins.usable("dataset").values() if p.signs and not p.licence)
        looked_for = ", ".join(f"{plugin.signs[0]} ({plugin.name})" for plugin in of_users)
        fault = f"holds none of {looked_for}, and no published dataset"
        if inner:
            raise InputError(fault, typed(folder), f"give {typed(inner)}")
        remedy = "name the dataset: dataset=NAME dataset.root=DIR"
        raise no_image(folder, fault, remedy, typed(folder))
    ((name, sign),) = fits.items()
    progress.say(f"{folder} is dataset={name} {root}, for it holds {sign}")
    return name


def _fitting(folder: Path) -> dict[str, Path]:
    """The datasets that fit, each with the file or folder that says so.

    Those with poses go before single images, which lie in many folders.
    """
    known = plugins.usable("dataset")
    signs = {}
    for plugin in known.values():
        there = (path for sign in plugin.signs for path in sorted(folder.glob(sign)))
        if (path := next(there, None)) is not None:
            signs[plugin.name] = path.relative_to(folder)
    return {name: sign for name, sign in signs.items() if "poses" in known[name].has} or signs


# -- what lists show -----------------------------------------------------------------------------------------


def entry(plugin: Plugin | Broken) -> dict[str, Any]:
    """Return what is known of a plugin: name, description, needs, options ... or "broken": why it cannot be used."""
    if isinstance(plugin, Broken):
        return {"name": plugin.name, "broken": plugin.reason}
    lacking = absent(*plugin.requires)
    about: dict[str, Any] = {
        "name": plugin.name,
        "description": plugin.summary,
        "needs": sorted(plugin.needs),
        "has": sorted(plugin.has),
        "signs": list(plugin.signs),
        "source": plugin.source,
        "proven": plugin.proven,
        "licence": plugin.licence,
        "cites": plugin.cites,
        "options": {option.name: option_entry(option) for option in options_of(plugin.cls)},
        "installed": lacking is None,
        "install": lacking.install if lacking else "",
        "variants": dict(plugin.variants),
    }
    if plugin.kind == "method":
        about |= {
            "display": plugin.display,
            "differs": plugin.differs,
            "opinions": dict(plugin.opinions),
        }
    if plugin.kind == "metric":
        low, high = (limit if math.isfinite(limit) else None for limit in plugin.range)
        about |= {
            "unit": plugin.unit,
            "better": plugin.better,
            "range": [low, high],
            "default": list(plugin.default),
        }
    return about


def option_entry(option: Option) -> dict[str, Any]:
    """Return an option's default, its choices, or words if others may be given too, and its help."""
    default = "must be given" if option.is_required else option.default
    if default is not None and not isinstance(default, (int, float, str, bool)):
        default = str(default)
    about: dict[str, Any] = {"default": default}
    if option.choices:
        about["choices" if option.is_closed else "words"] = list(option.choices)
    return about | ({"help": option.help} if option.help else {})


def preset_entries(group: str) -> list[dict[str, Any]]:
    """Return name and description of each file of a folder of conf/, "experiment" say."""
    return [
        {"name": name, "description": text}
        for name, text in hydra_configs.descriptions(group).items()
    ]


def configured_entries(kind: Kind) -> list[dict[str, Any]]:
    """Return what is known of the presets of conf/ for a kind: as of their plugin, with their own description."""
    found = (
        (preset, plugin_of(kind, preset["name"])) for preset in preset_entries(GROUPS[kind])
    )
    return [entry(plugin) | preset for preset, plugin in found if plugin]
