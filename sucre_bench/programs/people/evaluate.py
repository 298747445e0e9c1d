"""From files of votes to preferences of methods, agreement, and rows of the metric `preference`."""

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sucre_bench import results
from sucre_bench.arrays import DataFrame
from sucre_bench.errors import InputError, LinesError
from sucre_bench.machine.files import read_json, reading, regular
from sucre_bench.machine.text_formats import now
from sucre_bench.programs.people import design, statistics
from sucre_bench.programs.people.design import Key, Shown
from sucre_bench.results.rows import COSTS, PREFERENCE, RowCode, restorations, row_objects

_VERSION = 1
_FORMAT = ("sucre_bench votes", 1)
_MOST_BYTES = 16 << 20
_WON = {"left": 1.0, "tie": 0.5, "right": 0.0}

# -- the files, which come from strangers: everything in them is checked ---------------------------------------------


def read_votes(
    paths: Sequence[Path], keys: Mapping[str, Key], valid: Collection[Shown]
) -> tuple[DataFrame, list[str]]:
    """Return the votes of files, a row a vote, and a line for each file that does not count, or not whole.

    keys: by study; valid: pictures that are still what the page showed. A vote that several files hold counts once.
    Raises InputError if no vote is left, with the reasons.
    """
    tables = []
    skipped = []
    for path in paths:
        try:
            votes = pd.DataFrame(_votes(path, keys))
        except InputError as fault:
            skipped.append(str(fault))
            continue
        still = votes["left"].isin(valid) & votes["right"].isin(valid)
        if not still.all():
            skipped.append(
                f"{path}: {(~still).sum()} votes show pictures that were restored anew"
            )
        tables.append(votes[still])
    every = pd.concat(tables) if tables else pd.DataFrame()
    if every.empty:
        raise LinesError("\n".join(skipped))
    once = every.drop_duplicates(["study", "observer", "n"])
    if len(once) < len(every):
        skipped.append(
            f"{len(every) - len(once)} votes are in several files; those of the first file count"
        )
    return once, skipped


def _votes(path: Path, keys: Mapping[str, Key]) -> list[dict[str, Any]]:
    """The votes of a file. Raises InputError if any of them is none."""
    remedy = "give a file that the study's page saved"
    with reading(path, remedy):
        if regular(path).stat().st_size > _MOST_BYTES:
            raise ValueError("larger than 16 MB")
        told = read_json(path, remedy, of_data=True)
        study = told["study"]
        observer = told["observer"]
        is_named = isinstance(observer, str) and 1 <= len(observer) <= 64
        if (told["format"], told["version"]) != _FORMAT or not is_named:
            raise ValueError("another format")
        if study not in keys:
            raise InputError(
                f"is of another study, '{str(study)[:20]}'",
                path,
                "give it with the results it is of",
            )
        votes = []
        for one in told["votes"]:
            left = keys[study].pictures[one["left"]]
            right = keys[study].pictures[one["right"]]
            is_pair = (left.scene, left.view) == (right.scene, right.view)
            if not is_pair or left.method == right.method or not isinstance(one["n"], int):
                raise ValueError("a vote on pictures that the study does not compare")
            won = _WON[one["choice"]]
            names = {"study": study, "observer": observer, "n": one["n"]}
            votes.append({**names, "left": left, "right": right, "won": won})
        if not votes:
            raise ValueError("no vote")
        return votes


@dataclass(frozen=True, eq=False)
class Numbered:
    """Votes as numbers, and what the numbers mean, each in the order of names: views as (scene, view)."""

    votes: statistics.Votes
    methods: list[str]
    views: list[tuple[str, str]]
    observers: list[str]


def as_numbers(votes: DataFrame) -> Numbered:
    """Number methods, views and observers of votes."""
    both = [
        (left.method, right.method)
        for left, right in zip(votes["left"], votes["right"], strict=True)
    ]
    sides, methods = pd.Index(np.ravel(both)).factorize(True)
    places, views = pd.MultiIndex.from_tuples(
        [(left.scene, left.view) for left in votes["left"]]
    ).factorize(True)
    people, observers = pd.Index(votes["observer"]).factorize(True)
    won = votes["won"].to_numpy()
    numbers = statistics.Votes(len(methods), sides[::2], sides[1::2], won, places, people)
    return Numbered(numbers, methods.tolist(), views.tolist(), observers.tolist())


