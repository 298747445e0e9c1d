"""Reads the words of a command: those that set something, those that Hydra composes with, and the experiment.

Words that cannot be meant are refused here.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench import plugins
from sucre_bench.arguments import fits
from sucre_bench.errors import InputError, SucreBenchError
from sucre_bench.jobs import hydra_configs
from sucre_bench.jobs.asked import Asked
from sucre_bench.jobs.catalogue import KINDS, plugin_of
from sucre_bench.jobs.run_options import RunConfig
from sucre_bench.jobs.word_syntax import Word, parse, quoted
from sucre_bench.machine.files import check_folder, expanded, fault_of
from sucre_bench.plugins.options import options_of

if TYPE_CHECKING:
    from omegaconf import DictConfig

FILE = "file"  # the name by which Hydra knows an experiment that is given by path


@contextlib.contextmanager
def reading_experiment(words: Sequence[str]) -> Iterator[list[str]]:
    """Give the words, with ~ expanded; an experiment's file among them can be read by name in this block."""
    words = [_with_home(word) for word in words]
    places = list[str]()
    for file in filter(_is_file, words):
        if fault := fault_of(expanded(file)):
            remedy = "give an experiment, `sucre-bench list experiments` shows those by name"
            raise InputError(fault, file, remedy)
        places.append(f"experiment://{expanded(file).resolve()}")
    with hydra_configs.searching(*_search_path(words), *places):
        yield words


def _with_home(word: str) -> str:
    """A word with the ~ before its value expanded; the shell does so only at the start of a word."""
    key, _, value = word.partition("=")
    value = value.strip("'\"")
    return f"{key}='{expanded(value)}'" if value.startswith("~/") else word


def _search_path(words: Sequence[str]) -> Iterator[str]:
    """Yield the places of `hydra.searchpath`, which Hydra reads where it composes; presets are looked for before."""
    given = parse(word for word in words if word.lstrip("+").startswith("hydra.searchpath=["))
    for place in itertools.chain(*(word.values[0] for word in given)):
        folder = str(place).removeprefix("file://")
        if "://" not in folder:
            remedy = "give a folder that holds method/, experiment/ and others"
            check_folder(expanded(folder), remedy)
            folder = f"file://{expanded(folder).resolve()}"
        yield folder


def read(words: Sequence[str], multirun: bool) -> Asked:
    """Read the words of a command, and let Hydra compose what the jobs of a sweep share."""
    files = [word for word in words if _is_file(word)]
    for text in words:
        if "=" not in text and not text.startswith("~") and text not in files:
            remedy = "write method=NAME, dataset=NAME or method.OPTION=VALUE, see run --help"
            raise InputError("an override reads key=value", text, remedy)
    lines = [f"experiment={FILE}" if word in files else word for word in words]
    _load_named(lines)
    typed = parse(lines, hydra_configs.loader())
    groups = [word for word in typed if _is_of_hydra(word)]
    rest = [word for word in typed if word not in groups]
    for word in groups:
        if None in word.values and (known := hydra_configs.names(word.key)):
            raise InputError("is no choice", word.text, f"give one of {', '.join(known)}")
    experiments = [word for word in groups if word.key == "experiment"]
    experiment = ""
    for word in experiments:
        experiment = files[0] if files else word.text
        if len(experiments) > 1 or word.is_swept:
            remedy = "give a command for each: experiment=NAME, or a file"
            raise InputError("one experiment at a time", experiment, remedy)
    of_hydra = tuple(word.line for word in groups)
    has_mode = any(word.key == "hydra.mode" for word in groups)
    config: DictConfig | None = None
    if multirun or experiment or has_mode:
        try:
            config = hydra_configs.composed([*of_hydra, *_shared(rest)], is_sweep=True)
        except SucreBenchError as fault:
            raise (fault.within(files[0]) if files else fault) from fault
        mode = config.hydra.mode
        sweeper = config.hydra.sweeper
        is_listed = any(sweeper.get(key) for key in ("methods", "datasets", "params"))
        if not (multirun or (mode.name == "MULTIRUN" if mode else is_listed)):
            config = None
    if config is not None:
        _load([hydra_configs.selected(config, "plugins") or []])
    asked = Asked(tuple(words), tuple(rest), of_hydra, experiment, config)
    for word in rest:
        _refuse(word, asked)
    return asked


