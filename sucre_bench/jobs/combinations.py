"""From words and a line-up to one list of overrides for each job.

Every dataset meets every method. A word that begins with the name or label of one of them, `sucre.physical=true`, is
for it alone. A word for methods or datasets in general, `method.physical=true`, is for those that have the option.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sucre_bench.errors import InputError, unknown_name
from sucre_bench.jobs.explain_mistakes import check_names, not_an_override, unknown_word
from sucre_bench.jobs.lineup import KINDS, Entry, Kind, LineUp
from sucre_bench.jobs.metric_words import words_for_hydra
from sucre_bench.jobs.presets import default_choice, option_names, plugin_of
from sucre_bench.jobs.quoting import value_of
from sucre_bench.jobs.recognise_dataset import is_path, recognised
from sucre_bench.plugins.options import options_of

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override


def parse(texts: Iterable[str]) -> list[Override]:
    """Read overrides. Raises InputError for one that Hydra's grammar does not have, with how to write it."""
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    parser, parsed = OverridesParser.create(), []
    for text in texts:
        try:
            parsed.append(parser.parse_override(text))
        except HydraException as fault:
            raise not_an_override(text, fault) from fault
    return parsed


@dataclass(frozen=True)
class Combination:
    """One job.

    overrides: as Hydra takes them; swept: the keys that its labels name; typed: how the user typed a key that Hydra
    or a plugin knows by another name; method_word: what stands before an option of this method alone, "sucre" say.
    """

    overrides: tuple[str, ...]
    swept: tuple[str, ...]
    typed: Mapping[str, str]
    method_word: str


@dataclass(frozen=True)
class _Option:
    """A word for some datasets or methods. owner: their name or label; empty for all that have the option."""

    kind: Kind
    owner: str
    name: str
    override: Override

    def is_for(self, entry: Entry) -> bool:
        is_named = not self.owner or self.owner in (entry.name, entry.label)
        return is_named and (self.override.is_add() or self.is_option_of(entry))

    def is_option_of(self, entry: Entry) -> bool:
        known = option_names(self.kind, entry.name)
        return not known or self.name.partition(".")[0] in known

    @property
    def key(self) -> str:
        """The key that Hydra knows."""
        return f"{self.kind}.{self.name}"

    def texts(self) -> list[str]:
        """Its overrides, of which a job has one."""
        typed = self.override.key_or_group
        return [text.replace(typed, self.key, 1) for text in _texts(self.override)]


def combinations(typed: Sequence[Override], line_up: LineUp) -> list[Combination]:
    """Return what the words and the line-up ask for, a job each. A word prevails over the line-up.

    Raises InputError for a name that no dataset or method has, and for an option that none of them has.
    """
    entries = {kind: _entries(kind, typed, line_up) for kind in KINDS}
    metrics_typed = any(word.key_or_group == "metrics" for word in typed)
    replaced = {word.key_or_group for word in typed if word.key_or_group in KINDS}
    said = [
        word
        for word in parse(line_up.words())
        if not (metrics_typed and _head(word) == "metrics") and not _is_of_replaced(word, replaced, entries, line_up)
    ]
    words = [*said, *(word for word in typed if word.key_or_group not in KINDS)]
    options = {id(word): option for word in words if (option := _option(word, entries, line_up))}
    for option in options.values():
        _check_someone_has(option, entries[option.kind])
    return [
        combination
        for dataset, method in itertools.product(entries["dataset"], entries["method"])
        for combination in _of_pair({"dataset": dataset, "method": method}, words, options, entries)
    ]


def _of_pair(
    pair: Mapping[Kind, Entry],
    words: Sequence[Override],
    options: Mapping[int, _Option],
    entries: Mapping[Kind, Sequence[Entry]],
) -> Iterator[Combination]:
    """The combinations of the other words' values, for one dataset and one method."""
    texts: dict[str, list[str]] = {}
    swept = [key for kind, entry in pair.items() for key in _telling_apart(kind, entry, entries[kind])]
    typed: dict[str, str] = {}
    for kind, entry in pair.items():
        texts |= {text.partition("=")[0]: [text] for text in [f"{kind}={value_of(entry.name)}", *entry.words(kind)]}
    for word in words:
        option = options.get(id(word))
        if option and not option.is_for(pair[option.kind]):
            continue
        values = option.texts() if option else _texts(word)
        key = values[0].partition("=")[0]
        texts.pop(key, None)  # the last word counts, in its place
        texts[key] = values
        if option:
            plugin = plugin_of(option.kind, pair[option.kind].name)
            names = {key, *([f"{plugin.name}.{option.name}"] if plugin else [])}
            typed |= dict.fromkeys(names, word.key_or_group)
        if word.is_sweep_override():
            swept.append(option.key if option else word.key_or_group)
    for chosen in itertools.product(*texts.values()):
        yield Combination(tuple(_with_variants(chosen)), tuple(swept), typed, _method_word(entries["method"], pair))


