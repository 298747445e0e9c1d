"""What the words of a command ask for: which datasets and methods they choose, and what is an option of which."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from sucre_bench import plugins
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.jobs import hydra_configs
from sucre_bench.jobs.catalogue import (
    is_path,
    named,
    option_names,
    plugin_of,
    preset_of,
    recognised,
)
from sucre_bench.jobs.run_options import RunConfig
from sucre_bench.jobs.word_syntax import Word, parse, value_of
from sucre_bench.machine.progress import say
from sucre_bench.machine.provenance import absent
from sucre_bench.plugins.options import options_of

if TYPE_CHECKING:
    from omegaconf import DictConfig

Kind = Literal["dataset", "method"]
KINDS: tuple[Kind, ...] = ("dataset", "method")
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

    word: str = ""
    """What the user types before its options."""

    @property
    def label(self) -> str:
        """The given label, empty where none is given."""
        return str(self.options.get("label") or "")

    @property
    def names(self) -> tuple[str, str]:
        """The names by which words mean it."""
        return self.name, self.label or self.name

    def is_meant(self, word: Word) -> bool:
        """Whether a word is for it: for all of its kind, or by its name."""
        return "." in word.key and word.head in (self.kind, *self.names)

    def has(self, word: Word) -> bool:
        """Whether a word sets an option of it."""
        option = word.option.partition(".")[0]
        return self.is_meant(word) and option in option_names(self.kind, self.name)

    def words(self) -> Iterator[Word]:
        """Yield its options as settings of a configuration."""
        for name, given in self.options.items():
            settings = [(f"{self.kind}.{name}", given)]
            if name == "degrade":
                settings = [*_flat(name, given)]
            for key, value in settings:
                text = f"{key}={value_of(value)}"
                yield Word(key, (value,), text, self.is_one_of_many, line=f"++{text}")


def _flat(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Each value of nested mappings with its key."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(f"{key}.{name}".lstrip("."), inner)
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
    def params(self) -> list[Word]:
        """The words of an experiment that are swept over."""
        swept = self.sweeper("params") or {}
        if not isinstance(swept, Mapping):
            remedy = 'write params: {OPTION: "VALUE,VALUE"}'
            raise InputError("is no mapping", "hydra.sweeper.params", remedy)
        return parse(f"{key}={value}" for key, value in _flat("", swept))

    @cached_property
    def listed(self) -> dict[Kind, list[Entry]]:
        """What an experiment lists for the sweeper."""
        return {
            kind: [_listed(kind, one) for one in self.sweeper(f"{kind}s")] for kind in KINDS
        }

    @cached_property
    def chosen(self) -> dict[Kind, list[Entry]]:
        """What runs."""
        made: dict[Kind, list[Entry]] = {}
        for kind in KINDS:
            chosen = self._chosen(kind)
            unlabelled = Counter(entry.name for entry in chosen if not entry.label)
            made[kind] = []
            for entry in chosen:
                is_one_of_many = not entry.label and unlabelled[entry.name] > 1
                word = self._word(entry, len(chosen) == 1)
                made[kind].append(replace(entry, is_one_of_many=is_one_of_many, word=word))
        return made

    def _chosen(self, kind: Kind) -> list[Entry]:
        """Those of the last word that names some, of the experiment, or what Hydra chooses."""
        # Read in any case: an experiment with a fault in its list is refused, also where a word replaces the list.
        listed = self.listed[kind]
        words = [word for word in self.typed if word.key == kind]
        if listed and not words:
            return listed
        words = words or [word for word in self.params if word.key == kind]
        if not words:
            return [_entry(kind, self.choice(kind))]
        word = words[-1]
        entries = list[Entry]()
        left_out = list[str]()
        for name in word.values:
            if not isinstance(name, (str, int, float)):
                remedy = f"-m {kind}=a,b runs several; write {kind}.OPTION=VALUE for an option"
                raise InputError("one name at a time", word.text, remedy)
            entry = self._named(kind, str(name))
            named(kind, entry.name)
            lacks = self._lack(kind, entry.name) if word.is_glob else ""
            if lacks:
                left_out.append(f"{name} ({lacks})")
            else:
                entries.append(entry)
        if left_out:
            say(f"{word.text} leaves out what lacks something: {', '.join(left_out)}")
        if not entries:
            raise InputError("all that fit lack something", word.text, f"name one: {kind}=NAME")
        return entries

    def _named(self, kind: Kind, name: str) -> Entry:
        """Of this name; a folder with the name of a dataset is meant where nothing else names the data."""
        has_root = any(word.key.endswith(".root") for word in self.typed)
        lacks_root = not has_root and "root" in _required(kind, name)
        is_folder = kind == "dataset" and lacks_root and Path(name).is_dir()
        return _entry(kind, f"./{name}" if is_folder else name)

    def _word(self, entry: Entry, is_alone: bool) -> str:
        """What the user types before its options: as in this command, or as they could be typed there."""
        heads = [word.head for word in self.typed if word.head != word.key]
        meant = [head for head in heads if head in (entry.kind, *entry.names)]
        typed = meant[-1] if meant else ""
        if typed or (is_alone and not entry.label):
            return typed or entry.kind
        is_word = entry.label.replace("-", "_").isidentifier()
        return entry.label if is_word else entry.name

    def _lack(self, kind: Kind, name: str) -> str:
        """What a plugin or preset lacks: options that no word gives, or packages; empty for nothing."""
        given = {word.key for word in self.typed}
        options = [
            f"{name}.{option}"
            for option in _required(kind, name)
            if not given & {f"{kind}.{option}", f"{name}.{option}"}
        ]
        lacking = absent(*named(kind, name).requires)
        return ", ".join(options) or (lacking.install if lacking else "")

    # -- options of them ---------------------------------------------------------------------------------------

    def kind_of(self, word: Word) -> Kind | None:
        """Return whose option a word sets, None for a word for the whole run. InputError for one that is neither."""
        meant = [entry for of in self.chosen.values() for entry in of if entry.is_meant(word)]
        kinds = dict.fromkeys(entry.kind for entry in meant if entry.has(word))
        if len(kinds) > 1:
            either = " or ".join(f"{kind}.{word.option}=" for kind in kinds)
            fault = f"'{word.head}' is a dataset and a method here"
            raise InputError(fault, word.text, f"write {either}")
        if kinds:
            return next(iter(kinds))
        if meant:
            raise self._no_option(word, meant[0].kind)
        if word.head not in _OF_RUN:
            raise self._unknown(word)
        return None

    def is_replaced(self, word: Word) -> bool:
        """Whether typed words replace the datasets or methods that have an option of the experiment."""
        typed = {one.key for one in self.typed}
        for kind, listed in self.listed.items():
            is_meant = word.head == kind or any(entry.is_meant(word) for entry in listed)
            if kind in typed and word.option and is_meant:
                return not any(entry.has(word) for entry in self.chosen[kind])
        return False

    def _no_option(self, word: Word, kind: Kind) -> InputError:
        """The fault of an option that none of its owners has; another of this name is the nearest."""
        owners = [entry.name for entry in self.chosen[kind] if entry.is_meant(word)]
        known = {option for one in owners or [word.head] for option in option_names(kind, one)}
        fault = unknown_name(word.key, word.option, known)
        for other in (*(entry.name for entry in self.chosen[kind]), *plugins.usable(kind)):
            if word.option in option_names(kind, other):
                remedy = f"did you mean '{other}.{word.option}'? {fault.remedy}"
                return InputError(fault.fault, fault.place, remedy)
        return fault

    def _unknown(self, word: Word) -> InputError:
        """The fault of a word that is no option of the run, or of a chosen dataset or method."""
        text, key, head = word.text, word.key, word.head
        for kind, entries in self.chosen.items():
            names = ",".join(dict.fromkeys(entry.name for entry in entries))
            owners = dict.fromkeys(
                entry.name for entry in entries if key in option_names(kind, entry.name)
            )
            if owners:
                before = [kind] if len(entries) == 1 else [*owners]
                either = " or ".join(f"{owner}.{text}" for owner in before)
                return InputError(f"is an option of a {kind}", text, f"write {either}")
            if word.option in option_names(kind, head):
                remedy = f"add it: -m {kind}={names},{head}"
                return InputError(f"'{head}' is not among the {kind}s", text, remedy)
            if word.option and any(head == entry.label for entry in self.listed[kind]):
                remedy = f"leave out {kind}={names} or {key}"
                return InputError(
                    f"'{head}' is not among the {kind}s of this run", text, remedy
                )
        for kind in reversed(KINDS):
            if word.option and plugin_of(kind, head):
                return self._no_option(word, kind)
        if word.option and plugin_of("metric", head):
            return InputError("is an option of a metric", text, f"write metrics.{text}")
        owned = {name for of in self.chosen.values() for entry in of for name in entry.names}
        return unknown_name(key, head, {*_OF_RUN, *owned})


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


def _required(kind: Kind, name: str) -> list[str]:
    """The options that must be given for a plugin or preset of this name."""
    plugin = plugin_of(kind, name)
    preset = preset_of(kind, name) or {}
    options = options_of(plugin.cls) if plugin else ()
    return [o.name for o in options if o.is_required and o.name not in preset]


def _entry(kind: Kind, name: str) -> Entry:
    """A dataset or method of this name; a folder is the dataset that recognises it."""
    if kind == "dataset" and is_path(name):
        return Entry(kind, recognised(Path(name)), {"root": str(Path(name))})
    return Entry(kind, name)
