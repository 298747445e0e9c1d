"""The datasets and methods that the words of a command choose, and which word is an option of which of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field
from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.jobs import configs
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
from sucre_bench.jobs.words import Word
from sucre_bench.machine.progress import say
from sucre_bench.machine.provenance import absent
from sucre_bench.plugins.options import options_of

_OF_RUN = frozenset(option.name for option in options_of(RunConfig))


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
            yield from (
                _flat("degrade", value)
                if name == "degrade"
                else [Word.written(f"{group}.{name}", value)]
            )


def _flat(key: str, value: Any) -> Iterator[Word]:
    """The settings of a value: those of a mapping one by one."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(f"{key}.{name}", inner)
    else:
        yield Word.written(key, value)


def entries_of(kind: Kind, asked: Asked, params: Sequence[Word] = ()) -> tuple[Entry, ...]:
    """The datasets or methods: those of the last word that names some, of the experiment, or what Hydra chooses."""
    words = [word for word in asked.typed if word.key == kind]
    if not words and (listed := listed_entries(kind, asked)):
        return listed
    words = words or [word for word in params if word.key == kind]
    if not words:
        return (_entry(kind, asked.choice(kind)),)
    entries = []
    left_out = []
    for name in words[-1].values:
        if not isinstance(name, (str, int, float)):
            remedy = f"-m {kind}=a,b runs several; write {kind}.OPTION=VALUE for an option"
            raise InputError("one name at a time", words[-1].text, remedy)
        name = str(name)
        plugin = plugin_of(kind, name)
        needs_root = (
            any(o.name == "root" and o.default is MISSING for o in options_of(plugin.cls))
            if plugin
            else False
        )
        # A folder with the name of a dataset is meant where nothing else names the data.
        lacks_root = needs_root and not any(word.key.endswith(".root") for word in asked.typed)
        if kind == "dataset" and lacks_root and Path(name).is_dir():
            name = f"./{name}"
        entry = _entry(kind, name)
        named(kind, entry.name)
        if words[-1].is_glob and (lack := _lack(kind, name, asked)):
            left_out.append(f"{name} ({lack})")
        else:
            entries.append(entry)
    if left_out:
        say(f"{words[-1].text} leaves out what lacks something: {', '.join(left_out)}")
    if not entries:
        raise InputError("all that fit lack something", words[-1].text, f"name one: {kind}=NAME")
    return tuple(entries)


def _lack(kind: Kind, name: str, asked: Asked) -> str:
    """What a plugin or preset needs and does not have: options that no word gives, or packages; empty for nothing."""
    plugin = named(kind, name)
    given = {word.key for word in asked.typed}
    options = [
        option.name
        for option in options_of(plugin.cls)
        if option.default is MISSING
        and option.name not in (preset_of(kind, name) or {})
        and not given & {f"{kind}.{option.name}", f"{name}.{option.name}"}
    ]
    if options:
        return ", ".join(f"{name}.{option}" for option in options)
    lacking = absent(*plugin.requires)
    return lacking.install if lacking else ""


def listed_entries(kind: Kind, asked: Asked) -> tuple[Entry, ...]:
    """The datasets or methods that an experiment lists for the sweeper."""
    entries = []
    for given in asked.sweeper(f"{kind}s"):
        options = {kind: given} if isinstance(given, str) else given
        if not (isinstance(options, Mapping) and isinstance(options.get(kind), str)):
            place = f"hydra.sweeper.{kind}s"
            raise InputError(
                f"{given!r} has no name", place, f"write NAME, or {{{kind}: NAME, OPTION: VALUE}}"
            )
        entry = _entry(kind, options[kind])
        own = {str(name): value for name, value in options.items() if name != kind}
        plugin = named(kind, entry.name)
        for option in own:
            if option not in (
                known := [
                    *option_names(kind, entry.name),
                    *(["degrade"] if kind == "dataset" else []),
                ]
            ):
                raise unknown_name(f"{entry.name}.{option}", option, known)
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


# -- options of them -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Option:
    """What a word sets. owner: name or label of the datasets or methods; empty for all that have the option."""

    kind: Kind
    owner: str
    name: str

    def is_for(self, entry: Entry) -> bool:
        """Whether a dataset or method has the option, and the word means it."""
        is_meant = self.owner in ("", entry.name, entry.label)
        return is_meant and self.name.partition(".")[0] in option_names(self.kind, entry.name)


