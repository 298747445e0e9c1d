"""The end of `sucre-bench run`: lines and tables for people, or one JSON object for programs."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sucre_bench import compare, results
from sucre_bench.compare.terminal_table import as_blocks
from sucre_bench.engine.run import Outcome
from sucre_bench.engine.training_pictures import seen_in_training
from sucre_bench.errors import escaped_breaks
from sucre_bench.jobs import hydra_configs
from sucre_bench.machine import terminal
from sucre_bench.machine.text_formats import counted
from sucre_bench.results import with_remedy
from sucre_bench.results.layout import log_path
from sucre_bench.results.reasons import unscored, without_view
from sucre_bench.results.rows import RESTORATION

if TYPE_CHECKING:
    from sucre_bench.compare import Comparison
    from sucre_bench.engine.run import Fault
    from sucre_bench.jobs.job import Job


def compared(outcome: Outcome) -> list[Comparison]:
    """Compare the methods on each dataset of the results folder: once, for terminal and page."""
    if not len(outcome.rows):
        return []
    # it may not run here
    baseline = outcome.job.baseline if outcome.job.baseline in outcome.methods else ""
    return compare.compare(outcome.rows, order=outcome.methods, baseline=baseline)


def as_object(outcome: Outcome, comparisons: Sequence[Comparison]) -> dict[str, Any]:
    """Write the study's tables and figures and the page, and return the counts, every fault and where everything is.

    The counts are of restorations; paths are as given in out=, null where nothing was written.
    """
    paths, notes, page = _written(outcome, comparisons)
    kinds = ("failed", "skipped", "scores_failed")
    faults = {name: [asdict(fault) for fault in getattr(outcome, name)] for name in kinds}
    counts = (
        "exit_code",
        "ok",
        "cached",
        "interrupted",
        "crashed",
        "nothing_scored",
        "datasets",
        "methods",
    )
    return {
        **{name: getattr(outcome, name) for name in counts},
        **faults,
        "hints": [asdict(hint) for hint in outcome.hints],
        "out": str(outcome.out),
        "table": str(outcome.out / results.TABLE) if len(outcome.rows) else None,
        "log": str(log_path(outcome.out)) if outcome.failed or outcome.scores_failed else None,
        "page": None if page is None else str(page),
        "study": [str(path) for path in paths],
        "notes": notes,
    }


def show(outcome: Outcome, comparisons: Sequence[Comparison]) -> None:
    """Print the tables, write the study's files and the page, print what failed and why, and where everything is."""
    if (outcome.rows["status"] == "ok").any():
        named = _named_metrics(outcome.job)
        shown = (
            [compare.only(table, [*named, RESTORATION]) for table in comparisons]
            if named
            else comparisons
        )
        for block in as_blocks(shown, terminal.out.width, bool(named)):
            terminal.out.print(block)
            click.echo()
        words = shlex.join(["sucre-bench", "compare", str(outcome.out)])
        click.echo(f"more: {words} --intervals --all-metrics")
    for hint in outcome.hints:
        terminal.show(
            f"hint     {hint.where}, in {hint.n_views} of {counted(hint.n_read, 'view')}: {hint.text}",
            style="yellow",
        )
    for line in seen_in_training(outcome.out, outcome.rows):
        terminal.show(f"trained on  {line}", style="yellow")
    study, notes, page = _written(outcome, comparisons)
    for colour, kind, faults in (
        ("red", "failed", (*outcome.failed, *outcome.scores_failed)),
        ("yellow", "skipped", outcome.skipped),
    ):
        for line in _grouped(faults):
            terminal.show(f"{kind}  {line}", style=colour)
    if (outcome.rows["status"] == "skipped").any():
        for missing in unscored(outcome.rows, outcome.nothing_scored):
            terminal.show(
                f"not scored  {missing}", style="yellow" if outcome.nothing_scored else "dim"
            )
    if outcome.interrupted:
        click.echo("stopped; the same command continues from here")
    made = f" ({outcome.cached} cached)" if outcome.cached else ""
    scores = f", {len(outcome.scores_failed)} scores failed" if outcome.scores_failed else ""
    click.echo(
        f"{outcome.ok} ok{made}, {len(outcome.failed)} failed, {len(outcome.skipped)} skipped{scores}"
    )
    if outcome.failed or outcome.scores_failed:
        click.echo(f"log      {log_path(outcome.out)}")
    click.echo(f"results  {outcome.out}")
    for note in notes:
        terminal.show(note, style="yellow")
    for folder in dict.fromkeys(path.parent for path in study):
        click.echo(f"{folder.name:9}{folder}{os.sep}")
    if page is not None:
        click.echo(f"page     {page}")


def _named_metrics(job: Job) -> Sequence[str]:
    """The metrics that the command or its study names; none if the command takes those of every run."""
    if job.study is not None and job.study.metrics:
        return job.study.metrics
    if hydra_configs.metrics_of_every_run() <= {metric.plugin.name for metric in job.metrics}:
        return ()
    return [
        f"{metric.plugin.name}:{variant}"
        for metric in job.metrics
        for variant in metric.variants
    ]


def _written(
    outcome: Outcome, comparisons: Sequence[Comparison]
) -> tuple[Sequence[Path], Sequence[str], Path | None]:
    """Write what is wanted: the tables and figures that the command's experiment asks for, and the page.

    Returns the files of the experiment and its notes, and the page.
    """
    paths = tuple[Path, ...]()
    notes = list[str]()
    page = None
    if outcome.job.study is not None:
        from sucre_bench.reports import paper

        made = paper.write(
            outcome.job.study,
            outcome.requested_rows,
            outcome.out,
            outcome.methods,
            outcome.datasets,
        )
        paths = made.paths
        notes = [*made.notes]
    if outcome.job.report and len(outcome.rows):
        from sucre_bench.reports.page import write

        page = write(outcome.out, outcome.rows, comparisons)
    return paths, notes, page


def _grouped(faults: Sequence[Fault]) -> Iterator[str]:
    """A line a reason; many views that share one are counted."""
    by_reason: dict[tuple[str, str], list[str]] = {}
    for fault in faults:
        by_reason.setdefault((fault.where, without_view(fault.reason, fault.view)), []).append(
            fault.view
        )
    for (where, reason), views in by_reason.items():
        which = views[0] if len(views) == 1 else f"{len(views)} views"
        yield escaped_breaks(f"{where} / {which}: {with_remedy(reason)}")
