"""Explains mistakes in a command's words: where Hydra refuses, this module finds the reason."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench import plugins
from sucre_bench.errors import InputError, SucreBenchError, UnknownPluginError, did_you_mean, unknown_name
from sucre_bench.jobs.lineup import Entry, Kind, LineUp
from sucre_bench.jobs.presets import option_names, plugin_of
from sucre_bench.jobs.quoting import quoted
from sucre_bench.jobs.run_options import GROUPS, RunConfig
from sucre_bench.plugins.options import options_of
from sucre_bench.plugins.plugin import Broken

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override

_SINGLE = ("method", "dataset")
# The types that OmegaConf names in a refusal, in the words of the field.
_TYPES = {"Integer": "a whole number", "Float": "a number", "valid bool": "true or false"}


def not_an_override(text: str, fault: Exception) -> InputError:
    """Say what cannot be read as key=value."""
    key, equals, value = text.partition("=")
    if equals and key and value and (value[0] not in "'\"[{$" or "}" in value[1:-1]):
        return InputError("special characters need quotes", text, f'write "{key}={quoted(value)}", both kinds')
    return InputError(_first_line(fault), text, "an override reads key=value")


def unknown_word(word: Override, entries: Mapping[Kind, Sequence[Entry]], line_up: LineUp) -> InputError | None:
    """Return the fault of a word that is no option of a chosen dataset or method; None for a key of the run.

    line_up: of which other words may have replaced the datasets or methods.
    """
    text, key = word.input_line, word.key_or_group
    head, dot, _ = key.partition(".")
    known = [option.name for option in options_of(RunConfig)]
    if head in (*known, "hydra") or "/" in key or "@" in key:
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


def in_our_words(fault: Exception, overrides: Sequence[str]) -> SucreBenchError:
    """Return what is wrong with these overrides: the first wrong name, unknown key or wrong type."""
    from hydra.core.override_parser.overrides_parser import OverridesParser

    parsed = OverridesParser.create().parse_overrides(list(overrides))
    choices = [o for o in parsed if o.key_or_group in GROUPS or "/" in o.key_or_group]
    for override in choices:
        try:
            check_names(override.key_or_group, override.value())
        except SucreBenchError as wrong:
            return wrong
    groups = [o.input_line or "" for o in choices]
    for override in parsed:
        if override not in choices and (unknown := _unknown_key(override.key_or_group, groups)):
            return unknown
    cause = fault.__cause__ or fault
    key = re.search(r"full_key: (\S+)", str(cause))
    return InputError(_refusal(_first_line(cause)), key[1] if key else "")


def _refusal(said: str) -> str:
    """OmegaConf's refusal of a value, in plain words where it is about the value's type."""
    value = re.match(
        r"Value '(.*)' (?:of type '\w+' could not be converted to |is not a )(Integer|Float|valid bool)", said
    )
    return f"'{value[1]}' is not {_TYPES[value[2]]}; correct the value" if value else f"{said}; mend the override"


def check_names(group: str, value: Any) -> None:
    if group in _SINGLE and (isinstance(value, list) or value is None):
        raise InputError("one name at a time", f"{group}={value}", f"-m {group}=a,b runs several")
    names = [str(n) for n in (value if isinstance(value, list) else [value])]
    presets = _presets(group)
    for name in names:
        if name in presets:
            continue
        if group not in GROUPS:
            raise InputError(f"no {group} is called '{name}'", remedy=did_you_mean(name, presets))
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
            raise plugins.unknown(kind, name, {*known, *presets})


def _presets(group: str) -> list[str]:
    """The names that Hydra knows in a group, the user's own folders included."""
    from hydra.core.global_hydra import GlobalHydra

    return list(GlobalHydra.instance().config_loader().get_group_options(group))


def _unknown_key(path: str, groups: list[str]) -> InputError | None:
    import hydra
    from omegaconf import DictConfig, OmegaConf

    try:
        node: Any = hydra.compose("config", overrides=groups, return_hydra_config=path.startswith("hydra."))
    except Exception:
        return None  # something else is wrong, and said elsewhere
    for part in path.lstrip("+~").split("@")[0].split("."):
        if not isinstance(node, DictConfig) or OmegaConf.is_missing(node, part):
            return None
        if part not in node:
            return unknown_name(path, part, [str(key) for key in node if not str(key).startswith("_")])
        node = node[part]
    return None


def _first_line(fault: BaseException) -> str:
    lines = str(fault).strip().splitlines() or [type(fault).__name__]
    return lines[0].rstrip(".:") if not lines[0].endswith(":") or len(lines) == 1 else lines[1].strip().rstrip(".")
