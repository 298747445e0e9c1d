"""Reads a line-up file. Errors name the file, the key, and what to write instead.

Paths in it are relative to its folder; only `out` is relative to the folder where the command runs. Its values are
taken as they are: nothing in them is interpolated.
"""

import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.errors import InputError, SucreBenchError, did_you_mean, one_line, unknown_name
from sucre_bench.jobs.lineup import KINDS, Entry, Kind, LineUp
from sucre_bench.jobs.presets import given_paths, option_names, plugin_of, presets
from sucre_bench.jobs.recognise_dataset import is_path, recognised
from sucre_bench.jobs.run_options import CONF_FOLDER, RunConfig
from sucre_bench.machine.files import expanded, fault_of
from sucre_bench.machine.text_formats import read_yaml
from sucre_bench.plugins.options import options_of

_LISTS = ("datasets", "methods", "metrics", "sweep")
_SETTINGS = tuple(o.name for o in options_of(RunConfig) if o.name not in ("dataset", "method", "metrics", "tracking"))
_NOT_SWEPT = ("dataset", "method", "metrics", "hydra", "out", "plugins", "study", "baseline")


def read_experiment(name: str) -> LineUp:
    """Return an experiment of conf/. Raises InputError for a name that none has, with the nearest."""
    known = [preset.name for preset in presets("experiment")]
    if name not in known:
        raise InputError(f"no experiment is called '{name}'; {did_you_mean(name, known)}")
    path = CONF_FOLDER / "experiment" / f"{name}.yaml"
    return replace(_line_up(_content(path), path), place=f"experiment={name}")


def read_line_up(path: Path) -> LineUp:
    """Return a line-up, with the plugin files it names loaded. Raises InputError for what is wrong with it."""
    content = _content(path)
    try:
        return _line_up(content, path)
    except SucreBenchError as fault:
        raise fault.within(path) from fault


def _line_up(content: Mapping[str, Any], path: Path) -> LineUp:
    settings = {key: content[key] for key in _SETTINGS if content.get(key) is not None}
    folder = path.parent
    for file in (files := _plugin_files(settings.pop("plugins", []), folder)):
        plugins.load_file(file)
    return LineUp(
        datasets=_entries("dataset", content, folder),
        methods=_entries("method", content, folder),
        metrics=tuple(_entry("metrics", given) for given in _list("metrics", content)),
        sweep=_sweep(content.get("sweep") or {}),
        settings={key: _settled(key, value, folder) for key, value in settings.items()}
        | ({"plugins": files} if files else {}),
        place=str(path),
    )


def _content(path: Path) -> dict[str, Any]:
    """What a line-up holds, by key. Raises InputError, naming the file, for what is no line-up or an unknown key."""
    import yaml

    if fault := fault_of(path):
        raise InputError(fault, path, "give a line-up, `sucre-bench lineup RESULTS` writes one")
    try:
        content = read_yaml(path.read_text(encoding="utf-8-sig"))
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise InputError(f"line {line}: is no plain YAML, {error.problem}", path, "mend the line") from error
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"cannot be read, {one_line(error)}", path, "save it as YAML in UTF-8") from error
    if content is None:
        raise InputError("is empty", path, "list methods: [NAME, ...]")
    if not isinstance(content, dict):
        raise InputError("holds no keys", path, "write methods: [NAME, ...]")
    for key in content:
        if key not in (*_LISTS, *_SETTINGS):
            raise unknown_name(str(path), str(key), (*_LISTS, *_SETTINGS), "key")
    return content


def _list(key: str, content: Mapping[str, Any]) -> Sequence[Any]:
    given = content.get(key)
    if given is None and key not in content:
        return ()
    given = [given] if isinstance(given, (str, dict)) else given
    if not isinstance(given, list) or not given:
        raise InputError("is no list of names", key, f"write {key}: [NAME, ...]")
    return given


