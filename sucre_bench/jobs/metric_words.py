"""Metrics as `metrics=[...]` and line-ups name them: "name", "name:variant" or "name:all"."""

from collections.abc import Iterator, Sequence

from sucre_bench import plugins
from sucre_bench.jobs.presets import presets
from sucre_bench.jobs.quoting import value_of


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


def words_for_hydra(names: Sequence[str]) -> Iterator[str]:
    """Yield the overrides that choose these metrics: their names, which are Hydra's, and then their variants."""
    chosen = chosen_variants(names)
    within = {base for preset in presets("metrics") if preset.name in chosen for base in preset.builds_on}
    yield f"metrics={value_of([name for name in chosen if name not in within])}"
    for name, variants in chosen.items():
        if variants:
            yield f"metrics.{name}.variants={value_of(variants)}"
