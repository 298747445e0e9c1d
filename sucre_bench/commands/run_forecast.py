"""`sucre-bench run --dry-run`: prints the jobs and views of a run, and how long the views to do will take."""

import math
from collections.abc import Sequence

import click

from sucre_bench.engine.forecast import Expected
from sucre_bench.machine import terminal
from sucre_bench.machine.progress import duration
from sucre_bench.machine.text_formats import counted


def show(found: Sequence[Expected]) -> None:
    """Print a line for each dataset and method."""
    table = terminal.table(("dataset", "method"), ("jobs", "views", "stored", "to do", "time"))
    for one in found:
        to_do = one.views - one.stored - one.skipped
        time = "?" if math.isnan(one.seconds) else duration(one.seconds)
        table.add_row(
            one.dataset, one.method, *map(str, (one.jobs, one.views, one.stored, to_do)), time
        )
    terminal.out.print(table)
    for one in found:
        if one.skipped:
            views = counted(one.skipped, "view")
            click.echo(f"{one.dataset} / {one.method}: {views} will be skipped: {one.lack}")
    total = math.fsum(one.seconds for one in found)
    if math.isnan(total):
        click.echo(
            "time ?: no view of that configuration is stored; run a few first, for example with first=3"
        )
    else:
        click.echo(f"{duration(total)} of one process, from the stored views of each method")
