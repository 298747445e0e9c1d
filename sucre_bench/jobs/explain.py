"""What is wrong with a command's overrides, said in words of ours: where Hydra refuses, this finds the reason."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from sucre_bench import plugins
from sucre_bench.errors import InputError, SucreBenchError, did_you_mean, unknown_name
from sucre_bench.jobs.quoting import quoted
from sucre_bench.plugins.plugin import Broken, Kind

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override

__all__ = ["GROUPS", "check_experiment", "in_our_words", "not_an_override"]

# Hydra's groups of plugins.
GROUPS: dict[str, Kind] = {"method": "method", "dataset": "dataset", "metrics": "metric"}
_SINGLE = ("method", "dataset", "experiment")


def not_an_override(text: str, fault: Exception) -> InputError:
    """Say what cannot be read as key=value."""
    key, equals, value = text.partition("=")
    if equals and key and value and (value[0] not in "'\"[{$" or "}" in value[1:-1]):
        return InputError(f'{text}: special characters need quotes; write "{key}={quoted(value)}", both kinds')
    return InputError(f"{text}: {_first_line(fault)}; an override reads key=value")


def check_experiment(parsed: list[Override]) -> None:
    """Raise InputError for an experiment that does not exist: Hydra takes a missing one for none at all."""
    for override in parsed:
        if override.key_or_group == "experiment" and not override.is_sweep_override():
            _check_names("experiment", override.value())


def in_our_words(fault: Exception, overrides: list[str]) -> SucreBenchError:
    """Return what is wrong with these overrides: the first wrong name, unknown key or wrong type."""
    from hydra.core.override_parser.overrides_parser import OverridesParser

    parsed = OverridesParser.create().parse_overrides(overrides)
    choices = [o for o in parsed if o.key_or_group in (*GROUPS, "experiment") or "/" in o.key_or_group]
    for override in choices:
        try:
            _check_names(override.key_or_group, override.value())
        except SucreBenchError as wrong:
            return wrong
    groups = [o.input_line or "" for o in choices]
    for override in parsed:
        if override not in choices and (unknown := _unknown_key(override.key_or_group, groups)):
            return unknown
    cause = fault.__cause__ or fault
    key = re.search(r"full_key: (\S+)", str(cause))
    return InputError(f"{key[1] + ': ' if key else ''}{_first_line(cause)}; mend the override")


def _check_names(group: str, value: Any) -> None:
    if group in _SINGLE and (isinstance(value, list) or value is None):
        raise InputError(f"{group}={value}: one name at a time; -m {group}=a,b runs several")
    names = [str(n) for n in (value if isinstance(value, list) else [value])]
    presets = _presets(group)
    for name in names:
        if name in presets:
            continue
        if group not in GROUPS:
            raise InputError(f"no {group} is called '{name}'; {did_you_mean(name, presets)}")
        kind = GROUPS[group]
        known = plugins.discover(kind)
        if isinstance(known.get(name), Broken):
            plugins.find(kind, name)  # raises with the reason
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
        if not isinstance(node, DictConfig):
            return None
        if part not in node:
            return unknown_name(path, part, [str(key) for key in node if not str(key).startswith("_")])
        if OmegaConf.is_missing(node, part):
            return None
        node = node[part]
    return None


def _first_line(fault: BaseException) -> str:
    lines = str(fault).strip().splitlines() or [type(fault).__name__]
    return lines[0].rstrip(".:") if not lines[0].endswith(":") or len(lines) == 1 else lines[1].strip().rstrip(".")
