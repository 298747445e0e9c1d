"""From the words of a command to its jobs: Hydra composes each job's configuration once.

The plugins' own fields are the schema (`sucre_bench.jobs.run_options`), so that a wrong name or type is found before
any work.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from sucre_bench import plugins
from sucre_bench.errors import InputError, SucreBenchError, UnknownPluginError
from sucre_bench.jobs.combinations import combinations, parse
from sucre_bench.jobs.explain_mistakes import in_our_words
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.lineup import KINDS, LineUp
from sucre_bench.jobs.quoting import quoted
from sucre_bench.jobs.read_lineup import read_experiment, read_line_up
from sucre_bench.jobs.refuse_words import (
    is_bare,
    refuse_bare_words,
    refuse_foreign,
    refuse_line_breaks,
    refuse_options_of_no_dataset,
    refuse_same_place,
    refuse_several_values,
)
from sucre_bench.jobs.run_options import CONF, register
from sucre_bench.machine.files import expanded
from sucre_bench.plugins.options import options_of
from sucre_bench.results.rows import fingerprint

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override
    from omegaconf import DictConfig


@dataclass(frozen=True)
class Command:
    """What the words of a command ask for.

    words: the overrides, with ~ expanded; is_sweep: whether Hydra's launcher hands out the jobs; settings: the first
    job's configuration with Hydra's own part, `hydra`, which names the launcher and its options; shared_pairs: the
    folder where its jobs share pairs, the same for the same words, empty if they share none.
    """

    jobs: tuple[Job, ...]
    words: tuple[str, ...]
    is_sweep: bool
    settings: DictConfig
    shared_pairs: str


@contextmanager
def _hydra() -> Iterator[None]:
    from hydra import initialize_config_module
    from hydra.core.global_hydra import GlobalHydra

    register()
    GlobalHydra.instance().clear()
    with initialize_config_module(CONF, version_base="1.3"):
        yield


def jobs(words: Sequence[str], multirun: bool) -> Command:
    """Read overrides and perhaps a line-up file, expand their sweeps, and check every job.

    Raises InputError for an unknown name or option (with the nearest known), a wrong type, a word that is no choice,
    a dataset's option without a dataset, two jobs with one label, or a line-up that cannot be read.
    """
    refuse_line_breaks(words)
    words = [_with_numbers_as_text(_expand_home(text)) for text in words]
    file = _line_up_file(words)
    overrides = [word for word in words if "=" in word or Path(word) != file]
    refuse_bare_words(overrides)
    line_up, parsed = _with_line_up(file, parse(overrides))
    refuse_options_of_no_dataset(parsed, line_up)
    with _hydra():
        composed = _compose_jobs(parsed, line_up, multirun)
    refuse_same_place(composed.jobs)
    shared_pairs = f"x{fingerprint({'command': words})[1]}" if _can_share_pairs(composed.jobs) else ""
    return Command(
        jobs=tuple(replace(job, shared_pairs=shared_pairs) for job in composed.jobs),
        words=tuple(words),
        is_sweep=composed.is_sweep,
        settings=composed.settings,
        shared_pairs=shared_pairs,
    )


def _expand_home(override: str) -> str:
    """Expand a leading ~ of the value; the shell does so only at the start of a word."""
    key, equals, value = override.partition("=")
    bare = value.strip("'\"")
    return f"{key}='{expanded(bare)}'" if equals and bare.startswith("~/") else override


def _with_numbers_as_text(override: str) -> str:
    """Quote numbers and truth values where an option is a name or a path: Hydra makes 20261122 of 2026_11_22."""
    key, equals, value = override.partition("=")
    if not equals or re.search(r"""['"(){}[\]]""", value) or not _is_text(key):
        return override
    pieces = (quoted(piece) if _is_number_or_truth(piece) else piece for piece in value.split(","))
    return f"{key}={','.join(pieces)}"


def _is_text(key: str) -> bool:
    """Whether an option is a name or a path."""
    owner, _, name = key.rpartition(".")
    if not owner:
        return name in ("out", "baseline")
    known = [plugin for kind in KINDS for plugin in plugins.usable(kind).values()]
    paths = (o.name for plugin in known for o in options_of(plugin.cls) if Path in (o.type, *get_args(o.type)))
    return name == "label" or name in paths


def _is_number_or_truth(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text.lower() in ("true", "false")
    return True


def _line_up_file(words: Sequence[str]) -> Path | None:
    """Return the line-up among the words, None where there is none. Raises InputError for two."""
    files = [word for word in words if is_bare(word) and Path(word).suffix.lower() in (".yaml", ".yml")]
    if len(files) > 1:
        raise InputError("a second line-up", files[1], "run one at a time")
    return expanded(files[0]) if files else None


@dataclass(frozen=True)
class _Composed:
    """Every job, and the first one's configuration with Hydra's own part."""

    jobs: list[Job]
    settings: DictConfig
    is_sweep: bool


def _with_line_up(file: Path | None, parsed: list[Override]) -> tuple[LineUp, list[Override]]:
    """Read the line-up or the experiment that the words name, with all plugins loaded; and the other words."""
    experiments = [o for o in parsed if o.key_or_group == "experiment"]
    others = [o for o in parsed if o.key_or_group not in ("experiment", "plugins")]
    files = [str(file) for o in parsed if o.key_or_group == "plugins" for file in _listed(o.value())]
    for plugin_file in files:  # before its plugins can be chosen
        plugins.load_file(plugin_file)
    if len(experiments) + (file is not None) > 1:
        raise InputError("beside another experiment or line-up", experiments[-1].input_line, "run one at a time")
    if file is not None:
        line_up = read_line_up(file)
    else:
        line_up = read_experiment(_only_name(experiments[0])) if experiments else LineUp()
    if files:
        every = [*line_up.settings.get("plugins", []), *files]
        line_up = replace(line_up, settings={**line_up.settings, "plugins": list(dict.fromkeys(every))})
    return line_up, others


def _listed(value: object) -> list[object]:
    return value if isinstance(value, list) else [value]


def _only_name(experiment: Override) -> str:
    name = None if experiment.is_sweep_override() else experiment.value()
    if not isinstance(name, str):
        raise InputError("one experiment at a time", experiment.input_line, "give experiment=NAME")
    return name


def _texts(overrides: Sequence[Override]) -> list[str]:
    return [override.input_line or "" for override in overrides if not override.is_sweep_override()]


def _compose_jobs(parsed: list[Override], line_up: LineUp, multirun: bool) -> _Composed:
    """Compose what the words and the line-up ask for, each job once."""
    from hydra.types import RunMode

    settings = [o for o in parsed if o.is_hydra_override()]
    others = [o for o in parsed if not o.is_hydra_override()]
    is_sweep = multirun or bool(line_up.place)
    if settings:
        base = _compose(_texts(settings))
        refuse_foreign(base)
        is_sweep = is_sweep or base.hydra.mode == RunMode.MULTIRUN
        params = base.hydra.sweeper.get("params") or {}
        others = [*parse(f"{key}={value}" for key, value in params.items()), *others]
    refuse_several_values(parsed, is_sweep)
    try:
        every = combinations(others, line_up)
    except InputError as fault:
        raise _at_its_place(fault, {}, line_up, others) from fault
    configurations, planned = [], []
    for combination in every:
        try:
            configurations.append(_compose([*_texts(settings), *combination.overrides]))
            job = Job.composed(configurations[-1], combination.swept)
            planned.append(replace(job, method_word=combination.method_word))
        except SucreBenchError as fault:
            raise _at_its_place(fault, combination.typed, line_up, others) from fault
    return _Composed(planned, configurations[0], is_sweep)


def _at_its_place(
    fault: SucreBenchError, typed_keys: Mapping[str, str], line_up: LineUp, typed: Sequence[Override]
) -> InputError:
    """The fault with the key as it was typed, or with the line-up that it comes from."""
    if fault.place in typed_keys:
        fault = InputError(fault.fault, typed_keys[fault.place], fault.remedy)
    keys = {word.key_or_group for word in typed}
    # The names in a line-up were checked when it was read.
    is_typed_name = isinstance(fault, UnknownPluginError) and (fault.kind != "metric" or "metrics" in keys)
    if _is_typed(fault.place, typed) or is_typed_name or not line_up.place:
        return InputError(fault.fault, fault.place, fault.remedy)
    return fault.within(line_up.place)


def _is_typed(place: str, typed: Sequence[Override]) -> bool:
    """Whether an error's place is a typed word, its key or group, or begins with a name that it chooses: psnr:x."""
    texts, chosen = set(), set()
    for word in typed:
        texts |= {word.input_line, word.key_or_group, word.key_or_group.partition(".")[0]}
        if word.key_or_group in (*KINDS, "metrics", "views"):
            chosen |= set(re.findall(r"[^][,'\":]+", word.get_value_string()))
    return place in texts | chosen or place.partition("=")[0] in texts or re.split("[.:]", place)[0] in chosen


def _compose(overrides: Sequence[str]) -> DictConfig:
    import hydra
    from hydra.errors import HydraException
    from omegaconf import DictConfig
    from omegaconf.errors import OmegaConfBaseException

    try:
        config = hydra.compose("config", overrides=list(overrides), return_hydra_config=True)
    except (HydraException, OmegaConfBaseException, ValueError, TypeError, AttributeError, KeyError) as fault:
        raise in_our_words(fault, overrides) from fault
    assert isinstance(config, DictConfig)
    return config


def _can_share_pairs(planned: Sequence[Job]) -> bool:
    """Whether several jobs with methods of several views work on the same views, and may share pairs."""
    pairing = [job for job in planned if "poses" in job.method.plugin.needs and job.pairs_gb > 0]
    views = [(job.dataset.label, job.replicate, job.shard.index, job.shard.count) for job in pairing]
    return len(set(views)) < len(views)
