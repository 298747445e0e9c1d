"""From the words of a command to its jobs.

Hydra composes the configuration of each choice of dataset, method and metrics once. The words' values take their places
in it, a job for each combination, and the types of the plugins' own fields check them (`Job.of`), before any work.

Every dataset meets every method. A word that begins with the name or label of one of them, `sucre.physical=true`, is
for it alone. A word for methods or datasets in general, `method.physical=true`, is for those that have the option.
"""

from __future__ import annotations

import contextlib
import difflib
import itertools
import os
import re
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from sucre_bench import plugins
from sucre_bench.errors import InputError, SucreBenchError, UnknownPluginError, in_one_line, unknown_name
from sucre_bench.jobs import configs
from sucre_bench.jobs.catalogue import (
    SEED,
    is_path,
    named,
    option_names,
    plugin_of,
    recognised,
    unknown_option,
)
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.run_options import RunConfig
from sucre_bench.jobs.words import QUOTED, Word, first_line, literal, parse, quoted, value_of
from sucre_bench.machine.files import check_folder, expanded, fault_of
from sucre_bench.machine.progress import say
from sucre_bench.machine.provenance import absent
from sucre_bench.plugins.options import options_of
from sucre_bench.plugins.plugin import fits
from sucre_bench.results.layout import as_one_file
from sucre_bench.results.rows import fingerprint

if TYPE_CHECKING:
    from omegaconf import DictConfig

Kind = Literal["dataset", "method"]
KINDS: tuple[Kind, ...] = ("dataset", "method")
_SWEEPER = "hydra.sweeper.params."  # before words that Hydra sweeps over


@dataclass(frozen=True)
class Command:
    """What the words of a command ask for.

    words: the overrides, with ~ expanded; is_sweep: whether it may have several jobs: by -m, or an experiment; config:
    what Hydra composes of the job, or of what the jobs of a sweep share; overrides: of each job, with which Hydra
    composes it again; shared_pairs: the folder where its jobs share pairs, the same for the same words, empty if they
    share none.
    """

    jobs: tuple[Job, ...]
    words: tuple[str, ...]
    is_sweep: bool
    config: DictConfig
    overrides: tuple[tuple[str, ...], ...]
    shared_pairs: str = ""

    @property
    def launcher(self) -> str:
        """The name of the launcher."""
        return str(self.config.hydra.runtime.choices["hydra/launcher"])


@dataclass(frozen=True)
class Entry:
    """A dataset or method with options of its own.

    name: of a plugin or a preset; options: also its label and, for a method, its display; for a dataset `degrade`, what
    is done to it first.
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The given label, empty where none is given."""
        return str(self.options.get("label") or "")

    def words(self, group: str) -> Iterator[Word]:
        """Yield its options as settings. group: where they stand, "method" say."""
        for name, value in self.options.items():
            yield from _flat("degrade", value) if name == "degrade" else [Word.written(f"{group}.{name}", value)]


def _flat(key: str, value: Any) -> Iterator[Word]:
    """The settings of a value: those of a mapping one by one."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(f"{key}.{name}", inner)
    else:
        yield Word.written(key, value)


@dataclass(frozen=True)
class Asked:
    """What the words of a command say.

    words: with ~ expanded; typed: those that set something; of_hydra: overrides that Hydra composes with, the same for
    all jobs: of itself and of groups of configs; experiment: as the user named it, a file or a name, empty for none;
    config: what the jobs of a sweep share, None for a single job.
    """

    words: tuple[str, ...]
    typed: tuple[Word, ...]
    of_hydra: tuple[str, ...]
    experiment: str
    config: DictConfig | None

    def sweeper(self, key: str) -> Any:
        """Return a list or mapping of the sweeper, `hydra.sweeper.methods` say."""
        return (configs.selected(self.config, f"hydra.sweeper.{key}") if self.config is not None else None) or ()

    def choice(self, group: str) -> str:
        """Return what Hydra chooses of a group where no word does."""
        chosen = self.config.hydra.runtime.choices if self.config is not None else configs.default_choices()
        return str(chosen[group])


def jobs(words: Sequence[str], multirun: bool) -> Command:
    """Let Hydra compose the jobs that overrides ask for, or an experiment's file among them, and check every job.

    Raises InputError for an unknown name or option (with the nearest known), a wrong type, a word that is no choice,
    or a dataset's option without a dataset. Also for two jobs with one label, or an experiment that cannot be read.
    """
    with reading_experiment(words) as words:
        asked = read(words, multirun)
        return single(asked) if asked.config is None else sweep(asked)


@contextlib.contextmanager
def reading_experiment(words: Sequence[str]) -> Iterator[list[str]]:
    """Give the words, with ~ expanded; an experiment's file among them can be read by name in this block."""
    # A leading ~ of a value is expanded here; the shell does so only at the start of a word.
    parts = [(word, word.partition("=")[0], word.partition("=")[2].strip("'\"")) for word in words]
    words = [f"{key}='{expanded(value)}'" if value.startswith("~/") else word for word, key, value in parts]
    files = [word for word in words if is_bare(word) and Path(word).suffix.lower() in (".yaml", ".yml")]
    if len(files) > 1:
        raise InputError("a second experiment", files[1], "run one at a time")
    with contextlib.ExitStack() as block:
        for file in files:
            if fault := fault_of(expanded(file)):
                raise InputError(fault, file, "give an experiment, `sucre-bench list experiments` shows those by name")
            block.enter_context(configs.searching(f"experiment://{expanded(file).resolve()}"))
        block.enter_context(configs.searching(*_search_path(words)))
        yield words


