"""Metrics as `metrics=[...]` and line-ups name them: "name", "name:variant" or "name:all"."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sucre_bench import plugins
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.imaging.resizing import split_variant
from sucre_bench.jobs.catalogue import presets
from sucre_bench.plugins.options import Choice, plugin_choice
from sucre_bench.plugins.plugin import Plugin


@dataclass(frozen=True)
class MetricChoice:
    """A metric and the variants of it to compute."""

    choice: Choice
    variants: tuple[str, ...]

    @property
    def plugin(self) -> Plugin:
        return self.choice.plugin


def chosen_variants(names: Sequence[str]) -> dict[str, list[str]]:
    """Return each metric's named variants, its default ones included where its bare name is among the names.

    A metric without a variant in the names has an empty list.
    """
    chosen: dict[str, list[str]] = {}
    for text in names:
        name, colon, variant = text.partition(":")
        chosen.setdefault(name, []).extend([variant] if colon else [])
    for name, variants in chosen.items():
        if variants and name in names and (plugin := plugins.usable("metric").get(name)):
            variants[:0] = plugin.default
    return chosen


def group_names(names: Iterable[str]) -> list[str]:
    """Return metrics and presets without the metrics that a preset among them has: what Hydra's list takes."""
    chosen = list(names)
    within = {base for preset in presets("metrics") if preset.name in chosen for base in preset.builds_on}
    return [name for name in chosen if name not in within]


def metric_choices(names: Sequence[str]) -> tuple[MetricChoice, ...]:
    """Read "name", "name:variant" and "name:all", as Python and `sucre-bench score` take them."""
    chosen: dict[str, list[str]] = {}
    for text in names:
        name, _, variant = text.partition(":")
        plugin = plugins.find("metric", name)
        chosen.setdefault(name, []).extend([variant] if variant else plugin.default)
    return chosen_metrics({name: {"name": name, "variants": variants} for name, variants in chosen.items()})


def chosen_metrics(values: Mapping[str, Any]) -> tuple[MetricChoice, ...]:
    """Return the metrics and variants of a configuration's `metrics`. Raises InputError if there are none."""
    chosen = []
    for given in values.values():
        variants = tuple(given["variants"])
        choice = plugin_choice("metric", {k: v for k, v in given.items() if k != "variants"})
        chosen.append(MetricChoice(choice, _variants(choice.plugin, variants)))
    if not chosen:
        raise InputError("no metric is chosen; add metrics=[NAME,...], `sucre-bench list metrics` shows what there is")
    return tuple(chosen)


def _variants(plugin: Plugin, names: Sequence[str]) -> tuple[str, ...]:
    """Return the variants that names stand for: each "NAME" or "all", perhaps with a size behind @."""
    chosen: list[str] = []
    for text in names:
        name, resizing = split_variant(text)
        if name != "all" and name not in plugin.variants:
            raise unknown_name(plugin.name, name, ("all", *plugin.variants), "variant")
        if resizing and not plugin.needs <= {"reference"}:
            needs = " and ".join(sorted(plugin.needs))
            raise InputError(
                f"has no score at another size, it needs {needs}", f"{plugin.name}:{text}", "leave @ and size out"
            )
        chosen += [variant + text[len(name) :] for variant in (plugin.variants if name == "all" else [name])]
    return tuple(dict.fromkeys(chosen))