def _is_file(word: str) -> bool:
    """Whether a word is the path of an experiment."""
    return "=" not in word and Path(word).suffix.lower() in (".yaml", ".yml")


def _shared(words: Iterable[Word]) -> Iterator[str]:
    """Yield the options of the run that all jobs have, as Hydra reads them: its own keys may refer to ${out}."""
    defaults = RunConfig.defaults()
    for word in words:
        is_option = word.key in defaults or isinstance(defaults.get(word.head), dict)
        is_choice = word.head in (*KINDS, "metrics")
        if is_option and not (is_choice or word.is_swept or word.is_deleted):
            yield f"++{word.key}={word.value}"


def _is_of_hydra(word: Word) -> bool:
    """Whether Hydra composes with a word: it is one of its own, or chooses a config of a group."""
    if "/" in word.key or "@" in word.key or word.head == "hydra":
        return True
    is_ours = word.key in (*KINDS, "metrics") or "." in word.key
    return not is_ours and bool(hydra_configs.loader().repository.group_exists(word.key))


def _load_named(lines: Iterable[str]) -> None:
    """Load the plugin files of the words, of the configuration to begin with and of the experiment.

    So names of their plugins can be chosen, also by the experiment's own defaults list.
    """
    configs = [hydra_configs.config_name()]
    for line in lines:
        key = line.lstrip("+").partition("=")[0]
        if key in ("plugins", "experiment"):
            (word,) = parse([line], hydra_configs.loader())
            if key == "plugins":
                _load(word.values)
            else:
                configs += [f"experiment/{name}" for name in word.values]
    for name in configs:
        _load([hydra_configs.written(name, "plugins") or []])


def _load(values: Iterable[Any]) -> None:
    """Load plugin files, named one by one or in lists, before their plugins can be chosen."""
    for value in values:
        for file in value if isinstance(value, list) else [value]:
            plugins.load_file(str(file))


def _refuse(word: Word, asked: Asked) -> None:
    """Raise InputError for several values where no sweep was asked for, and for a dataset's option where no dataset is
    named: the built-in one would take it.

    An experiment may leave the dataset open or name several; where the data are needs a dataset in the words.
    """
    value = word.text.partition("=")[2]
    is_sweep = asked.config is not None
    if word.is_glob and not word.values:
        remedy = f"`sucre-bench list {word.key}s` shows the names"
        raise InputError("fits no name", word.text, remedy)
    if not word.values and (not is_sweep or asked.choice("hydra/sweeper") == "pairs"):
        remedy = "list them, or write range(start,stop,step)"
        raise InputError("no list of values", word.text, remedy)
    if word.head == "dataset" and not any(one.key == "dataset" for one in asked.typed):
        cls = plugin_of("dataset", asked.choice("dataset")).cls
        paths = [option.name for option in options_of(cls) if Path in option.kinds]
        if word.option in paths or not asked.experiment:
            remedy = f"add dataset=NAME, for example dataset=colmap {word.text}"
            raise InputError("no dataset is named", word.text, remedy)
    lists = [one if isinstance(one, list) else [one] for one in word.values]
    is_parted = word.is_swept and lists != [*word.values]
    if word.key == "metrics" and not all(fits(names, list[str]) for names in lists):
        is_parted = True
    if is_parted and word.key in ("metrics", "views"):
        raise InputError("is no list of names", word.text, f"write {word.key}=[NAME,NAME]")
    if word.is_swept and not is_sweep:
        remedy = f'add -m to run them all, or write "{word.key}={quoted(value)}" for a comma'
        raise InputError("several values", word.text, remedy)
