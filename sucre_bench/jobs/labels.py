"""Labels of configurations and datasets: what a sweep or a degradation adds to them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sucre_bench.degrade import Degradation
from sucre_bench.plugins.options import plain_value
from sucre_bench.plugins.plugin import Plugin


def swept_label(plugin: Plugin, given: str, values: Mapping[str, Any], swept: Sequence[str]) -> str:
    """Return the given label, or the plugin's name, with the swept options: "sucre,pairing=depth".

    A path counts by its last part.
    """
    named = [name for name in values if f"{plugin.kind}.{name}" in swept or (name == "seed" and "seed" in swept)]
    shown = ((name, values[name]) for name in named)
    parts = [f"{name}={value.name if isinstance(value, Path) else plain_value(value)}" for name, value in shown]
    return ",".join([given or plugin.name, *(part.replace(" ", "") for part in parts)])


def undegraded_label(label: str, degrade: Mapping[str, Any], name: str) -> str:
    """Return a dataset's label without what a degradation adds to it; name: of the dataset, where nothing is left."""
    suffix = Degradation.of(degrade).labelled("") if degrade else ""
    return label.removesuffix(suffix) or name