def _search_path(words: Sequence[str]) -> Iterator[str]:
    """Yield the places of `hydra.searchpath`, which Hydra reads where it composes; presets are looked for before."""
    given = parse(word for word in words if word.lstrip("+").startswith("hydra.searchpath="))
    lists = [value for word in given for value in word.values if isinstance(value, list)]  # Hydra refuses others
    for place in itertools.chain(*lists):
        folder = str(place).removeprefix("file://")
        if "://" not in folder:
            check_folder(expanded(folder), "give a folder that holds method/, experiment/ and others")
            folder = f"file://{expanded(folder).resolve()}"
        yield folder


def read(words: Sequence[str], multirun: bool, config: DictConfig | None = None) -> Asked:
    """Read the words of a command, and let Hydra compose what the jobs of a sweep share, unless it is given."""
    files = [word for word in words if is_bare(word) and Path(word).suffix.lower() in (".yaml", ".yml")]
    overrides = [word for word in words if word not in files]
    for word in overrides:
        if len(re.sub(QUOTED, "", f"{word}.").splitlines()) > 1:  # in quotes it is part of a name
            raise InputError(f"{in_one_line(word)!r}: holds a line break; give each word in one line")
        if is_bare(word):
            raise bare_word(word, overrides)
    loader = configs.hydra_app().config_loader
    parsed = parse(overrides, loader)
    params = [word for word in parsed if word.key.startswith(_SWEEPER)]
    typed = parse((f"{word.key.removeprefix(_SWEEPER)}={','.join(map(str, word.values))}" for word in params), loader)
    typed += [word for word in parsed if word not in params]
    _load([word for word in typed if word.key == "plugins"])
    groups = [word for word in typed if _is_of_hydra(word)]
    experiments = [word for word in groups if word.key == "experiment"]
    if len(experiments) + len(files) > 1:
        raise InputError("beside another experiment", experiments[-1].text, "run one at a time")
    for one in experiments:
        if len(one.values) > 1 or not isinstance(one.values[0], str):
            raise InputError("one experiment at a time", one.text, "give experiment=NAME")
    of_hydra = [*(f"experiment={FILE}" for _ in files), *(word.line for word in typed if word in groups)]
    named = [*files, *(f"experiment={one.values[0]}" for one in experiments)]
    experiment = named[0] if named else ""
    is_sweep = multirun or bool(experiment) or any(word.key == "hydra.mode" for word in groups)
    if is_sweep and config is None:
        try:
            config = configs.composed([*of_hydra, *_shared(typed)], is_sweep=True)
        except SucreBenchError as fault:
            raise (fault.within(files[0]) if files else fault) from fault
        sweeper = config.hydra.sweeper
        has_sweep = any(sweeper.get(key) for key in ("methods", "datasets", "params"))
        is_one_job = config.hydra.mode is None and not multirun and not has_sweep
        if is_one_job or (config.hydra.mode and config.hydra.mode.name == "RUN"):
            config = None if not multirun else config
    rest = tuple(word for word in typed if word not in groups)
    if config is not None:
        _load([Word.written("plugins", configs.selected(config, "plugins") or [])])
    asked = Asked(tuple(words), rest, tuple(of_hydra), experiment, config)
    _refuse(asked)
    return asked


