"""Reads the words of a command: those that set something, those that Hydra composes with, and the experiment.

Words that cannot be meant are refused here, with the words that were probably meant.
"""

from __future__ import annotations

import contextlib
import difflib
import itertools
import os
import re
import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench import plugins
from sucre_bench.arguments import fits
from sucre_bench.errors import InputError, SucreBenchError, in_one_line
from sucre_bench.jobs import hydra_configs
from sucre_bench.jobs.asked import KINDS, Asked
from sucre_bench.jobs.catalogue import GROUPS, plugin_of
from sucre_bench.jobs.run_options import OPTION_GROUPS, RunConfig
from sucre_bench.jobs.word_syntax import QUOTED, Word, parse, quoted
from sucre_bench.machine.files import check_folder, expanded, fault_of
from sucre_bench.plugins.options import options_of

if TYPE_CHECKING:
    from omegaconf import DictConfig

FILE = "file"  # the name by which Hydra knows an experiment that is given by path


@contextlib.contextmanager
def reading_experiment(words: Sequence[str]) -> Iterator[list[str]]:
    """Give the words, with ~ expanded; an experiment's file among them can be read by name in this block."""
    words = [_with_home(word) for word in words]
    with contextlib.ExitStack() as block:
        for file in filter(_is_file, words):
            if fault := fault_of(expanded(file)):
                raise InputError(
                    fault,
                    file,
                    "give an experiment, `sucre-bench list experiments` shows those by name",
                )
            block.enter_context(
                hydra_configs.searching(f"experiment://{expanded(file).resolve()}")
            )
        block.enter_context(hydra_configs.searching(*_search_path(words)))
        yield words


def _with_home(word: str) -> str:
    """A word with the ~ before its value expanded; the shell does so only at the start of a word."""
    key, _, value = word.partition("=")
    value = value.strip("'\"")
    return f"{key}='{expanded(value)}'" if value.startswith("~/") else word


def _search_path(words: Sequence[str]) -> Iterator[str]:
    """Yield the places of `hydra.searchpath`, which Hydra reads where it composes; presets are looked for before."""
    given = parse(word for word in words if word.lstrip("+").startswith("hydra.searchpath="))
    for word in given:
        if any(not isinstance(value, list) for value in word.values):
            folder = word.text.partition("=")[2]
            remedy = f"write 'hydra.searchpath=[{folder}]', or --config-dir {folder}"
            raise InputError("is no list", word.text, remedy)
        for place in itertools.chain(*word.values):
            folder = str(place).removeprefix("file://")
            if "://" not in folder:
                check_folder(
                    expanded(folder), "give a folder that holds method/, experiment/ and others"
                )
                folder = f"file://{expanded(folder).resolve()}"
            yield folder


def read(words: Sequence[str], multirun: bool, config: DictConfig | None = None) -> Asked:
    """Read the words of a command, and let Hydra compose what the jobs of a sweep share, unless it is given."""
    files = [word for word in words if _is_file(word)]
    for word in words:
        if len(re.sub(QUOTED, "", f"{word}.").splitlines()) > 1:
            # in quotes it is part of a name
            raise InputError(
                f"{in_one_line(word)!r}: holds a line break; give each word in one line"
            )
        if is_bare(word) and word not in files:
            raise bare_word(word, [word for word in words if word not in files])
    lines = [f"experiment={FILE}" if word in files else word for word in words]
    _load_named(lines)
    typed = parse(lines, hydra_configs.loader())
    groups = [word for word in typed if _is_of_hydra(word)]
    for one in groups:
        known = hydra_configs.loader().get_group_options(one.key) if None in one.values else []
        if known:
            raise InputError("is no choice", one.text, f"give one of {', '.join(known)}")
    experiments = [word for word in groups if word.key == "experiment"]
    for one in experiments:
        if len(experiments) > 1 or len(one.values) > 1 or not isinstance(one.values[0], str):
            place = files[-1] if files else one.text
            remedy = "give a command for each: experiment=NAME, or a file"
            raise InputError("one experiment at a time", place, remedy)
    experiment = (
        files[0] if files else "".join(f"experiment={w.values[0]}" for w in experiments)
    )
    of_hydra = tuple(word.line for word in groups)
    rest = [word for word in typed if word not in groups]
    has_mode = any(word.key == "hydra.mode" for word in groups)
    if config is None and (multirun or experiment or has_mode):
        try:
            config = hydra_configs.composed([*of_hydra, *_shared(rest)], is_sweep=True)
        except SucreBenchError as fault:
            raise (fault.within(files[0]) if files else fault) from fault
        mode, sweeper = config.hydra.mode, config.hydra.sweeper
        is_listed = any(sweeper.get(key) for key in ("methods", "datasets", "params"))
        if not (multirun or (mode.name == "MULTIRUN" if mode else is_listed)):
            config = None
    if config is not None:
        _load([hydra_configs.selected(config, "plugins") or []])
    asked = Asked(tuple(words), tuple(rest), of_hydra, experiment, config)
    _refuse(asked)
    return asked


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
    named = {"plugins": list[Any](), "experiment": list[Any]()}
    first = (line for line in lines if line.lstrip("+").partition("=")[0] in named)
    for word in parse(first, hydra_configs.loader()):
        named[word.key] += word.values
    _load(named["plugins"])
    for name in (
        hydra_configs.config_name(),
        *(f"experiment/{n}" for n in named["experiment"]),
    ):
        _load([hydra_configs.written(name, "plugins") or []])


