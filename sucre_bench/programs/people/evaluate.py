"""From files of votes to preferences of methods, agreement, and rows of the metric `preference`."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sucre_bench import results
from sucre_bench.arrays import Array, DataFrame
from sucre_bench.errors import InputError
from sucre_bench.machine.records import now
from sucre_bench.programs.people import design
from sucre_bench.programs.people.agreement import Agreement, MetricAgreement, metric_agreement, observer_agreement
from sucre_bench.programs.people.bradley_terry import Preferences, Votes, fit, preferences
from sucre_bench.programs.people.votes import Numbered, as_numbers, read_votes
from sucre_bench.results.rows import COSTS, PREFERENCE, restorations, row_objects

METRIC, _VARIANT, _UNIT = PREFERENCE, "bradley-terry", "log-odds"
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
    now = {
        design.Shown(r.scene, r.view, r.method, (r.options_id, r.data_id, r.code))
        for r in restorations(rows).itertuples()
    }
    votes, skipped = read_votes(paths, known, now)
    datasets = sorted({known[vote.study].dataset for vote in votes})
    if len(datasets) > 1:
        raise InputError(f"--votes: of several datasets, {', '.join(datasets)}; give those of one")
    numbered = as_numbers(votes)
    people = preferences(numbered.votes)
    of_dataset = rows[rows["dataset"] == datasets[0]]
    agreements = dict(_agreements(of_dataset, numbered, people))
    return Evaluated(datasets[0], numbered, people, observer_agreement(numbered.votes), agreements, tuple(skipped))


def _agreements(
    rows: DataFrame, numbered: Numbered, people: Preferences
) -> Iterator[tuple[tuple[str, str], MetricAgreement]]:
    """Each metric by which methods win or lose, in each variant, against people."""
    is_score = (rows["status"] == "ok") & (rows["better"] != "none") & ~rows["metric"].isin([*COSTS, METRIC])
    scores = rows[is_score & ~rows["region"].str.contains("/", regex=False)]
    for (metric, variant), of_metric in scores.groupby(["metric", "variant"], sort=False):
        table = of_metric.groupby(["scene", "view", "method"])["value"].mean().unstack("method")
        table = table.reindex(index=list(numbered.views), columns=list(numbered.methods))
        is_lower = str(of_metric["better"].iloc[0]) == "lower"
        yield (str(metric), str(variant)), metric_agreement(table.to_numpy(), is_lower, numbered.votes, people)


# -- rows --------------------------------------------------------------------------------------------------


def store(folder: Path, found: Evaluated) -> int:
    """Write the preferences as rows of the score table, and return how many: one for each view and method.

    Votes that are too few for intervals give none, since `compare` would show them with intervals over views.

    The row of a view has its jackknife pseudo-value (Efron and Tibshirani 1993, ch. 11): V s - (V - 1) s_v, s being the
    score over all V views, s_v that without votes on the view, shifted so that the mean over views is s. `compare`
    then shows the Bradley-Terry score with an interval over views. Of one view the score itself stands there.
    """
    if found.people.want:
        return 0
    values = pseudo_values(found.numbered.votes, len(found.numbered.views))
    rows = results.read(folder)
    whole = restorations(rows[rows["dataset"] == found.dataset])
    # Scores of other sets of methods have another zero.
    code = hashlib.blake2b(repr((_VERSION, found.numbered.methods)).encode(), digest_size=6).hexdigest()
    places = {place: n for n, place in enumerate(found.numbered.views)}
    arms = {name: n for n, name in enumerate(found.numbered.methods)}
    made = []
    for row in row_objects(whole):
        if (row.scene, row.view) in places and row.method in arms:
            value = float(values[places[row.scene, row.view], arms[row.method]])
            of = f"{row.code.split('.')[0]}.{code}"
            score = replace(row, metric=METRIC, variant=_VARIANT, unit=_UNIT, better="higher", value=value, code=of)
            made.append(replace(score, time=now()))
    results.write_rows(folder, METRIC, made)
    results.merge(folder)
    return len(made)


def pseudo_values(votes: Votes, n_views: int) -> Array:
    """Return the value of each view and method (V, M); its mean over views is the score of all votes."""
    scores = fit(votes)
    if n_views < 2:
        return scores[None]
    without = np.stack([fit(votes.of(votes.view != view), scores) for view in range(n_views)])
    values = n_views * scores - (n_views - 1) * without
    return np.asarray(values + scores - values.mean(axis=0))
