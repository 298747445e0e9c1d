"""The metrics that have a role in figures and on the page, and their scores."""

from collections.abc import Sequence

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame
from sucre_bench.plugins.plugin import Role


def roles() -> dict[str, Role]:
    """Return the role of each installed metric that has one."""
    return {
        name: plugin.role for name, plugin in plugins.usable("metric").items() if plugin.role
    }


def metrics_of(*wanted: Role) -> list[str]:
    """Return the names of the installed metrics that have one of these roles, in order of name."""
    return [name for name, role in roles().items() if role in wanted]


def scores_of(rows: DataFrame, *wanted: Role) -> DataFrame:
    """Return the scores by metrics with one of these roles, or by all metrics if no role is given."""
    scored = rows[(rows["status"] == "ok") & rows["value"].notna()]
    return scored[scored["metric"].isin(metrics_of(*wanted))] if wanted else scored


def beside(rows: DataFrame, scores: DataFrame, column: str, by: Sequence[str]) -> DataFrame:
    """Return the rows that have a score with the same values of the columns `by`, with that score as a new column."""
    known = scores.drop_duplicates(by).rename(columns={"value": column})
    return rows.merge(known[[*by, column]], on=list(by))


def adding(*wanted: Role) -> str:
    """Return the remedy for a lack of scores by metrics with these roles."""
    return f"add metrics=[{','.join(metrics_of(*wanted))}]"


def symbol(metric: str, unit: str) -> str:
    """Return what an axis calls a metric."""
    plugin = plugins.get("metric", metric)
    known = plugin.symbol if plugin else ""
    return known or " ".join(filter(None, [metric, f"({unit})" if unit else ""]))
