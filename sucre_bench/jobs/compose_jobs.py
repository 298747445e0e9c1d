"""From the words of a command to its jobs.

Words and a line-up become the settings of each job (`combinations`). Hydra composes what a dataset and a method start
from, once for each pair of them; OmegaConf puts each job's values in their place and checks their types. The plugins'
own fields are the schema (`hydra_schema`), so that a wrong name or type is found before any work.
"""

from __future__ import annotations

import copy
import functools
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench import plugins
from sucre_bench.errors import InputError, SucreBenchError, UnknownPluginError, in_one_line
from sucre_bench.jobs import mistakes
from sucre_bench.jobs.combinations import Combination, combinations, parse
from sucre_bench.jobs.hydra_schema import register
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.lineup import KINDS, LineUp, Word, read_experiment, read_line_up
from sucre_bench.jobs.metric_words import chosen_variants, group_names
from sucre_bench.jobs.run_options import CONF
from sucre_bench.jobs.words import value_of
from sucre_bench.machine.files import expanded
from sucre_bench.results.layout import file_name
from sucre_bench.results.rows import fingerprint

if TYPE_CHECKING:
    from omegaconf import DictConfig


@dataclass(frozen=True)
class Command:
    """What the words of a command ask for.

    words: the overrides, with ~ expanded; is_sweep: whether Hydra's launcher hands out the jobs; settings: `out` and
    Hydra's own part, `hydra`, which names the launcher and its options; shared_pairs: the folder where its jobs share
    pairs, the same for the same words, empty if they share none.
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
    for word in words:
        if word.splitlines() not in ([], [word]):
            raise InputError(f"{in_one_line(word)!r}: holds a line break; give each word in one line")
    words = [_expand_home(text) for text in words]
    files = [word for word in words if mistakes.is_bare(word) and Path(word).suffix.lower() in (".yaml", ".yml")]
    if len(files) > 1:
        raise InputError("a second line-up", files[1], "run one at a time")
    overrides = [word for word in words if word not in files]
    mistakes.refuse_bare_words(overrides)
    line_up, typed = _with_line_up(expanded(files[0]) if files else None, parse(overrides))
    mistakes.refuse_options_of_no_dataset(typed, line_up)
    with _hydra():
        made, settings, is_sweep = _compose_jobs(typed, line_up, multirun)
    _refuse_same_place(made)
    shared_pairs = f"x{fingerprint({'command': words})[1]}" if _can_share_pairs(made) else ""
    made = [replace(job, shared_pairs=shared_pairs) for job in made]
    return Command(tuple(made), tuple(words), is_sweep, settings, shared_pairs)


def _expand_home(override: str) -> str:
    """Expand a leading ~ of the value; the shell does so only at the start of a word."""
    key, equals, value = override.partition("=")
    bare = value.strip("'\"")
    return f"{key}='{expanded(bare)}'" if equals and bare.startswith("~/") else override


def _with_line_up(file: Path | None, typed: Sequence[Word]) -> tuple[LineUp, list[Word]]:
    """Read the line-up or the experiment that the words name, with all plugins loaded; and the other words."""
    experiments = [word for word in typed if word.key == "experiment"]
    given = (word.values[0] for word in typed if word.key == "plugins")
    plugin_files = [str(one) for value in given for one in (value if isinstance(value, list) else [value])]
    for plugin_file in plugin_files:  # before its plugins can be chosen
        plugins.load_file(plugin_file)
    if len(experiments) + (file is not None) > 1:
        raise InputError("beside another experiment or line-up", experiments[-1].text, "run one at a time")
    line_up = LineUp()
    if file is not None:
        line_up = read_line_up(file)
    elif experiments:
        name = experiments[0].values[0]
        if len(experiments[0].values) > 1 or not isinstance(name, str):
            raise InputError("one experiment at a time", experiments[0].text, "give experiment=NAME")
        line_up = read_experiment(name)
    if plugin_files:
        every = list(dict.fromkeys([*line_up.settings.get("plugins", []), *plugin_files]))
        line_up = replace(line_up, settings={**line_up.settings, "plugins": every})
    return line_up, [word for word in typed if word.key not in ("experiment", "plugins")]


def _compose_jobs(typed: list[Word], line_up: LineUp, multirun: bool) -> tuple[list[Job], DictConfig, bool]:
    """Return every job that the words and the line-up ask for, the launcher's settings, and whether it is a sweep."""
    from hydra.types import RunMode

    # Hydra's own groups and keys choose what everything else is composed from.
    own = [word for word in typed if "/" in word.key or "@" in word.key or word.head == "hydra"]
    others = [word for word in typed if word not in own]
    groups = [word.text for word in own if word.head != "hydra" or word.key == "hydra.searchpath"]
    base = functools.cache(_base)
    settings = copy.deepcopy(base(tuple(groups)))
    for word in own:
        if word.text not in groups:
            _put(settings, word.key, word.values[0], may_be_new=word.is_added)
    mistakes.refuse_foreign(settings)
    params = settings.hydra.sweeper.get("params") or {}
    others = [*parse(f"{key}={value}" for key, value in params.items()), *others]
    is_sweep = multirun or bool(line_up.place) or settings.hydra.mode == RunMode.MULTIRUN
    mistakes.refuse_several_values(typed, is_sweep)
    try:
        every = combinations(others, line_up)
    except InputError as fault:
        raise _at_its_place(fault, {}, line_up, others) from fault
    made = []
    for combination in every:
        try:
            made.append(_job(combination, groups, base))
        except SucreBenchError as fault:
            raise _at_its_place(fault, combination.typed, line_up, others) from fault
    settings.out = str(made[0].out)
    return made, settings, is_sweep