def _load(values: Iterable[Any]) -> None:
    """Load plugin files, named one by one or in lists, before their plugins can be chosen."""
    for value in values:
        for file in value if isinstance(value, list) else [value]:
            plugins.load_file(str(file))


def _refuse(asked: Asked) -> None:
    """Raise InputError for several values where no sweep was asked for, for a path with a comma, and for a dataset's
    option where no dataset is named: the built-in one would take it.

    An experiment may leave the dataset open or name several; where the data are needs a dataset in the words.
    """
    is_sweep = asked.config is not None
    paths = set[str]()
    if plugin := plugin_of("dataset", asked.choice("dataset")):
        paths = {o.name for o in options_of(plugin.cls) if Path in o.kinds}
    has_dataset = any(word.key == "dataset" for word in asked.typed)
    for word in asked.typed:
        key = word.key
        value = word.text.partition("=")[2]
        quotes = f'"{key}={quoted(value)}"'
        if word.is_glob and not word.values:
            raise InputError(
                "fits no name", word.text, "`sucre-bench list methods` shows the names"
            )
        if not word.values and (not is_sweep or asked.choice("hydra/sweeper") == "pairs"):
            raise InputError(
                "no list of values", word.text, "list them, or write range(start,stop,step)"
            )
        if (
            word.head == "dataset"
            and not has_dataset
            and (word.option in paths or not asked.experiment)
        ):
            remedy = f"add dataset=NAME, for example dataset=colmap {word.text}"
            raise InputError("no dataset is named", word.text, remedy)
        if word.is_swept and os.path.exists(value):  # noqa: PTH110 - pathlib's raises OSError for a long list of values
            raise InputError(
                "is one path with a comma",
                word.text,
                f"write {quotes} with both kinds of quotes",
            )
        if word.is_swept and key in ("metrics", "views") and not value.startswith("["):
            names = ",".join(map(str, word.values)) if word.is_glob else value
            raise InputError("several values", word.text, f"write {key}=[{names}]")
        if key == "metrics" and not all(
            fits(v if isinstance(v, list) else [v], list[str]) for v in word.values
        ):
            raise InputError("is no list of names", word.text, "write metrics=[psnr,uciqe:all]")
        if word.is_swept and not is_sweep:
            raise InputError(
                "several values",
                word.text,
                f"add -m to run them all, or write {quotes} for a comma",
            )


# -- words without a key ---------------------------------------------------------------------------------------


def _is_file(word: str) -> bool:
    """Whether a word is the path of an experiment."""
    return is_bare(word) and Path(word).suffix.lower() in (".yaml", ".yml")


def is_bare(word: str) -> bool:
    """Whether a word has no key: neither key=value nor ~key."""
    return "=" not in word and not word.startswith("~")


def bare_word(word: str, words: Sequence[str]) -> InputError:
    """Return the fault of a word that has no key, with the command that was probably meant. words: of the command."""
    groups = (*KINDS, "metrics", "study", "hydra", *OPTION_GROUPS)
    if "." in word and word.partition(".")[0] in groups:
        return InputError(
            "has no value", word, f"an override reads key=value, write {word}=VALUE"
        )
    keys = dict.fromkeys(hydra_configs.preset_names("experiment"), "experiment")
    for kind, key in GROUPS.items():
        presets = hydra_configs.preset_names(key) if kind != "metric" else []
        keys |= dict.fromkeys([*plugins.discover(kind), *presets], key)
    keyed: dict[str, list[str]] = {}
    for name in filter(is_bare, words):
        near = next(iter(difflib.get_close_matches(name, keys, n=1, cutoff=0.7)), "")
        key = keys.get(near, "")
        if near != name and expanded(name).is_dir():
            key = "dataset"
            near = quoted(name if "/" in name else f"./{name}")
        keyed.setdefault(key, []).append(near)
    if "" in keyed:
        remedy = "`sucre-bench list methods` and `list datasets` show the names"
        return InputError("an override reads key=value", word, remedy)
    meant = []
    for key, names in keyed.items():
        listed = ",".join(names)
        meant.append(f"metrics=[{listed}]" if key == "metrics" else f"{key}={listed}")
    is_sweep = any("," in text for text in meant if not text.startswith("metrics"))
    words = [*meant, *(word for word in words if not is_bare(word))]
    remedy = f"write sucre-bench run {'-m ' if is_sweep else ''}{shlex.join(words)}"
    return InputError("an override reads key=value", word, remedy)
