"""From files of votes to preferences of methods, agreement, and rows of the metric `preference`."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sucre_bench import results
from sucre_bench.errors import InputError
from sucre_bench.machine.text_formats import now
from sucre_bench.programs.people import design
from sucre_bench.programs.people.statistics import (
    Agreement,
    MetricAgreement,
    Preferences,
    metric_agreement,
    observer_agreement,
    preferences,
    pseudo_values,
)
from sucre_bench.programs.people.votes import Numbered, as_numbers, read_votes
from sucre_bench.results.rows import COSTS, PREFERENCE, restorations, row_objects

_VERSION = 1


@dataclass(frozen=True, eq=False)
class Evaluated:
    """What people's votes say.

    dataset: its label; numbered: the votes that count; people: scores of `numbered.methods`; observers: how far they
    agree; metrics: how far each metric's variant agrees with people; skipped: votes and files that do not count.
    """

    dataset: str
    numbered: Numbered
    people: Preferences
    observers: Agreement
    metrics: dict[tuple[str, str], MetricAgreement]
    skipped: tuple[str, ...]


def evaluate(folder: Path, paths: Sequence[Path]) -> Evaluated:
    """Evaluate files of votes on the restored images of a results folder.

    Raises InputError if no vote counts, or votes are of several datasets.
    """
    rows, known = results.read(folder), design.keys(folder)
    if not known:
        raise InputError(f"{folder}: has no people's study; write its page with --methods A,B --out study.html")
    valid = {design.Shown.of_row(row) for row in restorations(rows).itertuples()}
    votes, skipped = read_votes(paths, known, valid)
    dataset, *others = sorted({known[vote.study].dataset for vote in votes})
    if others:
        raise InputError(f"--votes: of several datasets, {', '.join([dataset, *others])}; give those of one")
    numbered = as_numbers(votes)
    people = preferences(numbered.votes)
    # Each metric by which methods win or lose, in each variant, against people.
    is_score = (rows["status"] == "ok") & (rows["better"] != "none") & ~rows["metric"].isin([*COSTS, PREFERENCE])
    is_score &= (rows["dataset"] == dataset) & ~rows["region"].str.contains("/", regex=False)
    agreements = {}
    for (metric, variant), of_metric in rows[is_score].groupby(["metric", "variant"], sort=False):
        table = of_metric.groupby(["scene", "view", "method"])["value"].mean().unstack("method")
        table = table.reindex(index=numbered.views, columns=numbered.methods)
        is_lower = str(of_metric["better"].iloc[0]) == "lower"
        agreements[str(metric), str(variant)] = metric_agreement(table.to_numpy(), is_lower, numbered.votes, people)
    return Evaluated(dataset, numbered, people, observer_agreement(numbered.votes), agreements, tuple(skipped))


def store(folder: Path, found: Evaluated) -> int:
    """Write the preferences as rows of the score table, and return how many: one for each view and method.

    Votes that are too few for intervals give none, since `compare` would show them with intervals over views.

    The row of a view has its jackknife value, see `pseudo_values`. `compare` then shows the Bradley-Terry score with an
    interval over views.
    """
    if found.people.want:
        return 0
    numbered = found.numbered
    values = pseudo_values(numbered.votes, len(numbered.views))
    by_place = {
        (*place, method): float(values[v, m])
        for v, place in enumerate(numbered.views)
        for m, method in enumerate(numbered.methods)
    }
    # Scores of other sets of methods have another zero.
    code = hashlib.blake2b(repr((_VERSION, tuple(numbered.methods))).encode(), digest_size=6).hexdigest()
    score: dict[str, Any] = {
        "metric": PREFERENCE,
        "variant": "bradley-terry",
        "unit": "log-odds",
        "better": "higher",
        "time": now(),
    }
    rows = results.read(folder)
    made = [
        replace(row, **score, value=by_place[place], code=f"{row.code.split('.')[0]}.{code}")
        for row in row_objects(restorations(rows[rows["dataset"] == found.dataset]))
        if (place := (row.scene, row.view, row.method)) in by_place
    ]
    results.write_rows(folder, PREFERENCE, made)
    results.merge(folder)
    return len(made)