def _entry(key: str, given: Any) -> Entry:
    """An entry as it stands in the file: a name, or a name with options."""
    if isinstance(given, dict) and isinstance(name := given.get("name"), str):
        return Entry(name, {str(option): value for option, value in given.items() if option != "name"})
    if isinstance(given, str):
        return Entry(given)
    raise InputError(f"{given!r} has no name", key, "write NAME, or {name: NAME, OPTION: VALUE}")


def _entries(kind: Kind, content: Mapping[str, Any], folder: Path) -> tuple[Entry, ...]:
    key = f"{kind}s"
    entries = [_checked(kind, _entry(key, given), folder) for given in _list(key, content)]
    labelled = Counter((entry.label, repr(entry.options.get("degrade"))) for entry in entries if entry.label)
    for (label, _), times in labelled.items():
        if times > 1:
            raise InputError(f"{times} have the label '{label}'", key, "give each a label of its own")
    return tuple(entries)


def _checked(kind: Kind, entry: Entry, folder: Path) -> Entry:
    """The entry with its paths as seen from here. Raises InputError for an unknown name or option."""
    root: Mapping[str, Any] = {}
    if kind == "dataset" and is_path(entry.name):
        found = recognised(Path(_moved(entry.name, folder)))
        entry, root = replace(entry, name=found.name), found.options
    if plugin_of(kind, entry.name) is None:
        known = [*plugins.discover(kind), *(preset.name for preset in presets(kind))]
        if entry.name not in known:
            raise plugins.unknown(kind, entry.name, known)
        plugins.find(kind, entry.name)  # raises with the reason why it cannot be used
    names = [*option_names(kind, entry.name), *(["degrade"] if kind == "dataset" else [])]
    for option in entry.options:
        if option not in names:
            raise unknown_name(f"{entry.name}.{option}", option, names)
    moved = {option: _moved(path, folder) for option, path in given_paths(kind, entry.name, entry.options).items()}
    if "degrade" in entry.options:
        moved["degrade"] = _settled("degrade", entry.options["degrade"], folder)
    return replace(entry, options={**root, **entry.options, **moved})


def _sweep(given: Any) -> dict[str, list[Any]]:
    if not isinstance(given, dict):
        raise InputError("is no mapping", "sweep", "write sweep: {OPTION: [VALUE, ...]}")
    for key, values in given.items():
        head, dot, _ = str(key).partition(".")
        is_word = re.fullmatch(r"[A-Za-z_][\w-]*(\.\w+)*", str(key))
        if not is_word or (head in _NOT_SWEPT and not (head in KINDS and dot)):
            raise InputError("cannot be swept", f"sweep.{key}", "list datasets and methods, sweep their options")
        if not isinstance(values, list) or not values:
            raise InputError("is no list of values", f"sweep.{key}", f"write {key}: [VALUE, ...]")
    return {str(key): values for key, values in given.items()}


def _plugin_files(given: Any, folder: Path) -> list[str]:
    files = [given] if isinstance(given, str) else given
    if not isinstance(files, list) or not all(isinstance(file, str) for file in files):
        raise InputError(f"{given!r} is no list of files", "plugins", "write plugins: [FILE, ...]")
    return [str(Path(_moved(file, folder)).resolve()) for file in files]


def _settled(key: str, value: Any, folder: Path) -> Any:
    """A setting with its paths as seen from here."""
    is_nested = key in ("degrade", "study", "shard")
    if is_nested != isinstance(value, dict):
        expected = f"{{OPTION: VALUE}} below {key}:" if is_nested else "one value"
        raise InputError(f"{value!r} does not fit", key, f"write {expected}")
    if isinstance(value, list) and key != "views":
        raise InputError(f"{value} are several values", key, f"write one, or sweep: {{{key}: {value}}}")
    if key == "degrade" and isinstance(value.get("add_water"), str):
        return {**value, "add_water": _moved(value["add_water"], folder)}
    return _moved(value, folder) if key == "views" and str(value).endswith(".txt") else value


def _moved(value: Any, folder: Path) -> Any:
    """A path as seen from where the command runs; what is no text as it is."""
    return os.path.normpath(folder / expanded(value)) if isinstance(value, str) and value else value