FILE = "file"  # the name by which Hydra knows an experiment that is given by path


def _shared(words: Sequence[Word]) -> Iterator[str]:
    """Yield the options of the run that all jobs have, as Hydra reads them: its own keys may refer to ${out}."""
    defaults = RunConfig.defaults()
    for word in words:
        is_option = word.key in defaults or isinstance(defaults.get(word.head), dict)
        if is_option and word.head not in (*KINDS, "metrics") and not word.is_swept and not word.is_deleted:
            yield f"++{word.key}={word.line.partition('=')[2]}"


def _is_of_hydra(word: Word) -> bool:
    """Whether Hydra composes with a word: it is one of its own, or chooses a config of a group."""
    if "/" in word.key or "@" in word.key or word.head == "hydra":
        return True
    is_ours = word.key in (*KINDS, "metrics") or "." in word.key
    loader: Any = configs.hydra_app().config_loader
    return not is_ours and bool(loader.repository.group_exists(word.key))


def _load(words: Sequence[Word]) -> None:
    """Load plugin files, before their plugins can be chosen."""
    for value in (value for word in words for value in word.values):
        for file in value if isinstance(value, list) else [value]:
            plugins.load_file(str(file))


# -- which word is for which job -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Option:
    """What a word sets. owner: name or label of the datasets or methods; empty for all that have the option."""

    kind: Kind
    owner: str
    name: str

    def is_for(self, entry: Entry) -> bool:
        """Whether a dataset or method has the option, and the word means it."""
        is_meant = self.owner in ("", entry.name, entry.label)
        return is_meant and self.name.partition(".")[0] in option_names(self.kind, entry.name)


def single(asked: Asked) -> Command:
    """Return the one job of a command without a sweep, whose configuration Hydra composes of all words."""
    keys: dict[str, str] = {}
    with _faults(asked, keys):
        config = configs.composed(lines_of(asked, keys))
        return Command((job_of(config),), asked.words, False, config, ((),))


def lines_of(asked: Asked, keys: dict[str, str] | None = None) -> list[str]:
    """Return the words of a command as Hydra reads them: options of a method by its name are options of `method`.

    keys: is told how the user typed them. Raises InputError for an unknown name or option.
    """
    entries, lines = {kind: _entries(kind, asked) for kind in KINDS}, [*asked.of_hydra]
    for word in asked.typed:
        option = _option(word, entries, asked) if word.key not in KINDS else None
        line = word.line
        if option:
            for owner in (option.kind, *(entry.name for entry in entries[option.kind])):
                (keys if keys is not None else {})[f"{owner}.{option.name}"] = word.key
            line = f"++{option.kind}.{option.name}={word.line.partition('=')[2]}"
        elif word.key in KINDS and len(word.values) == 1:
            (entry,) = entries["dataset" if word.key == "dataset" else "method"]
            line = f"{word.key}={quoted(entry.name)}"
            lines += [f"++{one.text}" for one in entry.words(word.key)]
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
    with _faults(asked, keys):
        swept = asked.sweeper("params") or {}
        if not isinstance(swept, Mapping):
            raise InputError("is no mapping", "hydra.sweeper.params", 'write params: {OPTION: "VALUE,VALUE"}')
        params = [word for key, text in swept.items() for word in parse([f"{key}={text}"])]
        entries = {kind: _entries(kind, asked, params) for kind in KINDS}
        listed = {kind: _listed(kind, asked) for kind in KINDS}
        replaced = {word.key for word in asked.typed}
        words = [word for word in params if not _is_replaced(word, replaced, entries, listed)]
        options = [(word, _option(word, entries, asked)) for word in (*words, *asked.typed) if word.key not in KINDS]
        unlabelled = {kind: Counter(one.name for one in entries[kind] if not one.label) for kind in KINDS}
        made, starts = list[tuple[Job, tuple[str, ...]]](), dict[tuple[str, ...], dict[str, Any]]()
        with configs.current(asked.config):
            for dataset, method in itertools.product(entries["dataset"], entries["method"]):
                keys.clear()
                made += _of_pair({"dataset": dataset, "method": method}, options, unlabelled, keys, asked, starts)
    every = [job for job, _ in made]
    _refuse_same_place(every)
    pairing = [job for job in every if "poses" in job.method.plugin.needs and job.pairs_gb > 0]
    views = {(job.dataset.label, job.replicate, job.shard.index, job.shard.count) for job in pairing}
    # Jobs with methods of several views share pairs where they work on the same views.
    shared_pairs = f"x{fingerprint({'command': [*asked.words]})[1]}" if len(views) < len(pairing) else ""
    every = [replace(job, shared_pairs=shared_pairs) for job in every] if shared_pairs else every
    overrides = tuple(lines for _, lines in made)
    return Command(tuple(every), asked.words, True, asked.config, overrides, shared_pairs)


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
        values = (word.text.partition("=")[2] for word in asked.typed if word.key in (*KINDS, "metrics", "views"))
        chosen = {name for value in values for name in re.findall(r"[^][,'\":]+", value)}
        is_typed = place in texts | chosen or place.partition("=")[0] in texts or re.split("[.:]", place)[0] in chosen
        fault = type(fault)(fault.fault, place, fault.remedy) if not isinstance(fault, UnknownPluginError) else fault
        raise (fault if is_typed or not asked.experiment else fault.within(asked.experiment)) from None