def option_of(word: Word, entries: Mapping[Kind, Sequence[Entry]], asked: Asked) -> Option | None:
    """The option that a word is, None for a word for the whole run. InputError for a word that is neither."""
    meant = _meant(word, entries)
    fitting = [option for option in meant if any(map(option.is_for, entries[option.kind]))]
    if len(fitting) > 1:
        either = " or ".join(f"{option.kind}.{option.name}=" for option in fitting)
        raise InputError(
            f"'{word.head}' is a dataset and a method here", word.text, f"write {either}"
        )
    if fitting:
        return fitting[0]
    for option in meant:
        owners = [
            entry.name
            for entry in entries[option.kind]
            if option.owner in ("", entry.name, entry.label)
        ]
        raise _no_option(word, option, owners, entries)
    if word.head not in _OF_RUN:
        raise unknown_word(word, entries, asked)
    return None


def _no_option(
    word: Word, option: Option, owners: Sequence[str], entries: Mapping[Kind, Sequence[Entry]]
) -> InputError:
    """Return the fault of an option that none of its owners has; another of this name is the nearest."""
    kind, name = option.kind, option.name
    names = [*(entry.name for entry in entries[kind]), *plugins.usable(kind)]
    others = [other for other in names if name in option_names(kind, other)]
    known = {name for owner in owners for name in option_names(kind, owner)}
    fault = unknown_name(word.key, name, known)
    if others:
        remedy = f"did you mean '{others[0]}.{name}'? {fault.remedy}"
        fault = InputError(fault.fault, fault.place, remedy)
    return fault


def _meant(word: Word, entries: Mapping[Kind, Sequence[Entry]]) -> list[Option]:
    """The options that a word may be: of all datasets or methods, or of those that its first part names."""
    head, dot, rest = word.key.partition(".")
    if dot and head in KINDS:
        return [Option("dataset" if head == "dataset" else "method", "", rest)]
    named_so = {
        kind: any(head in (entry.name, entry.label) for entry in entries[kind]) for kind in KINDS
    }
    return [Option(kind, head, rest) for kind in KINDS if dot and named_so[kind]]


def is_replaced(
    word: Word,
    keys: set[str],
    entries: Mapping[Kind, Sequence[Entry]],
    listed: Mapping[Kind, Sequence[Entry]],
) -> bool:
    """Whether typed words replace what an experiment sweeps over: the datasets or methods that have the option."""
    meant = [option for option in _meant(word, listed) if option.kind in keys]
    return bool(meant) and not any(map(meant[0].is_for, entries[meant[0].kind]))


def unknown_word(word: Word, chosen: Mapping[Kind, Sequence[Entry]], asked: Asked) -> InputError:
    """Return the fault of a word that is no option of the run, or of a chosen dataset or method.

    asked: words may have replaced the datasets or methods of its experiment.
    """
    text, key = word.text, word.key
    head, dot, rest = key.partition(".")
    for kind, entries in chosen.items():
        names = ",".join(dict.fromkeys(entry.name for entry in entries))
        owners = dict.fromkeys(
            entry.name for entry in entries if key in option_names(kind, entry.name)
        )
        if owners:
            before = [kind] if len(entries) == 1 else [*owners]
            return InputError(
                f"is an option of a {kind}",
                text,
                f"write {' or '.join(f'{b}.{text}' for b in before)}",
            )
        if dot and rest in option_names(kind, head):
            return InputError(
                f"'{head}' is not among the {kind}s", text, f"add it: -m {kind}={names},{head}"
            )
        if dot and head in {entry.label for entry in listed_entries(kind, asked)}:
            remedy = f"leave out {kind}={names} or {key}"
            return InputError(f"'{head}' is not among the {kind}s of this run", text, remedy)
    for kind in reversed(KINDS):
        if dot and plugin_of(kind, head):
            return _no_option(word, Option(kind, head, rest), [head], chosen)
    if dot and plugin_of("metric", head):
        return InputError("is an option of a metric", text, f"write metrics.{text}")
    owned = {
        name
        for entries in chosen.values()
        for entry in entries
        for name in (entry.name, entry.label)
        if name
    }
    return unknown_name(key, head, {*_OF_RUN, *owned})
