"""The metrics that have a role in figures and on the page."""

from sucre_bench import plugins
from sucre_bench.plugins.plugin import Role


def metrics_of(*wanted: Role) -> list[str]:
    """Return the names of the installed metrics that have one of these roles, in order of name."""
    return [name for name, role in roles().items() if role in wanted]


def adding(*wanted: Role) -> str:
    """Return the remedy for a lack of scores by metrics with these roles."""
    return f"add metrics=[{','.join(metrics_of(*wanted))}]"


def roles() -> dict[str, Role]:
    """Return the role of each installed metric that has one."""
    return {name: plugin.role for name, plugin in plugins.usable("metric").items() if plugin.role}


def symbol(metric: str, unit: str) -> str:
    """Return what an axis calls a metric."""
    plugin = plugins.usable("metric").get(metric)
    known = plugin.symbol if plugin else ""
    return known or " ".join(filter(None, [metric, f"({unit})" if unit else ""]))
