"""From words and a line-up to the settings of each job.

Every dataset meets every method. A word that begins with the name or label of one of them, `sucre.physical=true`, is
for it alone. A word for methods or datasets in general, `method.physical=true`, is for those that have the option.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import Any, get_args

from sucre_bench import plugins
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.jobs.catalogue import default_choice, option_names, plugin_of
from sucre_bench.jobs.lineup import KINDS, Entry, Kind, LineUp, Word
from sucre_bench.jobs.mistakes import check_names, not_an_override, unknown_word
from sucre_bench.jobs.recognise_dataset import is_path, recognised
from sucre_bench.plugins.options import options_of


def parse(texts: Iterable[str]) -> list[Word]:
    """Read overrides. Raises InputError for one that Hydra's grammar does not have, with how to write it."""
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    parser, words = OverridesParser.create(), []
    for text in texts:
        try:
            override = parser.parse_override(text)
            values = [override]
            if override.is_sweep_override():
                if not override.is_discrete_sweep():
                    raise InputError("no list of values", text, "list them, or write range(start,stop,step)")
                values = [
                    parser.parse_override(f"{override.key_or_group}={v}") for v in override.sweep_string_iterator()
                ]
        except HydraException as fault:
            raise not_an_override(text, fault) from fault
        if override.is_delete():
            raise InputError("cannot be left out", text, "give it another value")
        key, given = override.get_key_element().lstrip("+"), [one.value() for one in values]
        if any(isinstance(value, (bool, int, float)) for value in given) and _is_text(key):
            given = _as_typed(given, text.partition("=")[2].split(","))
        words.append(Word(key, tuple(given), text, override.is_sweep_override(), override.is_add()))
    return words


def _is_text(key: str) -> bool:
    """Whether an option is a name or a path."""
    owner, _, name = key.rpartition(".")
    if not owner:
        return name in ("out", "baseline")
    known = [plugin for kind in KINDS for plugin in plugins.usable(kind).values()]
    return name == "label" or name in {
        o.name for p in known for o in options_of(p.cls) if Path in (o.type, *get_args(o.type))
    }


def _as_typed(values: Sequence[Any], typed: Sequence[str]) -> list[Any]:
    """Values with numbers and truth values as they were typed: Hydra makes 20261122 of 2026_11_22."""
    if len(values) != len(typed):  # of a range
        return [str(value) for value in values]
    return [text if isinstance(value, (bool, int, float)) else value for value, text in zip(values, typed, strict=True)]


@dataclass(frozen=True)
class Combination:
    """One job.

    dataset, method: names; values: by the key that Hydra knows, each with whether it may be new; swept: the keys that
    its labels name; typed: how the user typed a key that Hydra or a plugin knows by another name; method_word: what
    stands before an option of this method alone, "sucre" say.
    """

    dataset: str
    method: str
    values: Mapping[str, tuple[Any, bool]]
    swept: tuple[str, ...]
    typed: Mapping[str, str]
    method_word: str


@dataclass(frozen=True)
class _Option:
    """A word for some datasets or methods. owner: their name or label; empty for all that have the option."""

    kind: Kind
    owner: str
    name: str
    word: Word

    def is_for(self, entry: Entry) -> bool:
        if self.owner not in ("", entry.name, entry.label):
            return False
        known = option_names(self.kind, entry.name)
        return self.word.is_added or not known or self.name.partition(".")[0] in known


def combinations(typed: Sequence[Word], line_up: LineUp) -> list[Combination]:
    """Return what the words and the line-up ask for, a job each. A word prevails over the line-up.

    Raises InputError for a name that no dataset or method has, and for an option that none of them has.
    """
    entries = {kind: _entries(kind, typed, line_up) for kind in KINDS}
    keys = {word.key for word in typed}
    replaced = keys & set(KINDS)
    words = [
        word
        for word in line_up.words()
        if not ("metrics" in keys and word.head == "metrics") and not _is_of_replaced(word, replaced, entries, line_up)
    ]
    words += [word for word in typed if word.key not in KINDS]
    options = [(word, _option(word, entries, line_up)) for word in words]
    for _, option in options:
        if option and not any(map(option.is_for, entries[option.kind])):
            named = [entry for entry in entries[option.kind] if option.owner in ("", entry.name, entry.label)]
            known = {name for entry in named for name in option_names(option.kind, entry.name)}
            raise unknown_name(option.word.key, option.name, known)
    return [
        combination
        for dataset, method in itertools.product(entries["dataset"], entries["method"])
        for combination in _of_pair({"dataset": dataset, "method": method}, options, entries)
    ]


