"""From the words of a command to its jobs.

Hydra composes the configuration of each choice of dataset, method and metrics once. The words' values take their places
in it, a job for each combination, and the types of the plugins' own fields check them (`Job.of`), before any work.

Every dataset meets every method. A word that begins with the name or label of one of them, `sucre.physical=true`, is
for it alone. A word for methods or datasets in general, `method.physical=true`, is for those that have the option.
"""

from __future__ import annotations

import contextlib
import itertools
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from sucre_bench.errors import InputError, SucreBenchError, UnknownPluginError, unknown_name
from sucre_bench.jobs import configs
from sucre_bench.jobs.asked import KINDS, Asked, Kind, read, reading_experiment
from sucre_bench.jobs.catalogue import SEED, plugin_of
from sucre_bench.jobs.entries import (
    Entry,
    Option,
    entries_of,
    is_replaced,
    listed_entries,
    option_of,
)
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.words import Word, first_line, literal, parse, quoted, value_of
from sucre_bench.results.layout import as_one_file
from sucre_bench.results.rows import fingerprint

if TYPE_CHECKING:
    from omegaconf import DictConfig


@dataclass(frozen=True)
class Command:
    """What the words of a command ask for.

    words: the overrides, with ~ expanded; is_sweep: whether it may have several jobs: by -m, or an experiment; config:
    what Hydra composes of the job, or of what the jobs of a sweep share; overrides: of each job, with which Hydra
    composes it again; shared_pairs: the folder where its jobs share pairs, the same for the same words, empty if they
    share none; keys: how the user typed keys that a plugin knows by another name.
    """

    jobs: tuple[Job, ...]
    words: tuple[str, ...]
    is_sweep: bool
    config: DictConfig
    overrides: tuple[tuple[str, ...], ...]
    shared_pairs: str = ""
    keys: Mapping[str, str] = field(default_factory=dict)

    def as_typed(self, text: str) -> str:
        """Return a message with options named as the user typed them."""
        for key, typed in self.keys.items():
            text = re.sub(rf"\b{re.escape(key)}\b", typed, text)
        return text


def jobs(words: Sequence[str], multirun: bool) -> Command:
    """Let Hydra compose the jobs that overrides ask for, or an experiment's file among them, and check every job.

    Raises InputError for an unknown name or option (with the nearest known), a wrong type, a word that is no choice,
    or a dataset's option without a dataset. Also for two jobs with one label, or an experiment that cannot be read.
    """
    with reading_experiment(words) as words:
        asked = read(words, multirun)
        return single(asked) if asked.config is None else sweep(asked)


def single(asked: Asked) -> Command:
    """Return the one job of a command without a sweep, whose configuration Hydra composes of all words."""
    keys: dict[str, str] = {}
    with _faults(asked, keys):
        config = configs.composed(lines_of(asked, keys))
        return Command((job_of(config),), asked.words, False, config, ((),), keys=keys)


def lines_of(asked: Asked, keys: dict[str, str] | None = None) -> list[str]:
    """Return the words of a command as Hydra reads them: options of a method by its name are options of `method`.

    keys: is told how the user typed them. Raises InputError for an unknown name or option.
    """
    entries, lines = {kind: entries_of(kind, asked) for kind in KINDS}, [*asked.of_hydra]
    for word in asked.typed:
        option = option_of(word, entries, asked) if word.key not in KINDS else None
        line = word.line
        if option:
            for owner in (option.kind, *(entry.name for entry in entries[option.kind])):
                (keys if keys is not None else {})[f"{owner}.{option.name}"] = word.key
            line = f"++{option.kind}.{option.name}={word.line.partition('=')[2]}"
        elif word.key in KINDS and (word.is_glob or len(word.values) == 1):
            chosen = entries["dataset" if word.key == "dataset" else "method"]
            line = f"{word.key}={','.join(quoted(entry.name) for entry in chosen)}"
            lines += [f"++{one.text}" for entry in chosen for one in entry.words(word.key)]
        if word.is_deleted:
            line = f"~{word.key}"
        lines.append(line)
    return lines


def job_of(config: DictConfig, swept: Sequence[str] = ()) -> Job:
    """Return the job of a configuration that Hydra composed. swept: the keys whose values its labels name.

    Raises InputError for an option that is unknown, and for a value that is not acceptable.
    """
    with configs.current(config) if "hydra" in config else contextlib.nullcontext():
        job = Job.of(_plain(_filled(configs.plain(config))), swept)
    return replace(job, method=replace(job.method, word="method"))


