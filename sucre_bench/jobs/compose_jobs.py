"""From the words of a command to its jobs.

Hydra composes the configuration of each choice of dataset, method and metrics once. The words' values take their places
in it, a job for each combination, and the types of the plugins' own fields check them (`Job.of`), before any work.

Every dataset meets every method. A word that begins with the name or label of one of them, `sucre.physical=true`, is
for it alone. A word for methods or datasets in general, `method.physical=true`, is for those that have the option.
"""

from __future__ import annotations

import contextlib
import copy
import functools
import itertools
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from sucre_bench.errors import InputError, SucreBenchError, unknown_name
from sucre_bench.jobs import hydra_configs
from sucre_bench.jobs.asked import Asked, Entry, flat
from sucre_bench.jobs.catalogue import KINDS, SEED
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.read_words import read, reading_experiment
from sucre_bench.jobs.word_syntax import Word, first_line, literal, quoted, value_of
from sucre_bench.results.layout import as_one_file
from sucre_bench.results.rows import fingerprint

if TYPE_CHECKING:
    from omegaconf import DictConfig


@dataclass(frozen=True)
class Command:
    """What the words of a command ask for."""

    jobs: tuple[Job, ...]

    config: DictConfig
    """What Hydra composes of the job, or of what the jobs of a sweep share."""

    words: tuple[str, ...] = ()
    """The overrides, with ~ expanded."""

    is_sweep: bool = False
    """Whether it may have several jobs: by -m, or an experiment."""

    overrides: tuple[tuple[str, ...], ...] = ((),)
    """Of each job, with which Hydra composes it again."""


def jobs(words: Sequence[str], multirun: bool) -> Command:
    """Let Hydra compose the jobs that overrides ask for, or an experiment's file among them, and check every job.

    Raises InputError for an unknown name or option (with the nearest known), a wrong type, a word that is no choice,
    or a dataset's option without a dataset. Also for two jobs with one label, or an experiment that cannot be read.
    """
    with reading_experiment(words) as words:
        return command_of(read(words, multirun))


def command_of(asked: Asked) -> Command:
    """Return the jobs of a command: of a sweep every dataset with every method, and every combination of values.

    Raises InputError at the word that is wrong, or at the experiment.
    """
    with _faults(asked):
        if asked.config is None:
            config = hydra_configs.composed(lines_of(asked))
            return Command((job_of(config),), config, asked.words)

        @functools.cache
        def start(*choices: str) -> dict[str, Any]:
            return hydra_configs.plain(hydra_configs.composed([*asked.of_hydra, *choices]))

        made = list[tuple[Job, tuple[str, ...]]]()
        with hydra_configs.current(asked.config):
            for pair in itertools.product(*asked.chosen.values()):
                made += _of_pair(asked, pair, start)
    every = [job for job, _ in made]
    _refuse_same_place(every)
    shared = tuple(_sharing_pairs(every, asked))
    return Command(
        shared, asked.config, asked.words, True, tuple(overrides for _, overrides in made)
    )


def lines_of(asked: Asked) -> list[str]:
    """Return the words of a command as Hydra reads them: options of a method by its name are options of `method`.

    Raises InputError for an unknown name or option.
    """
    lines = [*asked.of_hydra]
    for kind, entries in asked.chosen.items():
        if any(word.key == kind for word in asked.typed):
            lines.append(f"{kind}={','.join(quoted(entry.name) for entry in entries)}")
    alone = [entries[0] for entries in asked.chosen.values() if len(entries) == 1]
    for key, word in _settings(asked, asked.typed, alone).items():
        lines.append(f"~{key}" if word.is_deleted else word.line)
    return lines


def _settings(
    asked: Asked, words: Sequence[Word], own: Sequence[Entry], is_pair: bool = False
) -> dict[str, Word]:
    """The words by their keys in a configuration, of which the last counts, in its place.

    own: datasets and methods whose options come first; is_pair: leave out words that none of them has.
    """
    settings = {word.key: word for entry in own for word in entry.words()}
    for word in words:
        key = word.key
        if key in KINDS:
            continue
        kind = asked.kind_of(word)
        if kind:
            if is_pair and not any(entry.has(word) for entry in own):
                continue
            key = f"{kind}.{word.option}"
            word = replace(word, line=f"++{key}={word.value}")
        settings.pop(key, None)
        settings[key] = word
    return settings


def job_of(config: DictConfig, swept: Sequence[str] = ()) -> Job:
    """Return the job of a configuration that Hydra composed. swept: see `Job.of`.

    Raises InputError for an option that is unknown, and for a value that is not acceptable.
    """
    with hydra_configs.current(config) if "hydra" in config else contextlib.nullcontext():
        return Job.of(_filled(hydra_configs.plain(config)), swept)


@contextlib.contextmanager
def _faults(asked: Asked) -> Iterator[None]:
    """Name the experiment in a fault of this block, unless a word of the command has the option or the name."""
    try:
        yield
    except SucreBenchError as fault:
        option = re.split(r"[.=]", fault.place)[-1]
        name = fault.fault.partition("'")[2].partition("'")[0]
        is_typed = any(
            word.text == fault.place
            or option == word.key.rpartition(".")[2]
            or (name and name in word.text)
            for word in asked.typed
        )
        is_ours = is_typed or not asked.experiment
        raise (fault if is_ours else fault.within(asked.experiment)) from None