def _of_pair(
    pair: Mapping[Kind, Entry],
    words: Sequence[tuple[Word, _Option | None]],
    entries: Mapping[Kind, Sequence[Entry]],
) -> Iterator[Combination]:
    """The combinations of the words' values, for one dataset and one method."""
    chosen: dict[str, tuple[Word, tuple[Any, ...]]] = {}
    swept: list[str] = []
    typed: dict[str, str] = {}
    for kind, entry in pair.items():
        chosen |= {word.key: (word, word.values) for word in entry.words(kind)}
        names = Counter(one.name for one in entries[kind] if not one.label)
        if not entry.label and names[entry.name] > 1:  # its label names the options that tell it from the others
            swept += [f"{kind}.{option}" for option in entry.options if option != "degrade"]
    for word, option in words:
        key = word.key
        if option:
            if not option.is_for(pair[option.kind]):
                continue
            key = f"{option.kind}.{option.name}"
            plugin = plugin_of(option.kind, pair[option.kind].name)
            typed |= {key: word.key} | ({f"{plugin.name}.{option.name}": word.key} if plugin else {})
        chosen.pop(key, None)  # the last word counts, in its place
        chosen[key] = word, word.values
        if word.is_swept:
            swept.append(key)
    method = pair["method"]
    own_word = method.label if method.label.replace("-", "_").isidentifier() else method.name
    for values in itertools.product(*(values for _, values in chosen.values())):
        yield Combination(
            pair["dataset"].name,
            method.name,
            {key: (value, chosen[key][0].is_added) for key, value in zip(chosen, values, strict=True)},
            tuple(swept),
            typed,
            own_word,
        )


def _entries(kind: Kind, typed: Sequence[Word], line_up: LineUp) -> tuple[Entry, ...]:
    """The datasets or methods: those of the last word that names some, of the line-up, or the default."""
    words = [word for word in typed if word.key == kind]
    if not words:
        return line_up.entries(kind) or (Entry(default_choice(kind)),)
    entries = []
    for name in words[-1].values:
        folder = Path(name) if kind == "dataset" and isinstance(name, str) else None
        if folder and not is_path(str(name)):
            check_names(kind, name)
            folder = folder if _lacks_root(str(name), typed) and folder.is_dir() else None
        elif not folder:
            check_names(kind, name)
        entries.append(Entry(recognised(folder), {"root": str(folder)}) if folder else Entry(str(name)))
    return tuple(entries)


def _lacks_root(dataset: str, typed: Sequence[Word]) -> bool:
    """Whether a dataset needs a folder that the words do not name: the folder of the same name may be meant."""
    plugin = plugin_of("dataset", dataset)
    needs_root = plugin is not None and any(o.name == "root" and o.default is MISSING for o in options_of(plugin.cls))
    return needs_root and not any(word.key.endswith(".root") for word in typed)


def _option(word: Word, entries: Mapping[Kind, Sequence[Entry]], line_up: LineUp) -> _Option | None:
    """The option that a word is, None for a word for the whole run. InputError for a word that is neither."""
    head, dot, rest = word.key.partition(".")
    for kind in KINDS:
        if head == kind and dot:
            return _Option(kind, "", rest, word)
    owned = [_Option(kind, head, rest, word) for kind in KINDS if dot and _has_name(entries[kind], head)]
    fitting = [option for option in owned if any(map(option.is_for, entries[option.kind]))]
    if len(fitting) > 1:
        either = " or ".join(f"{option.kind}.{option.name}=" for option in fitting)
        raise InputError(f"'{head}' is a dataset and a method here", word.text, f"write {either}")
    if owned:
        return (fitting or owned)[0]
    if fault := unknown_word(word, entries, line_up):
        raise fault
    return None


def _is_of_replaced(
    word: Word, replaced: Collection[str], entries: Mapping[Kind, Sequence[Entry]], line_up: LineUp
) -> bool:
    """Whether a line-up's word is an option of its datasets or methods alone, and the command's words replace those."""
    head, dot, rest = word.key.partition(".")
    for kind in KINDS:
        if dot and kind in replaced and (head == kind or _has_name(line_up.entries(kind), head)):
            option = _Option(kind, "" if head == kind else head, rest, word)
            return not any(map(option.is_for, entries[kind]))
    return False


def _has_name(entries: Sequence[Entry], name: str) -> bool:
    return any(name in (entry.name, entry.label) for entry in entries)