def sweep(asked: Asked) -> Command:
    """Return all jobs of a sweep: every dataset with every method, and every combination of the words' values.

    Raises InputError at the word that is wrong, or at the experiment.
    """
    assert asked.config is not None
    keys: dict[str, str] = {}  # how the user typed a key that a plugin knows by another name
    of_all: dict[str, str] = {}
    with _faults(asked, keys):
        swept = asked.sweeper("params") or {}
        if not isinstance(swept, Mapping):
            raise InputError(
                "is no mapping", "hydra.sweeper.params", 'write params: {OPTION: "VALUE,VALUE"}'
            )
        params = [word for key, text in swept.items() for word in parse([f"{key}={text}"])]
        entries = {kind: entries_of(kind, asked, params) for kind in KINDS}
        listed = {kind: listed_entries(kind, asked) for kind in KINDS}
        replaced = {word.key for word in asked.typed}
        words = [word for word in params if not is_replaced(word, replaced, entries, listed)]
        options = [
            (word, option_of(word, entries, asked))
            for word in (*words, *asked.typed)
            if word.key not in KINDS
        ]
        unlabelled = {
            kind: Counter(one.name for one in entries[kind] if not one.label) for kind in KINDS
        }
        made, starts = list[tuple[Job, tuple[str, ...]]](), dict[tuple[str, ...], dict[str, Any]]()
        with configs.current(asked.config):
            for dataset, method in itertools.product(entries["dataset"], entries["method"]):
                of_all |= keys
                keys.clear()
                made += _of_pair(
                    {"dataset": dataset, "method": method}, options, unlabelled, keys, asked, starts
                )
    every = [job for job, _ in made]
    _refuse_same_place(every)
    pairing = [job for job in every if "poses" in job.method.plugin.needs and job.pairs_gb > 0]
    views = {
        (job.dataset.label, job.replicate, job.shard.index, job.shard.count) for job in pairing
    }
    # Jobs with methods of several views share pairs where they work on the same views.
    shared_pairs = (
        f"x{fingerprint({'command': [*asked.words]})[1]}" if len(views) < len(pairing) else ""
    )
    every = [replace(job, shared_pairs=shared_pairs) for job in every] if shared_pairs else every
    overrides = tuple(lines for _, lines in made)
    return Command(
        tuple(every), asked.words, True, asked.config, overrides, shared_pairs, of_all | keys
    )


@contextlib.contextmanager
def _faults(asked: Asked, keys: Mapping[str, str]) -> Iterator[None]:
    """Name the word or the experiment at which a fault of this block is.

    keys: how the user typed a key that a plugin knows by another name.
    """
    try:
        yield
    except SucreBenchError as fault:
        place = keys.get(fault.place, fault.place)
        texts = {text for word in asked.typed for text in (word.text, word.key, word.head)}
        values = (
            word.text.partition("=")[2]
            for word in asked.typed
            if word.key in (*KINDS, "metrics", "views")
        )
        chosen = {name for value in values for name in re.findall(r"[^][,'\":]+", value)}
        is_typed = (
            place in texts | chosen
            or place.partition("=")[0] in texts
            or re.split("[.:]", place)[0] in chosen
        )
        fault = (
            type(fault)(fault.fault, place, fault.remedy)
            if not isinstance(fault, UnknownPluginError)
            else fault
        )
        raise (
            fault if is_typed or not asked.experiment else fault.within(asked.experiment)
        ) from None


def _of_pair(
    pair: Mapping[Kind, Entry],
    words: Sequence[tuple[Word, Option | None]],
    unlabelled: Mapping[Kind, Counter[str]],
    keys: dict[str, str],
    asked: Asked,
    starts: dict[tuple[str, ...], dict[str, Any]],
) -> Iterator[tuple[Job, tuple[str, ...]]]:
    """The jobs of one dataset and one method: of every combination of the words' values, each with its overrides.

    unlabelled: how many entries of a name have no label; starts: what Hydra has composed, by its overrides.
    """
    chosen: dict[str, Word] = {}
    swept: list[str] = []
    for kind, entry in pair.items():
        chosen |= {word.key: word for word in entry.words(kind)}
        # Without a label of its own, its label names the options that tell it from the others.
        if not entry.label and unlabelled[kind][entry.name] > 1:
            swept += [f"{kind}.{option}" for option in entry.options if option != "degrade"]
    for word, option in words:
        key = word.key
        if option:
            entry = pair[option.kind]
            if not option.is_for(entry):
                continue
            key = f"{option.kind}.{option.name}"
            plugin = plugin_of(option.kind, entry.name)
            keys |= {key: word.key} | ({f"{plugin.name}.{option.name}": word.key} if plugin else {})
        chosen.pop(key, None)  # the last word counts, in its place
        chosen[key] = word
        swept += [key] if word.is_swept else []
    method = pair["method"]
    own_word = method.label if method.label.replace("-", "_").isidentifier() else method.name
    if not method.label and unlabelled["method"].total() == 1:
        own_word = "method"
    for given in itertools.product(*(word.values for word in chosen.values())):
        settings = dict(zip(chosen, given, strict=True))
        metrics = settings.pop("metrics", None)
        choices = [
            *asked.of_hydra,
            *(f"{kind}={quoted(entry.name)}" for kind, entry in pair.items()),
        ]
        choices += [] if metrics is None else [f"metrics={value_of(metrics)}"]
        start = starts.get(tuple(choices))
        if start is None:
            start = starts[tuple(choices)] = configs.plain(configs.composed(choices))
        values = {key: _copied(value) for key, value in start.items()}
        deleted = [key for key in settings if chosen[key].is_deleted]
        for key, value in settings.items():
            _put(values, key, value, key in deleted)
        job = Job.of(_plain(_filled(values)), swept)
        job = replace(job, method=replace(job.method, word=own_word))
        yield (
            job,
            _overrides(job, choices, [key for key in settings if key not in deleted], deleted),
        )


