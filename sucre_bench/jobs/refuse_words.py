"""Refuses words of a command that do not say what to do, with the words that were probably meant."""

from __future__ import annotations

import difflib
import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from sucre_bench import plugins
from sucre_bench.errors import InputError, in_one_line
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.lineup import LineUp
from sucre_bench.jobs.presets import default_choice, plugin_of, presets
from sucre_bench.jobs.quoting import quoted
from sucre_bench.machine.files import expanded
from sucre_bench.plugins.options import options_of
from sucre_bench.results.layout import file_name

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override
    from omegaconf import DictConfig


def refuse_line_breaks(words: Sequence[str]) -> None:
    """Raise InputError for a word that holds a line break."""
    for word in words:
        if word.splitlines() not in ([], [word]):
            raise InputError(f"{in_one_line(word)!r}: holds a line break; give each word in one line")


def is_bare(word: str) -> bool:
    """Whether a word has no key: neither key=value nor ~key."""
    return "=" not in word and not word.startswith("~")


def refuse_bare_words(words: Sequence[str]) -> None:
    """Raise InputError for words that are no key=value, with the command that was probably meant."""
    bare = [word for word in words if is_bare(word)]
    if not bare:
        return
    if bare[0].partition(".")[0] in ("method", "dataset", "metrics", "degrade", "study") and "." in bare[0]:
        raise InputError("has no value", bare[0], f"an override reads key=value, write {bare[0]}=VALUE")
    meant = _meant(words)
    remedy = f"write {meant}" if meant else "`sucre-bench list methods` and `list datasets` show the names"
    raise InputError("an override reads key=value", bare[0], remedy)


def _meant(words: Sequence[str]) -> str:
    """The command with a key before each bare word; empty where a word is like no name."""
    keyed: dict[str, list[str]] = {}
    for word in filter(is_bare, words):
        key, name = next(_readings(word, keyed), ("", ""))
        if not key:
            return ""
        keyed.setdefault(key, []).append(name)
    several = "-m " if any(len(names) > 1 for key, names in keyed.items() if key != "metrics") else ""
    said = [f"{key}=[{','.join(n)}]" if key == "metrics" else f"{key}={','.join(n)}" for key, n in keyed.items()]
    return f"sucre-bench run {several}{shlex.join([*said, *(word for word in words if not is_bare(word))])}"


def _readings(word: str, keyed: Iterable[str]) -> Iterator[tuple[str, str]]:
    """What a bare word may be, likeliest first: the key that goes before it, and the name that is meant."""
    names = {
        "dataset": [*plugins.discover("dataset")],
        "method": [*plugins.discover("method"), *(preset.name for preset in presets("method"))],
        "metrics": [*plugins.discover("metric")],
        "experiment": [preset.name for preset in presets("experiment")],
    }
    yield from ((key, word) for key, known in names.items() if word in known and (key != "dataset" or key not in keyed))
    if expanded(word).is_dir():
        yield "dataset", quoted(word if "/" in word else f"./{word}")
    near = {name: key for key, known in names.items() for name in known}
    yield from ((near[name], name) for name in difflib.get_close_matches(word, near, n=1, cutoff=0.7))


def refuse_options_of_no_dataset(parsed: Sequence[Override], line_up: LineUp) -> None:
    """Raise InputError for a dataset's option where no dataset is named: the built-in one would take it.

    A line-up may leave the dataset open or name several; where the data are needs a dataset in the words.
    """
    if any(override.key_or_group == "dataset" for override in parsed):
        return
    plugin = plugin_of("dataset", default_choice("dataset"))
    paths = {o.name for o in options_of(plugin.cls) if Path in (o.type, *get_args(o.type))} if plugin else set()
    for override in parsed:
        head, _, option = override.key_or_group.partition(".")
        if head == "dataset" and (option in paths or not line_up.place):
            word = override.input_line
            raise InputError("no dataset is named", word, f"add dataset=NAME, for example dataset=colmap {word}")


def refuse_several_values(parsed: Sequence[Override], is_sweep: bool) -> None:
    """Raise InputError for several values where no sweep was asked for, and for a path that has a comma."""
    for override in parsed:
        word, key = override.input_line, override.key_or_group
        if override.is_sweep_override():
            value = override.get_value_string()
            if Path(value).exists():
                remedy = f'write "{key}={quoted(value)}" with both kinds of quotes'
                raise InputError("is one path with a comma", word, remedy)
            if key in ("metrics", "views") and not value.startswith("["):
                raise InputError("several values", word, f"write {key}=[{value}]")
            if not is_sweep:
                remedy = f'add -m to run them all, or write "{key}={quoted(value)}" for a comma'
                raise InputError("several values", word, remedy)
        elif key == "hydra/launcher" and not is_sweep:
            raise InputError("hands out the jobs of a sweep", word, "add -m")


def refuse_foreign(base: DictConfig) -> None:
    """Raise InputError for what Hydra has and a command here does not follow."""
    if base.hydra.job.chdir:
        raise InputError("paths are relative to the folder where you are", "hydra.job.chdir=true", "leave it false")
    if base.hydra.callbacks:
        raise InputError("sucre-bench calls none", "hydra.callbacks", "leave them out")
    if not base.hydra.sweeper["_target_"].endswith(".BasicSweeper"):
        name = base.hydra.runtime.choices["hydra/sweeper"]
        raise InputError(
            "chooses values during a run, but all jobs are checked before", f"hydra/sweeper={name}", "use basic"
        )


def refuse_same_place(planned: Sequence[Job]) -> None:
    """Raise InputError if two jobs would write to one place."""
    seen: dict[tuple[str, str, int, int, int], Job] = {}
    for job in planned:
        part = (job.replicate, job.shard.index, job.shard.count)
        other = seen.setdefault((file_name(job.dataset.label), file_name(job.method.label), *part), job)
        if other is not job:
            name = f"{job.dataset.label} / {job.method.label}"
            if (other.method, other.dataset) != (job.method, job.dataset):
                of = "method" if other.dataset == job.dataset else "dataset"
                raise InputError(f"two jobs of this sweep would both be '{name}'; tell them apart with {of}.label=...")
            raise InputError(f"two jobs of this sweep are the same, '{name}'; sweep over datasets, methods or options")