def _of_pair(
    pair: Mapping[Kind, Entry],
    words: Sequence[tuple[Word, _Option | None]],
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
        choices = [*asked.of_hydra, *(f"{kind}={quoted(entry.name)}" for kind, entry in pair.items())]
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
        yield job, _overrides(job, choices, [key for key in settings if key not in deleted], deleted)


def _overrides(job: Job, choices: Sequence[str], keys: Sequence[str], deleted: Sequence[str]) -> tuple[str, ...]:
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
    of_task = (choice for choice in choices if not choice.lstrip("+~").startswith(("hydra.", "hydra/")))
    return (*of_task, *lines, *(f"~{key}" for key in deleted))


def _copied(value: Any) -> Any:
    return {key: _copied(inner) for key, inner in value.items()} if isinstance(value, dict) else value


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
    if isinstance(options := node.get(name), dict) and name != "variants" and (key != "study" or value is not None):
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
        raise InputError(first_line(fault), fault.full_key or "", "mend the ${...} in it") from fault
    assert isinstance(resolved, dict)
    return {**values, **{str(key): value for key, value in resolved.items()}}


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration without options that must be given and are not: the plugin says so."""
    is_of_plugin = {"dataset", "method"}
    return {
        key: {name: v for name, v in value.items() if v != "???"} if key in is_of_plugin else value
        for key, value in values.items()
    }


def _listed(kind: Kind, asked: Asked) -> tuple[Entry, ...]:
    """The datasets or methods that an experiment lists for the sweeper."""
    entries = []
    for given in asked.sweeper(f"{kind}s"):
        options = {kind: given} if isinstance(given, str) else given
        if not (isinstance(options, Mapping) and isinstance(options.get(kind), str)):
            place = f"hydra.sweeper.{kind}s"
            raise InputError(f"{given!r} has no name", place, f"write NAME, or {{{kind}: NAME, OPTION: VALUE}}")
        entry = _entry(kind, options[kind])
        own = {str(name): value for name, value in options.items() if name != kind}
        plugin = named(kind, entry.name)
        for option in own:
            if option not in (known := [*option_names(kind, entry.name), *(["degrade"] if kind == "dataset" else [])]):
                raise unknown_option(f"{entry.name}.{option}", option, [entry.name], known)
        lacking = None
        # A study needs all of its own methods; other experiments go without what lacks an extra.
        has_study = asked.config is not None and configs.selected(asked.config, "study.name")
        if asked.experiment.startswith("experiment=") and not has_study:
            lacking = absent(*plugin.requires)
        if lacking and lacking.is_extra:
            say(f"{options.get('label') or entry.name} is left out: {lacking}")
        else:
            entries.append(Entry(entry.name, {**entry.options, **own}))
    return tuple(entries)


def _entry(kind: Kind, name: str) -> Entry:
    """A dataset or method of this name; a folder is the dataset that recognises it."""
    if kind == "dataset" and is_path(name):
        return Entry(recognised(Path(name)), {"root": str(Path(name))})
    return Entry(name)


def _entries(kind: Kind, asked: Asked, params: Sequence[Word] = ()) -> tuple[Entry, ...]:
    """The datasets or methods: those of the last word that names some, of the experiment, or what Hydra chooses."""
    words = [word for word in asked.typed if word.key == kind]
    if not words and (listed := _listed(kind, asked)):
        return listed
    words = words or [word for word in params if word.key == kind]
    if not words:
        return (_entry(kind, asked.choice(kind)),)
    entries = []
    for name in words[-1].values:
        if isinstance(name, list) or name is None:
            raise InputError("one name at a time", f"{kind}={name}", f"-m {kind}=a,b runs several")
        name = str(name)
        plugin = plugin_of(kind, name)
        needs_root = any(o.name == "root" and o.default is MISSING for o in options_of(plugin.cls)) if plugin else False
        # A folder with the name of a dataset is meant where nothing else names the data.
        lacks_root = needs_root and not any(word.key.endswith(".root") for word in asked.typed)
        if kind == "dataset" and lacks_root and Path(name).is_dir():
            name = f"./{name}"
        entry = _entry(kind, name)
        named(kind, entry.name)
        entries.append(entry)
    return tuple(entries)


def _option(word: Word, entries: Mapping[Kind, Sequence[Entry]], asked: Asked) -> _Option | None:
    """The option that a word is, None for a word for the whole run. InputError for a word that is neither."""
    meant = _meant(word, entries)
    fitting = [option for option in meant if any(map(option.is_for, entries[option.kind]))]
    if len(fitting) > 1:
        either = " or ".join(f"{option.kind}.{option.name}=" for option in fitting)
        raise InputError(f"'{word.head}' is a dataset and a method here", word.text, f"write {either}")
    if fitting:
        return fitting[0]
    for option in meant:
        owners = [entry.name for entry in entries[option.kind] if option.owner in ("", entry.name, entry.label)]
        known = {name for owner in owners for name in option_names(option.kind, owner)}
        raise unknown_option(word.key, option.name, owners, known)
    if word.head not in _OF_RUN:
        raise unknown_word(word, entries, asked)
    return None


def _meant(word: Word, entries: Mapping[Kind, Sequence[Entry]]) -> list[_Option]:
    """The options that a word may be: of all datasets or methods, or of those that its first part names."""
    head, dot, rest = word.key.partition(".")
    if dot and head in KINDS:
        return [_Option("dataset" if head == "dataset" else "method", "", rest)]
    named_so = {kind: any(head in (entry.name, entry.label) for entry in entries[kind]) for kind in KINDS}
    return [_Option(kind, head, rest) for kind in KINDS if dot and named_so[kind]]


def _is_replaced(
    word: Word,
    keys: set[str],
    entries: Mapping[Kind, Sequence[Entry]],
    listed: Mapping[Kind, Sequence[Entry]],
) -> bool:
    """Whether typed words replace what an experiment sweeps over: the datasets or methods that have the option."""
    meant = [option for option in _meant(word, listed) if option.kind in keys]
    return bool(meant) and not any(map(meant[0].is_for, entries[meant[0].kind]))


def _refuse_same_place(planned: Sequence[Job]) -> None:
    """Raise InputError if two jobs would write to one place."""
    seen: dict[tuple[str, str, int, int, int], Job] = {}
    for job in planned:
        part = (job.replicate, job.shard.index, job.shard.count)
        other = seen.setdefault((as_one_file(job.dataset.label), as_one_file(job.method.label), *part), job)
        if other is not job:
            name = f"{job.dataset.label} / {job.method.label}"
            if (other.method, other.dataset) != (job.method, job.dataset):
                of = "method" if other.dataset == job.dataset else "dataset"
                raise InputError(f"two jobs of this sweep would both be '{name}'; tell them apart with {of}.label=...")
            raise InputError(f"two jobs of this sweep are the same, '{name}'; sweep over datasets, methods or options")


# -- mistakes in the words, with the words that were probably meant -----------------------------------------------


def is_bare(word: str) -> bool:
    """Whether a word has no key: neither key=value nor ~key."""
    return "=" not in word and not word.startswith("~")


def bare_word(word: str, words: Sequence[str]) -> InputError:
    """Return the fault of a word that has no key, with the command that was probably meant. words: of the command."""
    if "." in word and word.partition(".")[0] in (*KINDS, "metrics", "degrade", "study"):
        return InputError("has no value", word, f"an override reads key=value, write {word}=VALUE")
    names = {
        "dataset": [*plugins.discover("dataset")],
        "method": [*plugins.discover("method"), *configs.preset_names("method")],
        "metrics": [*plugins.discover("metric")],
        "experiment": configs.preset_names("experiment"),
    }
    keyed: dict[str, list[str]] = {}
    for name in filter(is_bare, words):
        (near, *_) = difflib.get_close_matches(name, itertools.chain(*names.values()), n=1, cutoff=0.7) or [""]
        key = next((key for key, known in names.items() if near in known), "")
        if near != name and expanded(name).is_dir():
            key, near = "dataset", quoted(name if "/" in name else f"./{name}")
        keyed.setdefault(key, []).append(near)
    remedy = "`sucre-bench list methods` and `list datasets` show the names"
    if "" not in keyed:
        several = "-m " if any(len(names) > 1 for key, names in keyed.items() if key != "metrics") else ""
        meant = [f"{key}=[{','.join(n)}]" if key == "metrics" else f"{key}={','.join(n)}" for key, n in keyed.items()]
        remedy = f"write sucre-bench run {several}{shlex.join([*meant, *(w for w in words if not is_bare(w))])}"
    return InputError("an override reads key=value", word, remedy)


def _refuse(asked: Asked) -> None:
    """Raise InputError for several values where no sweep was asked for, for a path with a comma, and for a dataset's
    option where no dataset is named: the built-in one would take it.

    An experiment may leave the dataset open or name several; where the data are needs a dataset in the words.
    """
    typed, is_sweep = asked.typed, asked.config is not None
    plugin, has_dataset = plugin_of("dataset", asked.choice("dataset")), any(word.key == "dataset" for word in typed)
    paths = {o.name for o in options_of(plugin.cls) if Path in (o.type, *get_args(o.type))} if plugin else set()
    for word in typed:
        key, value = word.key, word.text.partition("=")[2]
        quotes = f'"{key}={quoted(value)}"'
        if not word.values and (not is_sweep or asked.choice("hydra/sweeper") == "pairs"):
            raise InputError("no list of values", word.text, "list them, or write range(start,stop,step)")
        if word.head == "dataset" and not has_dataset and (key.partition(".")[2] in paths or not asked.experiment):
            remedy = f"add dataset=NAME, for example dataset=colmap {word.text}"
            raise InputError("no dataset is named", word.text, remedy)
        if word.is_swept and os.path.exists(value):  # noqa: PTH110 - pathlib's raises OSError for a long list of values
            raise InputError("is one path with a comma", word.text, f"write {quotes} with both kinds of quotes")
        if word.is_swept and key in ("metrics", "views") and not value.startswith("["):
            raise InputError("several values", word.text, f"write {key}=[{value}]")
        if key == "metrics" and not all(fits(list[str], v if isinstance(v, list) else [v]) for v in word.values):
            raise InputError("is no list of names", word.text, "write metrics=[psnr,uciqe:all]")
        if word.is_swept and not is_sweep:
            raise InputError("several values", word.text, f"add -m to run them all, or write {quotes} for a comma")


_OF_RUN = frozenset(option.name for option in options_of(RunConfig))


def unknown_word(word: Word, chosen: Mapping[Kind, Sequence[Entry]], asked: Asked) -> InputError:
    """Return the fault of a word that is no option of the run, or of a chosen dataset or method.

    asked: words may have replaced the datasets or methods of its experiment.
    """
    text, key, head, dot = word.text, word.key, word.head, "." in word.key
    for kind, entries in chosen.items():
        names = ",".join(dict.fromkeys(entry.name for entry in entries))
        owners = dict.fromkeys(entry.name for entry in entries if key in option_names(kind, entry.name))
        if owners:
            before = [kind] if len(entries) == 1 else [*owners]
            return InputError(f"is an option of a {kind}", text, f"write {' or '.join(f'{b}.{text}' for b in before)}")
        if dot and plugin_of(kind, head):
            return InputError(f"'{head}' is not among the {kind}s", text, f"add it: -m {kind}={names},{head}")
        if dot and head in {entry.label for entry in _listed(kind, asked)}:
            remedy = f"leave out {kind}={names} or {key}"
            return InputError(f"'{head}' is not among the {kind}s of this run", text, remedy)
    if dot and plugin_of("metric", head):
        return InputError("is an option of a metric", text, f"write metrics.{text}")
    owned = {name for entries in chosen.values() for entry in entries for name in (entry.name, entry.label) if name}
    return unknown_name(key, head, {*_OF_RUN, *owned})
