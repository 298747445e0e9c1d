"""`sucre-bench study`: ask people which restored images they prefer, and evaluate their votes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sucre_bench.commands import shared
from sucre_bench.machine import progress, terminal
from sucre_bench.machine.files import check_links, check_output
from sucre_bench.machine.terminal import say
from sucre_bench.machine.text_formats import counted

if TYPE_CHECKING:
    from sucre_bench.programs.people.evaluate import Evaluated


@click.command()
@shared.argument("folder")
@shared.option("--methods", default="", metavar="A,B", help="Labels of the methods to compare.")
@shared.path_option("--out", metavar="FILE.html", help="The page to write.")
@shared.dataset_option
@shared.option("--question", default="", metavar="TEXT", help="The question on the page.")
@shared.option("--pairs", default=20, of=click.IntRange(2, 500), help="Pairs in one sitting.")
@shared.option(
    "--views", default=12, of=click.IntRange(1, 200), help="Most views, evenly spread."
)
@shared.option(
    "--width",
    default=1200,
    of=click.IntRange(100, 8000),
    help="Greatest width of a picture, in pixels.",
)
@shared.option(
    "--pixels",
    of=("common", "own"),
    help="If methods leave holes: show only the pixels that all methods fill, or all pixels of each picture.",
)
@shared.flag("--votes", help="Evaluate the files of votes after FOLDER.")
@shared.argument("files", nargs=-1, metavar="[VOTES.json]...")
@shared.json_option
@shared.force_option
def study(
    folder: Path,
    methods: str,
    out: Path | None,
    dataset: str,
    question: str,
    pairs: int,
    views: int,
    width: int,
    pixels: str,
    votes: bool,
    files: Sequence[Path],
    as_json: bool,
    force: bool,
) -> None:
    """Ask people which restored images they prefer, without names, and evaluate their votes.

    \b
    sucre-bench study results --methods sucre,mlle,gray_world --out study.html
    sucre-bench study results --votes votes-*.json

    Send study.html to people. The page shows pairs of pictures, opens from disk in any browser, and saves a file of
    votes. It does not name methods; the key stays in results/people/.

    --votes prints how strongly people prefer each method (Bradley-Terry scores with 95 % intervals), whether people
    agree with each other, and which metrics agree with them. It adds the metric `preference` to the score table.
    """
    if votes:
        _evaluate(folder, files, as_json)
    elif files:
        raise click.UsageError(f"{files[0]}: give files of votes behind --votes")
    elif out is None:
        raise click.UsageError(
            "give --methods A,B --out FILE.html to write a page, or --votes FILE... to evaluate"
        )
    else:
        from sucre_bench.programs.people import design

        check_output(out, "page", force=force)
        check_links(folder)
        key = design.design(folder, shared.labels_of(methods), dataset, views)
        masks = design.common_masks(folder, key) if pixels == "common" else {}
        with progress.live():
            design.write_page(
                out, folder, key, question or design.QUESTION, pairs, width, masks
            )
        path = design.write_key(folder, key)
        n_views = len(key.pictures) // len(key.methods)
        size = f"{out.stat().st_size / 1e6:.1f} MB"
        click.echo(f"page     {out}, {size}: {len(key.methods)} methods on {n_views} views")
        if masks:
            share = sum(mask.mean() for mask in masks.values()) / len(masks)
            click.echo(
                f"gray     what some method leaves empty: in {len(masks)} of {n_views} views,"
                f" {1 - share:.0%} of them on average"
            )
        click.echo(f"key      {path}: keep it, and do not send it")
        click.echo(f"then     sucre-bench study {folder} --votes FILES-THAT-PEOPLE-SEND-BACK")


def _evaluate(folder: Path, files: Sequence[Path], as_json: bool) -> None:
    from sucre_bench.compare.words import number, signed
    from sucre_bench.programs.people import evaluate

    if not files:
        raise click.UsageError("--votes: no files; give those that the page saved")
    found = evaluate.evaluate(folder, files)
    for line in found.skipped:
        say(line, "yellow")
    n_rows = evaluate.store(folder, found)
    if as_json:
        shared.print_json(_as_object(found))
        return
    numbered = found.numbered
    people, wins = found.people, numbered.votes.wins
    ties = int((numbered.votes.won == 0.5).sum())
    by = f"{counted(len(numbered.observers), 'observer')} on {len(numbered.views)} views"
    click.echo(f"{found.dataset}: {len(numbered.votes)} votes of {by}, {ties} for equal\n")
    shares = wins.sum(axis=1) / (wins + wins.T).sum(axis=1)
    preferences = terminal.table(["method"], ["preference", "95 % interval", "votes won"])
    for n in (-people.scores).argsort(kind="stable"):  # the preferred one first
        interval = _interval(people.low[n], people.high[n])
        won = f"{100 * shares[n]:.0f} %"
        preferences.add_row(numbered.methods[n], signed(people.scores[n]), interval, won)
    metrics = terminal.table(["metric"], ["tau", "95 % interval", "predicted", "votes"])
    for (metric, variant), one in sorted(
        found.metrics.items(), key=lambda item: -item[1].predicted if item[1].n else 1.0
    ):
        predicted = f"{100 * one.predicted:.0f} %" if one.n else "-"
        interval = _interval(one.low, one.high)
        title = f"{metric} ({variant})"
        metrics.add_row(title, number(one.tau), interval, predicted, str(one.n))
    terminal.out.print(preferences)
    for line in _sentences(found):
        terminal.show(line)
    click.echo()
    if metrics.row_count:
        terminal.out.print(metrics)
        click.echo(_TAU)
    rows = f"{n_rows} of metric preference" if n_rows else f"none: {people.want}"
    click.echo(f"rows     {rows}")


def _interval(low: float, high: float) -> str:
    from sucre_bench.compare.words import signed

    return f"{signed(low)} to {signed(high)}" if math.isfinite(low) else "-"


_TAU = "tau: order of the methods as people's; predicted: votes for the better score\n"


def _sentences(found: Evaluated) -> Iterator[str]:
    """What the numbers mean: the lead, over what intervals are, and how far observers agree."""
    from sucre_bench.compare.words import number

    people = found.people
    best, next_best = (-people.scores).argsort(kind="stable")[:2].tolist()
    first, second = found.numbered.methods[best], found.numbered.methods[next_best]
    gap, low, high = people.difference(best, next_best)
    interval = f"{number(gap)} [{number(low)}, {number(high)}]"
    if people.want:
        yield f"no interval, so the order may be chance: {people.want}"
    elif low > 0:
        yield f"{first} leads {second} by {interval}, more than chance"
    else:
        yield f"{first} and {second} differ by {interval}, which may be chance"
    agree = "unknown, no pair was judged by several with different answers"
    if not math.isnan(found.observers.alpha):
        alpha = f"Krippendorff's alpha {number(found.observers.alpha)}"
        agree = f"{alpha} on {found.observers.n} pairs (1: full, 0: as by tossing coins)"
    yield f"agreement of observers: {agree}"
    yield "preference: log-odds; 0 = the mean of these methods, +1.1 = 3 of 4 votes against it"


def _as_object(found: Evaluated) -> dict[str, Any]:
    numbered, people = found.numbered, found.people
    scores = zip(numbered.methods, people.scores, people.low, people.high, strict=True)
    return {
        "dataset": found.dataset,
        "votes": len(numbered.votes),
        "observers": len(numbered.observers),
        "views": len(numbered.views),
        "missing": people.want,
        "preference": [{"method": m, "score": s, "low": a, "high": b} for m, s, a, b in scores],
        "agreement": asdict(found.observers),
        "metrics": [
            {"metric": m, "variant": v, **asdict(a)} for (m, v), a in found.metrics.items()
        ],
        "skipped": list(found.skipped),
    }
