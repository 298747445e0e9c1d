"""The metrics that have a role in figures and on the page."""

from __future__ import annotations

from sucre_bench import plugins
from sucre_bench.plugins.plugin import Plugin, Role


def metrics_of(*wanted: Role) -> list[str]:
    """Return the names of the installed metrics that have one of these roles, in order of name."""
    return [name for name, role in roles().items() if role in wanted]


def roles() -> dict[str, Role]:
    """Return the role of each installed metric that has one."""
    found = plugins.discover("metric").items()
    return {name: plugin.role for name, plugin in sorted(found) if isinstance(plugin, Plugin) and plugin.role}


def symbol(metric: str, unit: str) -> str:
    """Return what an axis calls a metric."""
    plugin = plugins.discover("metric").get(metric)
    known = plugin.symbol if isinstance(plugin, Plugin) else ""
    return known or " ".join(filter(None, [metric, f"({unit})" if unit else ""]))
