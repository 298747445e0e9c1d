"""Explains a mistake in a command's words, with the words that were probably meant."""

from __future__ import annotations

import difflib
import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import get_args

from sucre_bench import plugins
from sucre_bench.errors import InputError, in_one_line, unknown_name
from sucre_bench.jobs.catalogue import default_choice, option_names, plugin_of, presets
from sucre_bench.jobs.lineup import Entry, Kind, LineUp
from sucre_bench.jobs.run_options import RunConfig
from sucre_bench.jobs.words import Word, quoted
from sucre_bench.machine.files import expanded
from sucre_bench.plugins.options import options_of


def is_bare(word: str) -> bool:
    """Whether a word has no key: neither key=value nor ~key."""
    return "=" not in word and not word.startswith("~")


def refuse_words(words: Sequence[str]) -> None:
    """Raise InputError for words that are no key=value, with the command that was probably meant."""
    for word in words:
        if word.splitlines() not in ([], [word]):
            raise InputError(f"{in_one_line(word)!r}: holds a line break; give each word in one line")
    bare = [word for word in words if is_bare(word)]
    if not bare:
        return
    if bare[0].partition(".")[0] in ("method", "dataset", "metrics", "degrade", "study") and "." in bare[0]:
        raise InputError("has no value", bare[0], f"an override reads key=value, write {bare[0]}=VALUE")
    keyed: dict[str, list[str]] = {}
    for word in bare:
        key, name = next(_meanings(word, "dataset" in keyed), ("", ""))
        keyed.setdefault(key, []).append(name)
    remedy = "`sucre-bench list methods` and `list datasets` show the names"
    if "" not in keyed:
        several = "-m " if any(len(names) > 1 for key, names in keyed.items() if key != "metrics") else ""
        meant = [f"{key}=[{','.join(n)}]" if key == "metrics" else f"{key}={','.join(n)}" for key, n in keyed.items()]
        remedy = f"write sucre-bench run {several}{shlex.join([*meant, *(w for w in words if not is_bare(w))])}"
    raise InputError("an override reads key=value", bare[0], remedy)


def _meanings(word: str, has_dataset: bool) -> Iterator[tuple[str, str]]:
    """What a bare word may mean, likeliest first: the key that goes before it, and the name."""
    names = {
        "dataset": [*plugins.discover("dataset")],
        "method": [*plugins.discover("method"), *(preset.name for preset in presets("method"))],
        "metrics": [*plugins.discover("metric")],
        "experiment": [preset.name for preset in presets("experiment")],
    }
    yield from ((key, word) for key, known in names.items() if word in known and not (key == "dataset" and has_dataset))
    if expanded(word).is_dir():
        yield "dataset", quoted(word if "/" in word else f"./{word}")
    near = {name: key for key, known in names.items() for name in known}
    yield from ((near[name], name) for name in difflib.get_close_matches(word, near, n=1, cutoff=0.7))


def refuse_values(typed: Sequence[Word], is_sweep: bool) -> None:
    """Raise InputError for several values where no sweep was asked for, and for a path that has a comma."""
    for word in typed:
        key, value = word.key, word.text.partition("=")[2]
        quotes = f'"{key}={quoted(value)}"'
        if word.is_swept and os.path.exists(value):  # noqa: PTH110 - pathlib's raises OSError for a long list of values
            raise InputError("is one path with a comma", word.text, f"write {quotes} with both kinds of quotes")
        if word.is_swept and key in ("metrics", "views") and not value.startswith("["):
            raise InputError("several values", word.text, f"write {key}=[{value}]")
        if word.is_swept and not is_sweep:
            raise InputError("several values", word.text, f"add -m to run them all, or write {quotes} for a comma")
        if key == "hydra/launcher" and not is_sweep:
            raise InputError("hands out the jobs of a sweep", word.text, "add -m")


def refuse_option_of_no_dataset(typed: Sequence[Word], line_up: LineUp) -> None:
    """Raise InputError for a dataset's option where no dataset is named: the built-in one would take it.

    A line-up may leave the dataset open or name several; where the data are needs a dataset in the words.
    """
    plugin = plugin_of("dataset", default_choice("dataset"))
    paths = {o.name for o in options_of(plugin.cls) if Path in (o.type, *get_args(o.type))} if plugin else set()
    for word in () if any(word.key == "dataset" for word in typed) else typed:
        if word.head == "dataset" and (word.key.partition(".")[2] in paths or not line_up.place):
            remedy = f"add dataset=NAME, for example dataset=colmap {word.text}"
            raise InputError("no dataset is named", word.text, remedy)


def unknown_word(word: Word, chosen: Mapping[Kind, Sequence[Entry]], line_up: LineUp) -> InputError | None:
    """Return the fault of a word that is no option of a chosen dataset or method; None for a key of the run.

    line_up: words may have replaced its datasets or methods.
    """
    text, key, head, dot = word.text, word.key, word.head, "." in word.key
    known = [option.name for option in options_of(RunConfig)]
    if head in known:
        return None
    for kind, entries in chosen.items():
        names = ",".join(dict.fromkeys(entry.name for entry in entries))
        owners = dict.fromkeys(entry.name for entry in entries if key in option_names(kind, entry.name))
        if owners:
            before = [kind] if len(entries) == 1 else [*owners]
            return InputError(f"is an option of a {kind}", text, f"write {' or '.join(f'{b}.{text}' for b in before)}")
        if dot and plugin_of(kind, head):
            return InputError(f"'{head}' is not among the {kind}s", text, f"add it: -m {kind}={names},{head}")
        if dot and head in {entry.label for entry in line_up.entries(kind)}:
            remedy = f"leave out {kind}={names} or {key}"
            return InputError(f"'{head}' is not among the {kind}s of this run", text, remedy)
    if dot and plugin_of("metric", head):
        return InputError("is an option of a metric", text, f"write metrics.{text}")
    owned = {name for entries in chosen.values() for entry in entries for name in (entry.name, entry.label) if name}
    return unknown_name(key, head, {*known, *owned})