def _of_pair(
    asked: Asked, pair: Sequence[Entry], start: Callable[..., dict[str, Any]]
) -> Iterator[tuple[Job, tuple[str, ...]]]:
    """The jobs of one dataset and one method: of every combination of the words' values, each with its overrides.

    start: what Hydra composes of choices.
    """
    words = _settings(asked, asked.settings, pair, is_pair=True)
    swept = [key for key, word in words.items() if word.is_swept]
    groups = [line for line in asked.of_hydra if not line.lstrip("+~").startswith("hydra")]
    for given in itertools.product(*(word.values for word in words.values())):
        settings = dict(zip(words, given, strict=True))
        choices = [f"{entry.kind}={quoted(entry.name)}" for entry in pair]
        if "metrics" in settings:
            choices.append(f"metrics={value_of(settings.pop('metrics'))}")
        composed = start(*choices)
        values = copy.deepcopy(composed)
        for key, value in settings.items():
            _put(values, key, value, words[key].is_deleted)
        job = Job.of(_filled(values), swept)
        usual = dict(flat("", composed))
        made = dict(flat("", job.values))
        made["dataset.label"] = job.values["dataset"]["label"] or job.dataset.plugin.name
        made["method.label"] = job.method.label
        lines = [
            f"++{key}={value_of(literal(value))}"
            for key, value in made.items()
            if usual.get(key, ...) != value
        ]
        lines += [f"~{key}" for key in settings if words[key].is_deleted]
        yield job, (*groups, *choices, *lines)


def _sharing_pairs(every: Sequence[Job], asked: Asked) -> Sequence[Job]:
    """Let jobs with methods of several views share pairs, if they work on the same views."""
    pairing = [job for job in every if "poses" in job.method.plugin.needs and job.pairs_gb > 0]
    views = {(job.dataset.label, *_part(job)) for job in pairing}
    if len(views) == len(pairing):
        return every
    folder = f"x{fingerprint({'command': [*asked.words]})[1]}"
    return [replace(job, shared_pairs=folder) for job in every]


def _part(job: Job) -> tuple[int, int, int]:
    """The repetition and the block of views that a job is."""
    return job.replicate, job.shard.index, job.shard.count


def _refuse_same_place(planned: Sequence[Job]) -> None:
    """Raise InputError if two jobs would write to one place."""
    seen: dict[tuple[object, ...], Job] = {}
    for job in planned:
        place = (as_one_file(job.dataset.label), as_one_file(job.method.label), *_part(job))
        other = seen.setdefault(place, job)
        if other is job:
            continue
        name = f"{job.dataset.label} / {job.method.label}"
        if (other.dataset, other.method) == (job.dataset, job.method):
            fault = f"two jobs of this sweep are the same, '{name}'"
            remedy = "sweep over datasets, methods and their options only, and name each once"
        else:
            fault = f"two jobs of this sweep would both be '{name}'"
            remedy = (
                "give each NAME.label=..., or in an experiment {method: NAME, label: LABEL}"
            )
        raise InputError(fault, remedy=remedy)


# -- the values of a configuration -----------------------------------------------------------------------------


def _put(values: dict[str, Any], key: str, value: Any, is_deleted: bool) -> None:
    """Set a value of a configuration, or take it out. InputError for an unknown key; types are checked later."""
    *groups, name = key.split(".")
    node = values
    for group in groups:
        if not isinstance(node.get(group), dict):
            raise unknown_name(key, group, node)
        node = node[group]
    if name not in node and groups not in (["dataset"], ["method"]):
        # whose options were checked
        raise unknown_name(key, name, node)
    if is_deleted:
        del node[name]
    elif isinstance(node.get(name), dict) and isinstance(value, dict):
        node[name] = {**node[name], **value}
    else:
        node[name] = value


def _filled(values: dict[str, Any]) -> dict[str, Any]:
    """A configuration with the run's seed where a plugin has none of its own, and with each ${...} resolved.

    Options that must be given and are not are left out: the plugin says so.
    """
    parts = (values["dataset"], values["method"], *values["metrics"].values())
    for part in (part for part in parts if isinstance(part, dict)):
        if part.get("seed") == SEED:
            part["seed"] = values["seed"]
        for name in [name for name, value in part.items() if value == "???"]:
            del part[name]
    text = str(values)
    if "${" not in text:
        return values
    if "${hydra:job.num}" in text:
        remedy = "write what varies: method.label='gain {strength}'"
        raise InputError("is known only when a job runs", "${hydra:job.num}", remedy)
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    # What holds a reference, and what one may refer to: OmegaConf takes 8 ms for all of it.
    concerned = {
        key: value
        for key, value in values.items()
        if not isinstance(value, dict) or "${" in str(value) or f"${{{key}." in text
    }
    try:
        resolved = OmegaConf.to_container(OmegaConf.create(concerned), resolve=True)
    except OmegaConfBaseException as fault:
        place = fault.full_key or ""
        raise InputError(first_line(fault), place, "mend the ${...} in it") from fault
    assert isinstance(resolved, dict)
    return {**values, **{str(key): value for key, value in resolved.items()}}