def _method_word(methods: Sequence[Entry], pair: Mapping[Kind, Entry]) -> str:
    """The label or name of a pair's method where there are several, else "method"."""
    method = pair["method"]
    is_word = method.label.replace("-", "_").isidentifier()
    return "method" if len(methods) == 1 else method.label if is_word else method.name


def _entries(kind: Kind, typed: Sequence[Override], line_up: LineUp) -> tuple[Entry, ...]:
    words = [word for word in typed if word.key_or_group == kind]
    if not words:
        return line_up.entries(kind) or (Entry(default_choice(kind)),)
    word = words[-1]
    values = [text.partition("=")[2] for text in _texts(word)]
    entries = []
    for value in values:
        (one,) = parse([f"{kind}={value}"])
        name = one.value()
        if kind == "dataset" and isinstance(name, str) and is_path(name):
            entries.append(recognised(Path(name)))
        else:
            check_names(kind, name)
            folder = Path(str(name))
            is_folder = kind == "dataset" and _lacks_root(str(name), typed) and folder.is_dir()
            entries.append(recognised(folder) if is_folder else Entry(str(name)))
    return tuple(entries)


def _lacks_root(dataset: str, typed: Sequence[Override]) -> bool:
    """Whether a dataset needs a folder that the words do not name: the folder of the same name may be meant."""
    plugin = plugin_of("dataset", dataset)
    needs_root = plugin is not None and any(o.name == "root" and o.default is MISSING for o in options_of(plugin.cls))
    return needs_root and not any(word.key_or_group.endswith(".root") for word in typed)


def _telling_apart(kind: Kind, entry: Entry, all_: Sequence[Entry]) -> Iterator[str]:
    """The keys that the label of an entry names: its options, where others of its name have no label either."""
    names = Counter(one.name for one in all_ if not one.label)
    if not entry.label and names[entry.name] > 1:
        yield from (f"{kind}.{option}" for option in entry.options if option != "degrade")


def _option(word: Override, entries: Mapping[Kind, Sequence[Entry]], line_up: LineUp) -> _Option | None:
    """The option that a word is, None for a word for the whole run. InputError for a word that is neither."""
    head, dot, rest = word.key_or_group.partition(".")
    for kind in KINDS:
        if head == kind and dot:
            return _Option(kind, "", rest, word)
    owned = [_Option(kind, head, rest, word) for kind in KINDS if dot and _has_name(entries[kind], head)]
    fitting = [option for option in owned if any(map(option.is_for, entries[option.kind]))]
    if len(fitting) > 1:
        either = " or ".join(f"{option.key}=" for option in fitting)
        raise InputError(f"'{head}' is a dataset and a method here", word.input_line, f"write {either}")
    if owned:
        return (fitting or owned)[0]
    if fault := unknown_word(word, entries, line_up):
        raise fault
    return None


def _is_of_replaced(
    word: Override, replaced: Collection[str], entries: Mapping[Kind, Sequence[Entry]], line_up: LineUp
) -> bool:
    """Whether a line-up's word is an option of its datasets or methods alone, and the command's words replace those."""
    head, dot, rest = word.key_or_group.partition(".")
    for kind in KINDS:
        if dot and kind in replaced and (head == kind or _has_name(line_up.entries(kind), head)):
            option = _Option(kind, "" if head == kind else head, rest, word)
            return not any(map(option.is_for, entries[kind]))
    return False


def _has_name(entries: Sequence[Entry], name: str) -> bool:
    return any(name in (entry.name, entry.label) for entry in entries)


def _check_someone_has(option: _Option, entries: Sequence[Entry]) -> None:
    if not any(map(option.is_for, entries)):
        named = [entry for entry in entries if option.owner in ("", entry.name, entry.label)]
        known = {name for entry in named for name in option_names(option.kind, entry.name)}
        raise unknown_name(option.override.key_or_group, option.name, known)


def _head(word: Override) -> str:
    return word.key_or_group.partition(".")[0]


def _texts(word: Override) -> list[str]:
    """A word's overrides, one a value."""
    if not word.is_sweep_override():
        return [word.input_line or ""]
    if not word.is_discrete_sweep():
        raise InputError("no list of values", word.input_line, "list them, or write range(start,stop,step)")
    return [f"{word.get_key_element()}={value}" for value in word.sweep_string_iterator()]


def _with_variants(texts: Sequence[str]) -> Iterator[str]:
    """The overrides with `metrics=[name:variant]` as Hydra takes it."""
    for text in texts:
        if text.startswith("metrics=") and ":" in text:
            names = parse([text])[0].value()
            yield from words_for_hydra([str(name) for name in names] if isinstance(names, list) else [str(names)])
        else:
            yield text
