"""Reads the files of votes that a study's page saved. They come from strangers, so everything in them is checked."""

import json
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from sucre_bench.errors import InputError
from sucre_bench.machine.files import regular
from sucre_bench.programs.people.design import Key, Shown
from sucre_bench.programs.people.statistics import Numbers, Votes

_FORMAT = ("sucre_bench votes", 1)
_MOST_BYTES = 16 << 20
_WON = {"left": 1.0, "tie": 0.5, "right": 0.0}

T = TypeVar("T")


@dataclass(frozen=True)
class Vote:
    """What an observer said of two pictures of one view. won: 1 if the left was preferred, 0.5 for a tie, else 0."""

    study: str
    observer: str
    left: Shown
    right: Shown
    won: float


def read_votes(
    paths: Sequence[Path], keys: Mapping[str, Key], valid: Collection[Shown]
) -> tuple[list[Vote], list[str]]:
    """Return the votes of files that count, and a line for each file, or kind of vote, that does not.

    keys: by study; valid: pictures that are still what the page showed. A vote that several files hold counts once.
    Raises InputError if no vote is left, with the reasons.
    """
    votes: dict[tuple[str, str, int], Vote] = {}
    skipped: list[str] = []
    for path in paths:
        reasons: Counter[str] = Counter()
        try:
            for n, vote in _votes(path, keys, reasons):
                if not (vote.left in valid and vote.right in valid):
                    reasons["show pictures that were restored anew since"] += 1
                elif (place := (vote.study, vote.observer, n)) in votes:
                    reasons["are in another file, too" if votes[place] == vote else "contradict another file"] += 1
                else:
                    votes[place] = vote
        except InputError as fault:
            skipped.append(str(fault))
        skipped += [f"{path}: {count} votes {reason}; they do not count" for reason, count in reasons.items()]
    if not votes:
        raise InputError("\n".join([*skipped, "--votes: no vote counts; give files that the study's page saved"]))
    return list(votes.values()), skipped


def _votes(path: Path, keys: Mapping[str, Key], reasons: Counter[str]) -> Iterator[tuple[int, Vote]]:
    """Yield the votes of a file with their numbers; reasons: counts those that are none."""
    remedy = "give a file that the study's page saved"
    try:
        if regular(path).stat().st_size > _MOST_BYTES:
            raise ValueError("larger than 16 MB")
        told = json.loads(path.read_bytes())
        study, observer, given = told["study"], told["observer"], list(told["votes"])
        if (told["format"], told["version"]) != _FORMAT or not (isinstance(observer, str) and 1 <= len(observer) <= 64):
            raise ValueError("another format")
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as fault:
        reason = fault.strerror if isinstance(fault, OSError) else "no votes in it"
        raise InputError(f"cannot be read, {reason}", path, remedy) from fault
    if not isinstance(study, str) or study not in keys:
        raise InputError(f"is of another study, '{str(study)[:20]}'", path, "give it with the results it is of")
    for one in given:
        vote = _vote(one, keys[study], observer)
        if isinstance(vote, str):
            reasons[vote] += 1
        else:
            yield vote


def _vote(one: Any, key: Key, observer: str) -> tuple[int, Vote] | str:
    """A vote and its number, or why it is none."""
    try:
        n, won, left, right = one["n"], _WON[one["choice"]], key.pictures[one["left"]], key.pictures[one["right"]]
    except (KeyError, TypeError):
        return "are damaged, or name pictures that the study does not have"
    if not isinstance(n, int):
        return "are damaged"
    if (left.scene, left.view) != (right.scene, right.view) or left.method == right.method:
        return "compare pictures that the study does not compare"
    return n, Vote(key.study, observer, left, right, won)


@dataclass(frozen=True, eq=False)
class Numbered:
    """Votes as numbers, and what the numbers mean, each in the order of names: views as (scene, view)."""

    votes: Votes
    methods: list[str]
    views: list[tuple[str, str]]
    observers: list[str]


def as_numbers(votes: Sequence[Vote]) -> Numbered:
    """Number methods, views and observers of votes."""
    sides, methods = _numbered([vote.left.method for vote in votes] + [vote.right.method for vote in votes])
    places, views = _numbered([(vote.left.scene, vote.left.view) for vote in votes])
    people, observers = _numbered([vote.observer for vote in votes])
    won = np.array([vote.won for vote in votes])
    numbers = Votes(len(methods), sides[: len(votes)], sides[len(votes) :], won, places, people)
    return Numbered(numbers, methods, views, observers)


def _numbered(values: Sequence[T]) -> tuple[Numbers, list[T]]:
    known = sorted(set(values))  # type: ignore[type-var]
    numbers = {value: n for n, value in enumerate(known)}
    return np.array([numbers[value] for value in values]), known