def _overrides(
    job: Job, choices: Sequence[str], keys: Sequence[str], deleted: Sequence[str]
) -> tuple[str, ...]:
    """What Hydra composes a job of a sweep of: the choices of groups, and the values at these keys."""

    def at(key: str) -> Any:
        value: Any = job.values
        for part in key.split("."):
            value = value[part]
        return value

    labels = {"dataset.label": job.values["dataset"]["label"] or job.dataset.plugin.name}
    labels["method.label"] = job.method.label
    settings = {key: at(key) for key in keys if key not in labels} | labels
    lines = [f"++{key}={value_of(literal(value))}" for key, value in settings.items()]
    of_task = (
        choice for choice in choices if not choice.lstrip("+~").startswith(("hydra.", "hydra/"))
    )
    return (*of_task, *lines, *(f"~{key}" for key in deleted))


def _refuse_same_place(planned: Sequence[Job]) -> None:
    """Raise InputError if two jobs would write to one place."""
    seen: dict[tuple[str, str, int, int, int], Job] = {}
    for job in planned:
        part = (job.replicate, job.shard.index, job.shard.count)
        other = seen.setdefault(
            (as_one_file(job.dataset.label), as_one_file(job.method.label), *part), job
        )
        if other is not job:
            name = f"{job.dataset.label} / {job.method.label}"
            if (other.method, other.dataset) != (job.method, job.dataset):
                of = "method" if other.dataset == job.dataset else "dataset"
                raise InputError(
                    f"two jobs of this sweep would both be '{name}'; tell them apart with {of}.label=..."
                )
            raise InputError(
                f"two jobs of this sweep are the same, '{name}'; sweep over datasets, methods or options"
            )


# -- the values of a configuration -----------------------------------------------------------------------------


def _copied(value: Any) -> Any:
    return (
        {key: _copied(inner) for key, inner in value.items()} if isinstance(value, dict) else value
    )


def _put(values: dict[str, Any], key: str, value: Any, is_deleted: bool) -> None:
    """Set a value of a configuration, or take it out. InputError for an unknown key; types are checked later."""
    *groups, name = key.split(".")
    node = values
    for group in groups:
        if not isinstance(node.get(group), dict):
            raise unknown_name(key, group, node)
        node = node[group]
    if name not in node and groups not in (["dataset"], ["method"]):  # whose options were checked
        raise unknown_name(key, name, node)
    if is_deleted:
        del node[name]
        return
    if (
        isinstance(options := node.get(name), dict)
        and name != "variants"
        and (key != "study" or value is not None)
    ):
        if not isinstance(value, dict):
            raise InputError("is a group of options", key, f"set one of them: {', '.join(options)}")
        value = {**options, **value}
    node[name] = value


def _filled(values: dict[str, Any]) -> dict[str, Any]:
    """A configuration with the run's seed where a plugin has none of its own, and with each ${...} resolved."""
    for part in (values["dataset"], values["method"], *values["metrics"].values()):
        if part.get("seed") == SEED:
            part["seed"] = values["seed"]
    text = str(values)
    if "${" not in text:
        return values
    if numbered := re.search(r"\$\{hydra:job\.(num|id)\}", text):
        remedy = "write what varies: method.label='gain {strength}'"
        raise InputError("is known only when a job runs", numbered[0], remedy)
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
        raise InputError(
            first_line(fault), fault.full_key or "", "mend the ${...} in it"
        ) from fault
    assert isinstance(resolved, dict)
    return {**values, **{str(key): value for key, value in resolved.items()}}


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration without options that must be given and are not: the plugin says so."""
    is_of_plugin = {"dataset", "method"}
    return {
        key: {name: v for name, v in value.items() if v != "???"} if key in is_of_plugin else value
        for key, value in values.items()
    }
