"""What the words of a command ask for: those that set something, those that Hydra composes with, and the experiment.

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
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from sucre_bench import plugins
from sucre_bench.errors import InputError, SucreBenchError, in_one_line
from sucre_bench.jobs import configs
from sucre_bench.jobs.catalogue import plugin_of
from sucre_bench.jobs.run_options import OPTION_GROUPS, RunConfig
from sucre_bench.jobs.words import QUOTED, Word, parse, quoted
from sucre_bench.machine.files import check_folder, expanded, fault_of
from sucre_bench.plugins.options import options_of
from sucre_bench.plugins.plugin import fits

if TYPE_CHECKING:
    from omegaconf import DictConfig

Kind = Literal["dataset", "method"]
KINDS: tuple[Kind, ...] = ("dataset", "method")
FILE = "file"  # the name by which Hydra knows an experiment that is given by path
_SWEEPER = "hydra.sweeper.params."  # before words that Hydra sweeps over


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
        return (
            configs.selected(self.config, f"hydra.sweeper.{key}")
            if self.config is not None
            else None
        ) or ()

    def choice(self, group: str) -> str:
        """Return what Hydra chooses of a group where no word does."""
        chosen = (
            self.config.hydra.runtime.choices
            if self.config is not None
            else configs.default_choices()
        )
        return str(chosen[group])


@contextlib.contextmanager
def reading_experiment(words: Sequence[str]) -> Iterator[list[str]]:
    """Give the words, with ~ expanded; an experiment's file among them can be read by name in this block."""
    # A leading ~ of a value is expanded here; the shell does so only at the start of a word.
    parts = [(word, word.partition("=")[0], word.partition("=")[2].strip("'\"")) for word in words]
    words = [
        f"{key}='{expanded(value)}'" if value.startswith("~/") else word
        for word, key, value in parts
    ]
    files = [
        word for word in words if is_bare(word) and Path(word).suffix.lower() in (".yaml", ".yml")
    ]
    if len(files) > 1:
        raise InputError("a second experiment", files[1], "run one at a time")
    with contextlib.ExitStack() as block:
        for file in files:
            if fault := fault_of(expanded(file)):
                raise InputError(
                    fault,
                    file,
                    "give an experiment, `sucre-bench list experiments` shows those by name",
                )
            block.enter_context(configs.searching(f"experiment://{expanded(file).resolve()}"))
        block.enter_context(configs.searching(*_search_path(words)))
        yield words


def _search_path(words: Sequence[str]) -> Iterator[str]:
    """Yield the places of `hydra.searchpath`, which Hydra reads where it composes; presets are looked for before."""
    given = parse(word for word in words if word.lstrip("+").startswith("hydra.searchpath="))
    for word in given:
        if any(not isinstance(value, list) for value in word.values):
            folder = word.text.partition("=")[2]
            remedy = f"write 'hydra.searchpath=[{folder}]', or --config-dir {folder}"
            raise InputError("is no list", word.text, remedy)
    for place in itertools.chain(*(value for word in given for value in word.values)):
        folder = str(place).removeprefix("file://")
        if "://" not in folder:
            check_folder(
                expanded(folder), "give a folder that holds method/, experiment/ and others"
            )
            folder = f"file://{expanded(folder).resolve()}"
        yield folder


def read(words: Sequence[str], multirun: bool, config: DictConfig | None = None) -> Asked:
    """Read the words of a command, and let Hydra compose what the jobs of a sweep share, unless it is given."""
    files = [
        word for word in words if is_bare(word) and Path(word).suffix.lower() in (".yaml", ".yml")
    ]
    overrides = [word for word in words if word not in files]
    for word in overrides:
        if len(re.sub(QUOTED, "", f"{word}.").splitlines()) > 1:  # in quotes it is part of a name
            raise InputError(
                f"{in_one_line(word)!r}: holds a line break; give each word in one line"
            )
        if is_bare(word):
            raise bare_word(word, overrides)
    loader = configs.hydra_app().config_loader
    parsed = parse(overrides, loader)
    params = [word for word in parsed if f"{word.key}.".startswith(_SWEEPER)]
    typed = parse((text for word in params for text in _swept(word)), loader)
    typed += [word for word in parsed if word not in params]
    _load([word for word in typed if word.key == "plugins"])
    groups = [word for word in typed if _is_of_hydra(word)]
    for one in groups:
        known = loader.get_group_options(one.key) if None in one.values else []
        if known:
            raise InputError("is no choice", one.text, f"give one of {', '.join(known)}")
    experiments = [word for word in groups if word.key == "experiment"]
    if len(experiments) + len(files) > 1:
        raise InputError("beside another experiment", experiments[-1].text, "run one at a time")
    for one in experiments:
        if len(one.values) > 1 or not isinstance(one.values[0], str):
            raise InputError("one experiment at a time", one.text, "give experiment=NAME")
    of_hydra = [
        *(f"experiment={FILE}" for _ in files),
        *(word.line for word in typed if word in groups),
    ]
    named = [*files, *(f"experiment={one.values[0]}" for one in experiments)]
    experiment = named[0] if named else ""
    is_sweep = multirun or bool(experiment) or any(word.key == "hydra.mode" for word in groups)
    if is_sweep and config is None:
        try:
            config = configs.composed(
                [*of_hydra, *_shared(word for word in typed if word not in groups)], is_sweep=True
            )
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


