"""What the words of a command ask for: which datasets and methods they choose, and what is an option of which."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench.errors import InputError, unknown_name
from sucre_bench.jobs import hydra_configs
from sucre_bench.jobs.catalogue import (
    KINDS,
    configuration,
    is_path,
    option_names,
    plugin_of,
    recognised,
)
from sucre_bench.jobs.run_options import RunConfig
from sucre_bench.jobs.word_syntax import Word, parse, value_of
from sucre_bench.machine.progress import say
from sucre_bench.machine.provenance import absent
from sucre_bench.plugins.options import options_of
from sucre_bench.plugins.plugin import Kind

if TYPE_CHECKING:
    from omegaconf import DictConfig

_OF_RUN = frozenset(option.name for option in options_of(RunConfig))


@dataclass(frozen=True)
class Entry:
    """A dataset or method with options of its own."""

    kind: Kind

    name: str
    """Of a plugin or a preset."""

    options: Mapping[str, Any] = field(default_factory=dict)
    """Its label is among them. A method has its display, too, and a dataset what degrades it."""

    is_one_of_many: bool = False
    """Whether labels must name its options, which tell it from others of its name."""

    @property
    def label(self) -> str:
        """The given label, empty where none is given."""
        return str(self.options.get("label") or "")

    def is_meant(self, word: Word) -> bool:
        """Whether a word is for it: for all of its kind, or by its name or label."""
        return "." in word.key and word.head in (self.kind, self.name, self.label or self.name)

    def has(self, word: Word) -> bool:
        """Whether a word sets an option of it."""
        option = word.option.partition(".")[0]
        return self.is_meant(word) and option in option_names(self.kind, self.name)

    def words(self) -> Iterator[Word]:
        """Yield its options as settings of a configuration."""
        for name, given in self.options.items():
            settings = {f"{self.kind}.{name}": given}
            if name == "degrade":
                settings = dict(flat(name, given))
            for key, value in settings.items():
                text = f"{key}={value_of(value)}"
                yield Word(key, (value,), text, self.is_one_of_many, line=f"++{text}")


def flat(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield each value of nested mappings with its key."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from flat(f"{key}.{name}".lstrip("."), inner)
    else:
        yield key, value


@dataclass(frozen=True)
class Asked:
    """What the words of a command say.

    What the words choose is looked up when asked for. Raises InputError then for a name that there is not, and for a
    list that cannot be read.
    """

    words: tuple[str, ...]
    """Of the command, with ~ expanded."""

    typed: tuple[Word, ...]
    """Those that set something."""

    of_hydra: tuple[str, ...]
    """Overrides that Hydra composes with, the same for all jobs: of itself and of groups of configs."""

    experiment: str
    """As the user named it, a file or a name; empty for none."""

    config: DictConfig | None
    """What the jobs of a sweep share; None for a single job."""

    def sweeper(self, key: str) -> Any:
        """Return a list or mapping of the sweeper, `hydra.sweeper.methods` say."""
        if self.config is None:
            return ()
        return hydra_configs.selected(self.config, f"hydra.sweeper.{key}") or ()

    def choice(self, group: str) -> str:
        """Return what Hydra chooses of a group where no word does."""
        if self.config is None:
            choices = hydra_configs.choices()
        else:
            choices = self.config.hydra.runtime.choices
        if group not in choices:
            fault = f"the configuration '{hydra_configs.config_name()}' chooses no {group}"
            raise InputError(fault, "--config-name", "begin its defaults list with `config`")
        return str(choices[group])

    @cached_property
    def settings(self) -> list[Word]:
        """All words: those that an experiment sweeps over, then those of the command.

        Where the command chooses other methods, options of the experiment's are left out.
        """
        swept = dict(self.sweeper("params"))
        params = parse(f"{key}={value}" for key, value in flat("", swept))
        return [*(word for word in params if not self._is_replaced(word)), *self.typed]

    def _is_replaced(self, word: Word) -> bool:
        """Whether the command chooses other datasets or methods than those that have an option of the experiment."""
        replaced = {one.key for one in self.typed if one.key in KINDS}
        chosen = [entry for kind in KINDS for entry in self.chosen[kind]]
        if word.head in replaced:
            return word.key not in KINDS and not any(entry.has(word) for entry in chosen)
        is_named = word.head in _OF_RUN or any(entry.is_meant(word) for entry in chosen)
        return bool(replaced) and not is_named

    @cached_property
    def chosen(self) -> dict[Kind, list[Entry]]:
        """What runs."""
        made: dict[Kind, list[Entry]] = {}
        for kind in KINDS:
            chosen = self._chosen(kind)
            unlabelled = Counter(entry.name for entry in chosen if not entry.label)
            made[kind] = [
                replace(entry, is_one_of_many=not entry.label and unlabelled[entry.name] > 1)
                for entry in chosen
            ]
        return made

    def _chosen(self, kind: Kind) -> list[Entry]:
        """Those of the last word that names some, of the experiment, or what Hydra chooses."""
        words = [word for word in self.typed if word.key == kind]
        listed = self.sweeper(f"{kind}s")
        if listed and not words:
            return [_listed(kind, one) for one in listed]
        if not words and kind in self.sweeper("params"):
            words = parse([f"{kind}={self.sweeper('params')[kind]}"])
        if not words:
            return [_entry(kind, self.choice(kind))]
        word = words[-1]
        if not all(isinstance(name, (str, int, float)) for name in word.values):
            remedy = f"-m {kind}=a,b runs several; write {kind}.OPTION=VALUE for an option"
            raise InputError("one name at a time", word.text, remedy)
        entries = [_entry(kind, str(name)) for name in word.values]
        if not word.is_glob:
            return entries
        lacking = {entry.name: self._lack(entry) for entry in entries}
        left_out = [f"{name} ({lack})" for name, lack in lacking.items() if lack]
        if left_out:
            say(f"{word.text} leaves out what lacks something: {', '.join(left_out)}")
        entries = [entry for entry in entries if not lacking[entry.name]]
        if not entries:
            raise InputError("all that fit lack something", word.text, f"name one: {kind}=NAME")
        return entries

    def _lack(self, entry: Entry) -> str:
        """What a plugin or preset lacks: an option that no word gives, or packages; empty for nothing."""
        values = configuration(entry.kind, entry.name)
        given = {word.option for word in self.typed if entry.has(word)}
        for option, value in values.items():
            if value == "???" and option not in given:
                return f"{entry.name}.{option}"
        lacking = absent(*plugin_of(entry.kind, entry.name).requires)
        return lacking.install if lacking else ""

    def kind_of(self, word: Word) -> Kind | None:
        """Return whose option a word sets, None for a word for the whole run. InputError for one that is neither."""
        meant = [entry for kind in KINDS for entry in self.chosen[kind] if entry.is_meant(word)]
        for entry in meant:
            if entry.has(word):
                return entry.kind
        if meant:
            known = {name for entry in meant for name in option_names(entry.kind, entry.name)}
            raise unknown_name(word.key, word.option, known)
        if word.head not in _OF_RUN:
            raise self._unknown(word)
        return None

    def _unknown(self, word: Word) -> InputError:
        """The fault of a word that is no option of the run, or of a chosen dataset or method."""
        known = {*_OF_RUN}
        for kind, entries in self.chosen.items():
            for entry in entries:
                known |= {entry.name, entry.label}
                if word.key in option_names(kind, entry.name):
                    remedy = f"write {entry.name}.{word.text}"
                    return InputError(f"is an option of a {kind}", word.text, remedy)
            if word.option and option_names(kind, word.head):
                remedy = f"add it to {kind}=, or leave out {word.key}"
                return InputError(f"no {kind} '{word.head}' runs here", word.text, remedy)
        return unknown_name(word.key, word.head, known - {""})


def _listed(kind: Kind, given: Any) -> Entry:
    """A dataset or method that an experiment lists for the sweeper."""
    options = {kind: given} if isinstance(given, str) else given
    if not (isinstance(options, Mapping) and isinstance(options.get(kind), str)):
        remedy = f"write NAME, or {{{kind}: NAME, OPTION: VALUE}}"
        raise InputError(f"{given!r} has no name", f"hydra.sweeper.{kind}s", remedy)
    entry = _entry(kind, options[kind])
    own = {str(name): value for name, value in options.items() if name != kind}
    known = {*option_names(kind, entry.name), *(["degrade"] if kind == "dataset" else [])}
    if unknown := own.keys() - known:
        option = min(unknown)
        raise unknown_name(f"{entry.name}.{option}", option, known)
    return replace(entry, options={**entry.options, **own})


def _entry(kind: Kind, name: str) -> Entry:
    """A dataset or method of this name; a folder is the dataset that recognises it."""
    if kind == "dataset" and is_path(name):
        return Entry(kind, recognised(Path(name)), {"root": str(Path(name))})
    configuration(kind, name)  # raises for an unknown name
    return Entry(kind, name)
