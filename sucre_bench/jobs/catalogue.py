"""What can be chosen by name: plugins, the presets of conf/ (methods or metrics with options set), and experiments.

A folder stands for the dataset that recognises it by its files.
"""

import math
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.arguments import check_argument
from sucre_bench.errors import InputError, SucreBenchError, unknown_name
from sucre_bench.imaging.resizing import split_variant
from sucre_bench.jobs import hydra_configs
from sucre_bench.jobs.run_options import check_group
from sucre_bench.jobs.word_syntax import quoted
from sucre_bench.loading.image_folder import no_image
from sucre_bench.machine import progress
from sucre_bench.machine.files import check_folder
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
SEED = "${seed}"  # of the run: what a plugin's seed is unless it is given


def is_plugin(kind: Kind, name: str) -> bool:
    """Whether a name is a plugin's, or the path of a folder of data, or for a metric "name:variant"."""
    if kind == "metric":
        name = name.partition(":")[0]
    return (kind == "dataset" and is_path(name)) or name in plugins.discover(kind, name)


def plugin_values(kind: Kind, name: str) -> dict[str, Any]:
    """Return what a plugin starts from: its name, what the bench adds, and each option; ??? for one without a default.

    name: see `is_plugin`. Raises InputError for an unknown name.
    """
    root = {}
    variant = ""
    if kind == "dataset" and is_path(name):
        root = {"root": name}
        name = recognised(Path(name))
    if kind == "metric":
        name, _, variant = name.partition(":")
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


def configuration(kind: Kind, name: str) -> dict[str, Any]:
    """Return what a plugin or a preset of this name starts from, see `plugin_values`.

    A preset of metrics has this for each of them. Raises InputError with the nearest name, or PluginError with the
    reason why a plugin cannot be used.
    """
    if is_plugin(kind, name):
        return plugin_values(kind, name)
    preset = hydra_configs.preset(GROUPS[kind], name)
    if preset is not None:
        if kind in KINDS and "name" not in preset:
            remedy = f"begin it with `defaults: [NAME]`, the {kind} that it is a preset of"
            raise InputError(f"names no {kind}", f"{kind}/{name}.yaml", remedy)
        return preset
    if kind == "dataset" and os.path.isdir(name):  # noqa: PTH112 - pathlib's raises OSError for some names
        fault = f"no dataset is called '{name}', but a folder is"
        raise InputError(fault, remedy=f"write dataset=./{name}")
    for made in [*vars(sys.modules["__main__"]).values()]:  # a class of a notebook's cell
        plugin = getattr(made, "__plugin__", None)
        if isinstance(plugin, Plugin) and (plugin.kind, plugin.name) == (kind, name):
            fault = f"'{name}' is a class of this session, and has no name outside it"
            raise InputError(fault, remedy=f"pass an object: {plugin.cls.__name__}(...)")
    raise plugins.unknown(kind, name, hydra_configs.names(GROUPS[kind]))


def plugin_of(kind: Kind, name: str) -> Plugin:
    """Return the plugin of a name, or that a preset of this name is of. Raises as `configuration`."""
    return plugins.find(kind, configuration(kind, name)["name"])


def option_names(kind: Kind, name: str) -> list[str]:
    """Return the options of a method or dataset, those that the bench adds included; none for an unknown name."""
    try:
        options = options_of(plugin_of(kind, name).cls)
    except SucreBenchError:
        return []
    return [*(option.name for option in options), *_ADDED[kind]]


def method_choice(name: str, options: Mapping[str, Any]) -> Choice:
    """Return a method or a preset of conf/ with options (label and display too), as Python takes them."""
    values = configuration("method", name)
    known = option_names("method", name)
    for option in options:
        if option not in known:
            raise unknown_name(f"method.{option}", option, known)
    kept = ("name", "display") if is_plugin("method", name) else values
    given = {option: values[option] for option in kept if values[option] not in (SEED, "???")}
    return plugin_choice("method", {**given, **options})


# -- metrics: "name", "name:variant" or "name:all" -----------------------------------------------------------


def metric_choices(metrics: Iterable[Any]) -> tuple[Choice, ...]:
    """Return metrics and their variants: of names, then of metric objects.

    A name is "name" with its default variants, "name:variant", "name:all", or a preset of several.
    """
    made: dict[str, dict[str, Any]] = {}
    objects = list[Choice]()
    for metric in metrics:
        if not isinstance(metric, str):
            plugin = plugins.plugin_of(metric)
            objects.append(Choice(plugin, plugin.name, vars(metric), variants=plugin.default))
            continue
        values = configuration("metric", metric)
        several = {values["name"]: values} if "name" in values else values
        for name, one in several.items():
            named = made.get(name, {}).get("named", {})
            made[name] = {**one, "named": {**named, **one["named"]}}
    chosen = chosen_metrics(made) if made or not objects else ()
    return (*chosen, *objects)


def chosen_metrics(values: Mapping[str, Any]) -> tuple[Choice, ...]:
    """Return the metrics and variants of a configuration's `metrics`. Raises InputError if there are none."""
    chosen = []
    for metric, given in values.items():
        plugin = plugins.find("metric", metric)
        check_group(f"metrics.{metric}", given, plugin.cls, "variants")
        options = {k: v for k, v in given.items() if k not in _ADDED["metric"]}
        wanted = given["variants"]
        if wanted is None:
            wanted = [*given.get("named", ())]
        if isinstance(wanted, str):
            wanted = [wanted]
        check_argument(f"metrics.{metric}.variants", wanted, Sequence[str])
        variants = []
        for text in wanted:
            name, form, _ = text.partition("@")
            if name != "all" and name not in plugin.variants:
                raise unknown_name(plugin.name, name, ("all", *plugin.variants), "variant")
            if form:
                split_variant(text)  # raises for a form that there is not
                if not plugin.needs <= {"reference"}:
                    fault = f"has no score at another size, it needs {' and '.join(sorted(plugin.needs))}"
                    raise InputError(fault, f"{plugin.name}:{text}", "leave @ and size out")
            names = plugin.variants if name == "all" else [name]
            variants += [variant + text[len(name) :] for variant in names]
        choice = plugin_choice("metric", options)
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

    Those with poses go before single images, which lie in many folders. Raises InputError when it is no folder, when no
    dataset fits, with what was looked for, or when several fit.
    """
    check_folder(folder, "correct the path")
    known = plugins.usable("dataset")
    signs = {}
    for plugin in known.values():
        there = (path for sign in plugin.signs for path in sorted(folder.glob(sign)))
        path = next(there, None)
        if path is not None:
            signs[plugin.name] = path.relative_to(folder)
    fits = {name: sign for name, sign in signs.items() if "poses" in known[name].has} or signs
    root = f"dataset.root={quoted(str(folder))}"
    if len(fits) > 1:
        either = " or ".join(f"dataset={name} (for {sign})" for name, sign in fits.items())
        raise InputError("fits several datasets", folder, f"give {root} and {either}")
    if not fits:
        # Datasets with a licence are published data.
        of_users = (p for p in known.values() if p.signs and not p.licence)
        looked_for = ", ".join(f"{plugin.signs[0]} ({plugin.name})" for plugin in of_users)
        fault = f"holds none of {looked_for}, and no published dataset"
        raise no_image(folder, fault, "name the dataset: dataset=NAME dataset.root=DIR")
    ((name, sign),) = fits.items()
    progress.say(f"{folder} is dataset={name} {root}, for it holds {sign}")
    return name


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
    made = []
    for preset in preset_entries(GROUPS[kind]):
        made.append(entry(plugin_of(kind, preset["name"])) | preset)
    return made
