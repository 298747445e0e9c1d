"""The datasets and methods that the words of a command choose, and which word is an option of which of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.jobs.asked import KINDS, Asked, Kind
from sucre_bench.jobs.catalogue import (
    is_path,
    named,
    option_names,
    plugin_of,
    preset_of,
    recognised,
)
from sucre_bench.jobs.run_options import RunConfig
from sucre_bench.jobs.words import Word, parse
from sucre_bench.machine.progress import say
from sucre_bench.machine.provenance import absent
from sucre_bench.plugins.options import options_of

_OF_RUN = frozenset(option.name for option in options_of(RunConfig))


@dataclass(frozen=True)
class Entry:
    """A dataset or method with options of its own."""

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

    def words(self, kind: Kind) -> Iterator[Word]:
        """Yield its options as settings of a configuration."""
        for name, value in self.options.items():
            if name == "degrade":
                yield from (Word.written(key, inner) for key, inner in _flat(name, value))
            else:
                word = Word.written(f"{kind}.{name}", value)
                yield replace(word, is_swept=self.is_one_of_many)


def _flat(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Each value of nested mappings with its key."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(f"{key}.{name}".lstrip("."), inner)
    else:
        yield key, value


@dataclass(frozen=True)
class Option:
    """What a word sets."""

    kind: Kind

    owner: str
    """Name or label of the datasets or methods; empty for all that have the option."""

    name: str

    def is_for(self, entry: Entry) -> bool:
        """Whether a dataset or method has the option, and the word means it."""
        is_meant = self.owner in ("", *entry.names)
        return is_meant and self.name.partition(".")[0] in option_names(self.kind, entry.name)


class Entries:
    """The datasets and methods of a command.

    params: the words of an experiment that are swept over; listed: what an experiment lists for the sweeper; chosen:
    what runs. Raises InputError for a name that there is not, and for a list that cannot be read.
    """

    def __init__(self, asked: Asked) -> None:
        self._asked = asked
        swept = asked.sweeper("params") or {}
        if not isinstance(swept, Mapping):
            remedy = 'write params: {OPTION: "VALUE,VALUE"}'
            raise InputError("is no mapping", "hydra.sweeper.params", remedy)
        self.params = parse(f"{key}={value}" for key, value in _flat("", swept))
        self.listed: dict[Kind, tuple[Entry, ...]] = {kind: self._listed(kind) for kind in KINDS}
        self.chosen: dict[Kind, tuple[Entry, ...]] = {}
        for kind in KINDS:
            chosen = self._chosen(kind)
            unlabelled = Counter(entry.name for entry in chosen if not entry.label)
            made = []
            for entry in chosen:
                is_one_of_many = not entry.label and unlabelled[entry.name] > 1
                word = self._word(kind, entry, len(chosen) == 1)
                made.append(replace(entry, is_one_of_many=is_one_of_many, word=word))
            self.chosen[kind] = tuple(made)

    def _listed(self, kind: Kind) -> tuple[Entry, ...]:
        """The datasets or methods that an experiment lists for the sweeper."""
        asked, entries = self._asked, list[Entry]()
        for given in asked.sweeper(f"{kind}s"):
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
            entries.append(Entry(entry.name, {**entry.options, **own}))
        return tuple(entries)

    def _chosen(self, kind: Kind) -> tuple[Entry, ...]:
        """Those of the last word that names some, of the experiment, or what Hydra chooses."""
        asked = self._asked
        words = [word for word in asked.typed if word.key == kind]
        if not words and self.listed[kind]:
            return self.listed[kind]
        words = words or [word for word in self.params if word.key == kind]
        if not words:
            return (_entry(kind, asked.choice(kind)),)
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
        return tuple(entries)

    def _named(self, kind: Kind, name: str) -> Entry:
        """Of this name; a folder with the name of a dataset is meant where nothing else names the data."""
        has_root = any(word.key.endswith(".root") for word in self._asked.typed)
        lacks_root = not has_root and "root" in _required(kind, name)
        is_folder = kind == "dataset" and lacks_root and Path(name).is_dir()
        return _entry(kind, f"./{name}" if is_folder else name)

    def _word(self, kind: Kind, entry: Entry, is_alone: bool) -> str:
        """What the user types before its options: as in this command, or as they could be typed there."""
        heads = [word.head for word in self._asked.typed if word.head != word.key]
        meant = [head for head in heads if head in (kind, *entry.names)]
        typed = meant[-1] if meant else ""
        if typed or (is_alone and not entry.label):
            return typed or kind
        is_word = entry.label.replace("-", "_").isidentifier()
        return entry.label if is_word else entry.name

    def _lack(self, kind: Kind, name: str) -> str:
        """What a plugin or preset lacks: options that no word gives, or packages; empty for nothing."""
        given = {word.key for word in self._asked.typed}
        options = [
            f"{name}.{option}"
            for option in _required(kind, name)
            if not given & {f"{kind}.{option}", f"{name}.{option}"}
        ]
        lacking = absent(*named(kind, name).requires)
        return ", ".join(options) or (lacking.install if lacking else "")

    # -- options of them ---------------------------------------------------------------------------------------

    def option_of(self, word: Word) -> Option | None:
        """Return what a word sets of them, None for a word for the whole run. InputError for one that is neither."""
        meant = _meant(word, self.chosen)
        fitting = [one for one in meant if any(map(one.is_for, self.chosen[one.kind]))]
        if len(fitting) > 1:
            either = " or ".join(f"{option.kind}.{option.name}=" for option in fitting)
            fault = f"'{word.head}' is a dataset and a method here"
            raise InputError(fault, word.text, f"write {either}")
        if fitting:
            return fitting[0]
        if meant:
            raise self._no_option(word, meant[0])
        if word.head not in _OF_RUN:
            raise self._unknown(word)
        return None

    def is_replaced(self, word: Word) -> bool:
        """Whether typed words replace the datasets or methods that have an option of the experiment."""
        typed = {one.key for one in self._asked.typed}
        meant = [option for option in _meant(word, self.listed) if option.kind in typed]
        return bool(meant) and not any(map(meant[0].is_for, self.chosen[meant[0].kind]))

    def _no_option(self, word: Word, option: Option) -> InputError:
        """The fault of an option that none of its owners has; another of this name is the nearest."""
        kind, name = option.kind, option.name
        chosen = [entry.name for entry in self.chosen[kind]]
        owners = [one.name for one in self.chosen[kind] if option.owner in ("", *one.names)]
        known = {known for one in owners or [option.owner] for known in option_names(kind, one)}
        fault = unknown_name(word.key, name, known)
        for other in (*chosen, *plugins.usable(kind)):
            if name in option_names(kind, other):
                remedy = f"did you mean '{other}.{name}'? {fault.remedy}"
                return InputError(fault.fault, fault.place, remedy)
        return fault

    def _unknown(self, word: Word) -> InputError:
        """The fault of a word that is no option of the run, or of a chosen dataset or method."""
        text, key = word.text, word.key
        head, dot, rest = key.partition(".")
        for kind, entries in self.chosen.items():
            names = ",".join(dict.fromkeys(entry.name for entry in entries))
            owners = dict.fromkeys(
                entry.name for entry in entries if key in option_names(kind, entry.name)
            )
            if owners:
                before = [kind] if len(entries) == 1 else [*owners]
                either = " or ".join(f"{owner}.{text}" for owner in before)
                return InputError(f"is an option of a {kind}", text, f"write {either}")
            if dot and rest in option_names(kind, head):
                remedy = f"add it: -m {kind}={names},{head}"
                return InputError(f"'{head}' is not among the {kind}s", text, remedy)
            if dot and any(head == entry.label for entry in self.listed[kind]):
                remedy = f"leave out {kind}={names} or {key}"
                return InputError(f"'{head}' is not among the {kind}s of this run", text, remedy)
        for kind in reversed(KINDS):
            if dot and plugin_of(kind, head):
                return self._no_option(word, Option(kind, head, rest))
        if dot and plugin_of("metric", head):
            return InputError("is an option of a metric", text, f"write metrics.{text}")
        owned = {name for of in self.chosen.values() for entry in of for name in entry.names}
        return unknown_name(key, head, {*_OF_RUN, *owned})


def _required(kind: Kind, name: str) -> list[str]:
    """The options that must be given for a plugin or preset of this name."""
    plugin, preset = plugin_of(kind, name), preset_of(kind, name) or {}
    options = options_of(plugin.cls) if plugin else ()
    return [o.name for o in options if o.is_required and o.name not in preset]


def _entry(kind: Kind, name: str) -> Entry:
    """A dataset or method of this name; a folder is the dataset that recognises it."""
    if kind == "dataset" and is_path(name):
        return Entry(recognised(Path(name)), {"root": str(Path(name))})
    return Entry(name)


def _meant(word: Word, entries: Mapping[Kind, Sequence[Entry]]) -> list[Option]:
    """What a word may set: of all datasets or methods, or of those that its first part names."""
    head, dot, rest = word.key.partition(".")
    return [
        Option(kind, "" if head == kind else head, rest)
        for kind in KINDS
        if dot and (head == kind or any(head in entry.names for entry in entries[kind]))
    ]
