"""Reads the files of votes that a study's page saved. They come from strangers, so everything in them is checked."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from sucre_bench.errors import InputError
from sucre_bench.machine.files import regular
from sucre_bench.programs.people.bradley_terry import Votes
from sucre_bench.programs.people.design import Key, Shown

_FORMAT, _VERSION = "sucre_bench votes", 1
_MOST_BYTES = 16 << 20

Choice = Literal["left", "right", "tie"]


@dataclass(frozen=True)
class Vote:
    """What an observer said of two pictures of one view."""

    study: str
    observer: str
    left: Shown
    right: Shown
    choice: Choice


def read_votes(paths: Sequence[Path], keys: Mapping[str, Key], valid: Iterable[Shown]) -> tuple[list[Vote], list[str]]:
    """Return the votes of files that count, and a line for each file, or kind of vote, that does not.

    keys: by study; valid: pictures that are still what the page showed. A vote that several files hold counts once.
    Raises InputError if no vote is left, with the reasons.
    """
    votes: dict[tuple[str, str, int], Vote] = {}
    skipped: list[str] = []
    still_valid = set(valid)
    for path in paths:
        reasons: Counter[str] = Counter()
        try:
            for n, vote in _votes(path, keys, reasons):
                if not {vote.left, vote.right} <= still_valid:
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
    try:
        if regular(path).stat().st_size > _MOST_BYTES:
            raise ValueError("larger than 16 MB")
        told = json.loads(path.read_bytes())
        if not isinstance(told, dict) or (told.get("format"), told.get("version")) != (_FORMAT, _VERSION):
            raise ValueError("another format")
    except (OSError, ValueError, RecursionError) as fault:
        reason = fault.strerror if isinstance(fault, OSError) else "no votes in it"
        raise InputError(f"{path}: cannot be read, {reason}; give a file that the study's page saved") from fault
    study, observer, given = told.get("study"), told.get("observer"), told.get("votes")
    if not isinstance(observer, str) or not 1 <= len(observer) <= 64 or not isinstance(given, list):
        raise InputError(f"{path}: is no file of votes; give one that the study's page saved")
    if not isinstance(study, str) or study not in keys:
        raise InputError(f"{path}: is of another study, '{str(study)[:20]}'; give it with the results it is of")
    for one in given:
        vote = _vote(one, keys[study], observer)
        if isinstance(vote, str):
            reasons[vote] += 1
        else:
            yield vote


def _vote(one: Any, key: Key, observer: str) -> tuple[int, Vote] | str:
    """A vote and its number, or why it is none."""
    if not isinstance(one, dict) or not isinstance(one.get("n"), int) or one.get("choice") not in get_args(Choice):
        return "are damaged"
    sides = [key.pictures.get(name) if isinstance(name, str) else None for name in (one.get("left"), one.get("right"))]
    left, right = sides
    if left is None or right is None:
        return "name pictures that the study does not have"
    if (left.scene, left.view) != (right.scene, right.view) or left.method == right.method:
        return "compare pictures that the study does not compare"
    return one["n"], Vote(key.study, observer, left, right, one["choice"])


@dataclass(frozen=True, eq=False)
class Numbered:
    """Votes as numbers, and what the numbers mean: views as (scene, view)."""

    votes: Votes
    methods: tuple[str, ...]
    views: tuple[tuple[str, str], ...]
    observers: tuple[str, ...]


def as_numbers(votes: Sequence[Vote]) -> Numbered:
    """Number methods, views and observers of votes, each in the order of names."""
    methods = sorted({side.method for vote in votes for side in (vote.left, vote.right)})
    views = sorted({(vote.left.scene, vote.left.view) for vote in votes})
    observers = sorted({vote.observer for vote in votes})
    won = {"left": 1.0, "tie": 0.5, "right": 0.0}
    numbers = Votes(
        len(methods),
        np.array([methods.index(vote.left.method) for vote in votes]),
        np.array([methods.index(vote.right.method) for vote in votes]),
        np.array([won[vote.choice] for vote in votes]),
        np.array([views.index((vote.left.scene, vote.left.view)) for vote in votes]),
        np.array([observers.index(vote.observer) for vote in votes]),
    )
    return Numbered(numbers, tuple(methods), tuple(views), tuple(observers))
