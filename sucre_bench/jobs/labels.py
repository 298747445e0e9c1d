"""Labels of configurations and datasets: what a sweep or a degradation adds to them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sucre_bench.degrade import Degradation
from sucre_bench.plugins.options import Choice, plain_value


def swept_label(choice: Choice, swept: Sequence[str]) -> str:
    """Return the label of a choice with the swept options: "sucre,pairing=depth". A path counts by its last part."""
    values, kind = {**choice.options, "display": choice.display}, choice.plugin.kind
    named = [name for name in values if f"{kind}.{name}" in swept or (name == "seed" and "seed" in swept)]
    shown = ((name, values[name]) for name in named)
    parts = [f"{name}={value.name if isinstance(value, Path) else plain_value(value)}" for name, value in shown]
    return ",".join([choice.label, *(part.replace(" ", "") for part in parts)])


def undegraded_label(label: str, degrade: Mapping[str, Any], name: str) -> str:
    """Return a dataset's label without what a degradation adds to it; name: of the dataset, where nothing is left."""
    suffix = Degradation.of(degrade).labelled("") if degrade else ""
    return label.removesuffix(suffix) or name
