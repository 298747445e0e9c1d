"""Explains mistakes in a command's words, with the words that were probably meant."""

from __future__ import annotations

import difflib
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from sucre_bench import plugins
from sucre_bench.errors import InputError, SucreBenchError, UnknownPluginError, did_you_mean, unknown_name
from sucre_bench.jobs.catalogue import default_choice, option_names, plugin_of, presets
from sucre_bench.jobs.hydra_schema import GROUPS
from sucre_bench.jobs.lineup import Entry, Kind, LineUp, Word
from sucre_bench.jobs.run_options import RunConfig
from sucre_bench.jobs.words import quoted
from sucre_bench.machine.files import expanded
from sucre_bench.plugins.options import options_of
from sucre_bench.plugins.plugin import Broken

if TYPE_CHECKING:
    from omegaconf import DictConfig

# The types that OmegaConf names in a refusal, in the words of the field.
_TYPES = {"Integer": "a whole number", "Float": "a number", "valid bool": "true or false"}


# -- words that do not say what to do ------------------------------------------------------------------------


def is_bare(word: str) -> bool:
    """Whether a word has no key: neither key=value nor ~key."""
    return "=" not in word and not word.startswith("~")


def refuse_bare_words(words: Sequence[str]) -> None:
    """Raise InputError for words that are no key=value, with the command that was probably meant."""
    bare = [word for word in words if is_bare(word)]
    if not bare:
        return
    if bare[0].partition(".")[0] in ("method", "dataset", "metrics", "degrade", "study") and "." in bare[0]:
        raise InputError("has no value", bare[0], f"an override reads key=value, write {bare[0]}=VALUE")
    keyed: dict[str, list[str]] = {}
    for word in bare:
        key, name = next(_readings(word, keyed), ("", ""))
        keyed.setdefault(key, []).append(name)
    remedy = "`sucre-bench list methods` and `list datasets` show the names"
    if "" not in keyed:
        several = "-m " if any(len(names) > 1 for key, names in keyed.items() if key != "metrics") else ""
        said = [f"{key}=[{','.join(n)}]" if key == "metrics" else f"{key}={','.join(n)}" for key, n in keyed.items()]
        remedy = f"write sucre-bench run {several}{shlex.join([*said, *(w for w in words if not is_bare(w))])}"
    raise InputError("an override reads key=value", bare[0], remedy)


def _readings(word: str, keyed: Iterable[str]) -> Iterator[tuple[str, str]]:
    """What a bare word may be, likeliest first: the key that goes before it, and the name that is meant."""
    names = {
        "dataset": [*plugins.discover("dataset")],
        "method": [*plugins.discover("method"), *(preset.name for preset in presets("method"))],
        "metrics": [*plugins.discover("metric")],
        "experiment": [preset.name for preset in presets("experiment")],
    }
    yield from ((key, word) for key, known in names.items() if word in known and (key != "dataset" or key not in keyed))
    if expanded(word).is_dir():
        yield "dataset", quoted(word if "/" in word else f"./{word}")
    near = {name: key for key, known in names.items() for name in known}
    yield from ((near[name], name) for name in difflib.get_close_matches(word, near, n=1, cutoff=0.7))


def refuse_options_of_no_dataset(typed: Sequence[Word], line_up: LineUp) -> None:
    """Raise InputError for a dataset's option where no dataset is named: the built-in one would take it.

    A line-up may leave the dataset open or name several; where the data are needs a dataset in the words.
    """
    if any(word.key == "dataset" for word in typed):
        return
    plugin = plugin_of("dataset", default_choice("dataset"))
    paths = {o.name for o in options_of(plugin.cls) if Path in (o.type, *get_args(o.type))} if plugin else set()
    for word in typed:
        option = word.key.partition(".")[2]
        if word.head == "dataset" and (option in paths or not line_up.place):
            raise InputError(
                "no dataset is named", word.text, f"add dataset=NAME, for example dataset=colmap {word.text}"
            )


def refuse_several_values(typed: Sequence[Word], is_sweep: bool) -> None:
    """Raise InputError for several values where no sweep was asked for, and for a path that has a comma."""
    for word in typed:
        key, value = word.key, word.text.partition("=")[2]
        if word.is_swept:
            quotes = f'"{key}={quoted(value)}"'
            if Path(value).exists():
                raise InputError("is one path with a comma", word.text, f"write {quotes} with both kinds of quotes")
            if key in ("metrics", "views") and not value.startswith("["):
                raise InputError("several values", word.text, f"write {key}=[{value}]")
            if not is_sweep:
                raise InputError("several values", word.text, f"add -m to run them all, or write {quotes} for a comma")
        elif key == "hydra/launcher" and not is_sweep:
            raise InputError("hands out the jobs of a sweep", word.text, "add -m")