def _swept(word: Word) -> Iterator[str]:
    """Yield what a word of `hydra.sweeper.params` sets, one key or a mapping of keys, as words of a command."""
    name = word.key.removeprefix(_SWEEPER.rstrip(".")).lstrip(".")
    given: Any = {name: ",".join(map(str, word.values))} if name else word.values[0]
    if not isinstance(given, dict):
        remedy = f'write {word.key}={{OPTION: "VALUE,VALUE"}}'
        raise InputError("is no mapping", word.text, remedy)
    yield from (f"{key}={text}" for key, text in given.items())


def _shared(words: Iterable[Word]) -> Iterator[str]:
    """Yield the options of the run that all jobs have, as Hydra reads them: its own keys may refer to ${out}."""
    defaults = RunConfig.defaults()
    for word in words:
        is_option = word.key in defaults or isinstance(defaults.get(word.head), dict)
        if (
            is_option
            and word.head not in (*KINDS, "metrics")
            and not word.is_swept
            and not word.is_deleted
        ):
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


def _refuse(asked: Asked) -> None:
    """Raise InputError for several values where no sweep was asked for, for a path with a comma, and for a dataset's
    option where no dataset is named: the built-in one would take it.

    An experiment may leave the dataset open or name several; where the data are needs a dataset in the words.
    """
    typed, is_sweep = asked.typed, asked.config is not None
    plugin, has_dataset = (
        plugin_of("dataset", asked.choice("dataset")),
        any(word.key == "dataset" for word in typed),
    )
    paths = (
        {o.name for o in options_of(plugin.cls) if Path in (o.type, *get_args(o.type))}
        if plugin
        else set()
    )
    for word in typed:
        key, value = word.key, word.text.partition("=")[2]
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
            and (key.partition(".")[2] in paths or not asked.experiment)
        ):
            remedy = f"add dataset=NAME, for example dataset=colmap {word.text}"
            raise InputError("no dataset is named", word.text, remedy)
        if word.is_swept and os.path.exists(value):  # noqa: PTH110 - pathlib's raises OSError for a long list of values
            raise InputError(
                "is one path with a comma", word.text, f"write {quotes} with both kinds of quotes"
            )
        if word.is_swept and key in ("metrics", "views") and not value.startswith("["):
            names = ",".join(map(str, word.values)) if word.is_glob else value
            raise InputError("several values", word.text, f"write {key}=[{names}]")
        if key == "metrics" and not all(
            fits(list[str], v if isinstance(v, list) else [v]) for v in word.values
        ):
            raise InputError("is no list of names", word.text, "write metrics=[psnr,uciqe:all]")
        if word.is_swept and not is_sweep:
            raise InputError(
                "several values",
                word.text,
                f"add -m to run them all, or write {quotes} for a comma",
            )


# -- words without a key ---------------------------------------------------------------------------------------


def is_bare(word: str) -> bool:
    """Whether a word has no key: neither key=value nor ~key."""
    return "=" not in word and not word.startswith("~")


def bare_word(word: str, words: Sequence[str]) -> InputError:
    """Return the fault of a word that has no key, with the command that was probably meant. words: of the command."""
    groups = (*KINDS, "metrics", "study", "hydra", *OPTION_GROUPS)
    if "." in word and word.partition(".")[0] in groups:
        return InputError("has no value", word, f"an override reads key=value, write {word}=VALUE")
    names = {
        "dataset": [*plugins.discover("dataset")],
        "method": [*plugins.discover("method"), *configs.preset_names("method")],
        "metrics": [*plugins.discover("metric")],
        "experiment": configs.preset_names("experiment"),
    }
    keyed: dict[str, list[str]] = {}
    for name in filter(is_bare, words):
        (near, *_) = difflib.get_close_matches(
            name, itertools.chain(*names.values()), n=1, cutoff=0.7
        ) or [""]
        key = next((key for key, known in names.items() if near in known), "")
        if near != name and expanded(name).is_dir():
            key, near = "dataset", quoted(name if "/" in name else f"./{name}")
        keyed.setdefault(key, []).append(near)
    remedy = "`sucre-bench list methods` and `list datasets` show the names"
    if "" not in keyed:
        several = (
            "-m " if any(len(names) > 1 for key, names in keyed.items() if key != "metrics") else ""
        )
        meant = [
            f"{key}=[{','.join(n)}]" if key == "metrics" else f"{key}={','.join(n)}"
            for key, n in keyed.items()
        ]
        remedy = f"write sucre-bench run {several}{shlex.join([*meant, *(w for w in words if not is_bare(w))])}"
    return InputError("an override reads key=value", word, remedy)