# -- what they say -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Evaluated:
    """What people's votes say."""

    dataset: str
    """Its label."""

    numbered: Numbered
    """The votes that count."""

    people: statistics.Preferences
    """Scores of `numbered.methods`."""

    observers: statistics.Agreement
    """How far they agree."""

    metrics: dict[tuple[str, str], statistics.MetricAgreement]
    """How far each metric's variant agrees with people."""

    skipped: tuple[str, ...]
    """Votes and files that do not count."""


def evaluate(folder: Path, paths: Sequence[Path]) -> Evaluated:
    """Evaluate files of votes on the restored images of a results folder.

    Raises InputError if no vote counts, or votes are of several datasets.
    """
    rows, known = results.read(folder), design.keys(folder)
    if not known:
        raise InputError(
            f"{folder}: has no people's study; write its page with --methods A,B --out study.html"
        )
    valid = {design.Shown.of_row(row) for row in restorations(rows).itertuples()}
    votes, skipped = read_votes(paths, known, valid)
    dataset, *others = sorted({known[study].dataset for study in votes["study"]})
    if others:
        raise InputError(
            f"--votes: of several datasets, {', '.join([dataset, *others])}; give those of one"
        )
    numbered = as_numbers(votes)
    people = statistics.preferences(numbered.votes)
    # Each metric by which methods win or lose, in each variant, against people.
    scores = rows[(rows["dataset"] == dataset) & (rows["status"] == "ok")]
    scores = scores[(scores["better"] != "none") & ~scores["metric"].isin([*COSTS, PREFERENCE])]
    scores = scores[~scores["region"].str.contains("/", regex=False)]
    agreements = {}
    for (metric, variant), of_metric in scores.groupby(["metric", "variant"], sort=False):
        table = of_metric.groupby(["scene", "view", "method"])["value"].mean().unstack("method")
        table = table.reindex(index=numbered.views, columns=numbered.methods)
        is_lower = str(of_metric["better"].iloc[0]) == "lower"
        agreements[str(metric), str(variant)] = statistics.metric_agreement(
            table.to_numpy(), is_lower, numbered.votes, people
        )
    return Evaluated(
        dataset,
        numbered,
        people,
        statistics.observer_agreement(numbered.votes),
        agreements,
        tuple(skipped),
    )


def store(folder: Path, found: Evaluated) -> int:
    """Write the preferences as rows of the score table, and return how many: one for each view and method.

    Votes that are too few for intervals give none, since `compare` would show them with intervals over views.

    The row of a view has its jackknife value, see `pseudo_values`. `compare` then shows the Bradley-Terry score with an
    interval over views.
    """
    if found.people.want:
        return 0
    numbered = found.numbered
    values = statistics.pseudo_values(numbered.votes, len(numbered.views))
    by_place = {
        (*place, method): float(values[v, m])
        for v, place in enumerate(numbered.views)
        for m, method in enumerate(numbered.methods)
    }
    # Scores of other sets of methods have another zero.
    code = hashlib.blake2b(
        repr((_VERSION, tuple(numbered.methods))).encode(), digest_size=6
    ).hexdigest()
    score: dict[str, Any] = {
        "metric": PREFERENCE,
        "variant": "bradley-terry",
        "unit": "log-odds",
        "better": "higher",
        "time": now(),
    }
    rows = results.read(folder)
    made = [
        replace(
            row,
            **score,
            value=by_place[place],
            code=str(RowCode(RowCode.read(row.code).restoration, code)),
        )
        for row in row_objects(restorations(rows[rows["dataset"] == found.dataset]))
        if (place := (row.scene, row.view, row.method)) in by_place
    ]
    results.write_rows(folder, PREFERENCE, made)
    results.merge(folder)
    return len(made)