def _base(groups: tuple[str, ...]) -> DictConfig:
    """Compose the configuration of some choices, with Hydra's own part."""
    import hydra
    from hydra.errors import HydraException
    from omegaconf.errors import OmegaConfBaseException

    try:
        return hydra.compose("config", overrides=list(groups), return_hydra_config=True)
    except (HydraException, OmegaConfBaseException, ValueError, TypeError, AttributeError, KeyError) as fault:
        raise mistakes.of_composing(fault, parse(groups)) from fault


def _job(combination: Combination, groups: Sequence[str], base: Any) -> Job:
    """Put a job's values into what its dataset, method and metrics start from."""
    from omegaconf import open_dict

    values = dict(combination.values)
    chosen = [f"dataset={value_of(combination.dataset)}", f"method={value_of(combination.method)}"]
    variants: dict[str, tuple[Any, bool]] = {}
    if "metrics" in values:
        given = values.pop("metrics")[0]
        names = chosen_variants([str(name) for name in (given if isinstance(given, list) else [given])])
        chosen.append(f"metrics={value_of(group_names(names))}")
        variants = {f"metrics.{name}.variants": (chosen_, False) for name, chosen_ in names.items() if chosen_}
    composed = base((*groups, *chosen))
    with open_dict(composed):
        composed.pop("hydra", None)
    config = copy.deepcopy(composed)
    for key, (value, may_be_new) in (variants | values).items():
        _put(config, key, value, may_be_new=may_be_new)
    return replace(Job.composed(config, combination.swept), method_word=combination.method_word)


def _put(config: DictConfig, key: str, value: Any, *, may_be_new: bool) -> None:
    """Set a value of a configuration. Raises InputError for an unknown key, or a value of another type."""
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    try:
        OmegaConf.update(config, key, value, merge=True, force_add=may_be_new)
    except (OmegaConfBaseException, ValueError, TypeError, AttributeError, KeyError) as fault:
        raise mistakes.of_value(fault, config, key) from fault


def _at_its_place(
    fault: SucreBenchError, typed_keys: Mapping[str, str], line_up: LineUp, typed: Sequence[Word]
) -> InputError:
    """The fault with the key as it was typed, or with the line-up that it comes from."""
    if fault.place in typed_keys:
        fault = InputError(fault.fault, typed_keys[fault.place], fault.remedy)
    keys = {word.key for word in typed}
    # The names in a line-up were checked when it was read.
    is_typed_name = isinstance(fault, UnknownPluginError) and (fault.kind != "metric" or "metrics" in keys)
    if _is_typed(fault.place, typed) or is_typed_name or not line_up.place:
        return InputError(fault.fault, fault.place, fault.remedy)
    return fault.within(line_up.place)


def _is_typed(place: str, typed: Sequence[Word]) -> bool:
    """Whether an error's place is a typed word, its key or group, or begins with a name that it chooses: psnr:x."""
    texts, chosen = set(), set()
    for word in typed:
        texts |= {word.text, word.key, word.head}
        if word.key in (*KINDS, "metrics", "views"):
            chosen |= set(re.findall(r"[^][,'\":]+", word.text.partition("=")[2]))
    return place in texts | chosen or place.partition("=")[0] in texts or re.split("[.:]", place)[0] in chosen


def _refuse_same_place(planned: Sequence[Job]) -> None:
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


def _can_share_pairs(planned: Sequence[Job]) -> bool:
    """Whether several jobs with methods of several views work on the same views, and may share pairs."""
    pairing = [job for job in planned if "poses" in job.method.plugin.needs and job.pairs_gb > 0]
    views = [(job.dataset.label, job.replicate, job.shard.index, job.shard.count) for job in pairing]
    return len(set(views)) < len(views)