def refuse_foreign(settings: DictConfig) -> None:
    """Raise InputError for what Hydra has and a command here does not follow."""
    if settings.hydra.job.chdir:
        raise InputError("paths are relative to the folder where you are", "hydra.job.chdir=true", "leave it false")
    if settings.hydra.callbacks:
        raise InputError("sucre-bench calls none", "hydra.callbacks", "leave them out")
    if not settings.hydra.sweeper["_target_"].endswith(".BasicSweeper"):
        name = settings.hydra.runtime.choices["hydra/sweeper"]
        raise InputError(
            "chooses values during a run, but all jobs are checked before", f"hydra/sweeper={name}", "use basic"
        )


# -- names and values that are wrong -------------------------------------------------------------------------


def not_an_override(text: str, fault: Exception) -> InputError:
    """Say what cannot be read as key=value."""
    key, equals, value = text.partition("=")
    if equals and key and value and (value[0] not in "'\"[{$" or "}" in value[1:-1]):
        return InputError("special characters need quotes", text, f'write "{key}={quoted(value)}", both kinds')
    return InputError(_first_line(fault), text, "an override reads key=value")


def unknown_word(word: Word, entries: Mapping[Kind, Sequence[Entry]], line_up: LineUp) -> InputError | None:
    """Return the fault of a word that is no option of a chosen dataset or method; None for a key of the run.

    line_up: of which other words may have replaced the datasets or methods.
    """
    text, key, head, dot = word.text, word.key, word.head, "." in word.key
    known = [option.name for option in options_of(RunConfig)]
    if head in known:
        return None
    for kind, chosen in entries.items():
        names = ",".join(dict.fromkeys(entry.name for entry in chosen))
        owners = dict.fromkeys(entry.name for entry in chosen if key in option_names(kind, entry.name))
        if owners:
            before = [kind] if len(chosen) == 1 else [*owners]
            return InputError(f"is an option of a {kind}", text, f"write {' or '.join(f'{b}.{text}' for b in before)}")
        if dot and plugin_of(kind, head):
            return InputError(f"'{head}' is not among the {kind}s", text, f"add it: -m {kind}={names},{head}")
        if dot and head in {entry.label for entry in line_up.entries(kind)}:
            given = f"{kind}={names}"
            return InputError(f"'{head}' is not among the {kind}s of this run", text, f"leave out {given} or {key}")
    if dot and plugin_of("metric", head):
        return InputError("is an option of a metric", text, f"write metrics.{text}")
    owners_there = (name for chosen in entries.values() for entry in chosen for name in (entry.name, entry.label))
    return unknown_name(key, head, {*known, *filter(None, owners_there)})


def of_composing(fault: Exception, words: Sequence[Word]) -> SucreBenchError:
    """Return why Hydra cannot compose these choices: the first wrong name, or what Hydra says."""
    for word in words:
        try:
            check_names(word.key, word.values[0])
        except SucreBenchError as wrong:
            return wrong
    return InputError(_first_line(fault.__cause__ or fault))


def of_value(fault: Exception, config: DictConfig, key: str) -> SucreBenchError:
    """Return why a key of a configuration cannot have a value: no such key, or another type."""
    from omegaconf import DictConfig, OmegaConf

    node: Any = config
    for part in key.split("."):
        if not isinstance(node, DictConfig) or OmegaConf.is_missing(node, part):
            break
        if part not in node:
            return unknown_name(key, part, [str(name) for name in node if not str(name).startswith("_")])
        node = node[part]
    said = _first_line(fault)
    value = re.match(
        r"Value '(.*)' (?:of type '\w+' could not be converted to |is not a )(Integer|Float|valid bool)", said
    )
    return InputError(f"'{value[1]}' is not {_TYPES[value[2]]}; correct the value" if value else said, key)


def check_names(group: str, value: Any) -> None:
    """Raise InputError for a name that a group of Hydra's does not have, with the nearest."""
    from hydra.core.global_hydra import GlobalHydra

    if group in ("method", "dataset") and (isinstance(value, list) or value is None):
        raise InputError("one name at a time", f"{group}={value}", f"-m {group}=a,b runs several")
    # The names that Hydra knows, the user's own folders included.
    hydra = GlobalHydra.instance()
    known_presets = (
        hydra.config_loader().get_group_options(group)
        if hydra.is_initialized()
        else [preset.name for preset in presets(group)]
    )
    for name in (str(one) for one in (value if isinstance(value, list) else [value])):
        if name in known_presets:
            continue
        if group not in GROUPS:
            raise InputError(f"no {group} is called '{name}'", remedy=did_you_mean(name, known_presets))
        kind = GROUPS[group]
        known = plugins.discover(kind)
        if isinstance(known.get(name), Broken):
            plugins.find(kind, name)  # raises with the reason
        if kind == "dataset" and name not in known and Path(name).exists():
            remedy = f"sucre-bench run {name}" if Path(name).is_file() else f"dataset=./{name}"
            raise UnknownPluginError(
                f"no dataset is called '{name}', but there is a path of this name", kind, f"write {remedy}"
            )
        if name not in known:
            raise plugins.unknown(kind, name, {*known, *known_presets})


def _first_line(fault: BaseException) -> str:
    lines = str(fault).strip().splitlines() or [type(fault).__name__]
    return lines[0].rstrip(".:") if not lines[0].endswith(":") or len(lines) == 1 else lines[1].strip().rstrip(".")
