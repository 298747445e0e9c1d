"""The words (key=value) that <TAB> completes in a shell, from the options of commands and plugins."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from click.shell_completion import CompletionItem

from sucre_bench.machine.files import expanded

if TYPE_CHECKING:
    import click

    from sucre_bench.plugins.options import Option

# Words of `sucre-bench run` whose values are these alone; booleans are known by their type.
_VALUES = {"hydra/launcher": ("joblib", "slurm")}


def complete_words(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete an override: its key, or its value, given the words before it."""
    before = ctx.params.get(param.name or "") or ()
    given = dict(word.partition("=")[::2] for word in before if "=" in word)
    line_up = [word for word in before if "=" not in word]
    given |= {"": line_up[0]} if line_up else {}
    key, equals, value = incomplete.partition("=")
    if not equals:
        return list(_starting(incomplete, _keys(key.rpartition(".")[0], given)))
    if key in ("dataset", "method", "experiment", "metrics", "baseline"):
        return list(_named(key, value, given))
    head, list_ = f"{key}=", re.fullmatch(r"(\[?)(.*,)?([^,]*)", value)
    assert list_ is not None
    option = _option(key, given)
    words = _VALUES.get(key, ()) if option is None else _words_of(option)
    found = list(_starting(list_[3], ((word, "") for word in words), f"{head}{list_[1]}{list_[2] or ''}"))
    if key == "out" or key == "views" or (option is not None and Path in (option.type, *get_args(option.type))):
        found += places(value, prefix=head)
    return found


def complete_run(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete as `complete_words`, and else the path of a line-up."""
    is_path = "/" in incomplete or incomplete.startswith(".")
    there = [] if "=" in incomplete else places(incomplete)
    files = [item for item in there if item.value.endswith((".yaml", ".yml")) or (is_path and item.value[-1] == "/")]
    return [*complete_words(ctx, param, incomplete), *files]


def _named(key: str, value: str, given: Mapping[str, str]) -> Iterator[CompletionItem[str]]:
    """The names that may stand for a key, the last of several: of plugins and presets, of folders, of variants."""
    list_ = re.fullmatch(r"(\[?)(.*,)?([^,]*)", value)
    assert list_ is not None
    last, head = list_[3], f"{key}={list_[1]}{list_[2] or ''}"
    if key == "dataset" and (last.startswith(".") or "/" in last):
        yield from places(last, folders_only=True, prefix=head)
        return
    if key == "baseline":
        yield from _starting(last, ((name, "") for name in _chosen("method", given)), head)
        return
    if key == "metrics" and ":" in last:
        name = last.partition(":")[0]
        yield from _starting(last, ((f"{name}:{variant}", said) for variant, said in _variants(name)), head, "]")
        return
    taken = set(f"{list_[2] or ''}".split(","))
    names = [(name, said) for name, said in _names(key) if name not in taken]
    opening = "[" if key == "metrics" and list_[1] == "" else ""
    yield from _starting(last, names, f"{key}=[" if opening else head, "]" if key == "metrics" else "")


def complete_datasets(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete as `complete_words`, and a dataset's bare name before all else."""
    named = () if ctx.params.get(param.name or "") or "=" in incomplete else _names("dataset")
    return [*_starting(incomplete, named), *complete_words(ctx, param, incomplete)]


def complete_views(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete as `complete_words`, and else the path of an image."""
    return [*complete_words(ctx, param, incomplete), *([] if "=" in incomplete else places(incomplete))]


def complete_metrics(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete the last of several metrics parted by commas: its name, or its variant behind a colon."""
    before, comma, last = incomplete.rpartition(",")
    name, colon, variant = last.partition(":")
    if not colon:
        return list(_starting(name, _names("metrics"), before + comma))
    return list(_starting(variant, _variants(name), f"{before}{comma}{name}:"))


def _variants(metric: str) -> Iterator[tuple[str, str]]:
    """The variants of a metric, with what sets each apart."""
    from sucre_bench.jobs.catalogue import plugin_of

    if plugin := plugin_of("metric", metric):
        yield from {**plugin.variants, "all": "every variant"}.items()


def _starting(
    start: str, words: Iterable[tuple[str, str]], before: str = "", after: str = ""
) -> Iterator[CompletionItem[str]]:
    for word, said in words:
        if word.startswith(start):
            yield CompletionItem(f"{before}{word}{after}", help=said)


def _keys(group: str, given: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """What may stand before "=": in a group (before its last dot), or at the top."""
    from sucre_bench.jobs.lineup import KINDS
    from sucre_bench.jobs.run_options import RunConfig

    if group:
        yield from ((f"{group}.{option.name}=", option.help) for option in _options(group, given))
        return
    groups = ["dataset", "method", "metrics", "degrade", "shard", "tracking"]
    groups += [name for kind in KINDS if kind in given or "" in given for name in _chosen(kind, given)]
    plain = (f.name for f in fields(RunConfig) if f.name not in (*groups, "study"))
    yield from ((f"{name}=", "") for name in ("dataset", "method", "metrics", "experiment", *plain, *_VALUES))
    yield from ((f"{name}.", "") for name in groups)


def _names(group: str) -> Iterator[tuple[str, str]]:
    """Plugins and presets, or experiments, with what they are."""
    from sucre_bench import plugins
    from sucre_bench.jobs.catalogue import presets
    from sucre_bench.jobs.hydra_schema import GROUPS

    if group in GROUPS:
        yield from ((name, plugin.summary) for name, plugin in plugins.usable(GROUPS[group]).items())
    for preset in presets(group):
        yield preset.name, preset.description


def _chosen(kind: Literal["dataset", "method"], given: Mapping[str, str]) -> dict[str, str]:
    """What words or a line-up choose, else what runs by default: names, and labels of a line-up, each with its name."""
    from sucre_bench.jobs.catalogue import default_choice

    if kind in given:
        return {name: name for name in given[kind].split(",")}
    in_file = _names_in(Path(given[""]), kind) if "" in given else {}
    return in_file or {default_choice(kind): default_choice(kind)}


def _names_in(line_up: Path, kind: str) -> dict[str, str]:
    """The names and labels of a line-up's datasets or methods, each with the name; none where it cannot be read."""
    import yaml

    from sucre_bench.errors import InputError
    from sucre_bench.machine.files import regular
    from sucre_bench.machine.text_formats import read_yaml

    try:
        entries = read_yaml(regular(line_up).read_text(encoding="utf-8"))[f"{kind}s"]
        said = [entry if isinstance(entry, dict) else {"name": entry} for entry in entries]
        return {str(one[key]): str(one["name"]) for one in said for key in ("name", "label") if key in one}
    except (OSError, InputError, ValueError, TypeError, KeyError, RecursionError, yaml.YAMLError):
        return {}


def _options(group: str, given: Mapping[str, str]) -> tuple[Option, ...]:
    """The options of chosen methods or datasets, of all or of the one that is named; of a metric, or of the engine."""
    from sucre_bench.degrade import Degradation
    from sucre_bench.jobs.catalogue import plugin_of
    from sucre_bench.jobs.lineup import KINDS
    from sucre_bench.jobs.run_options import Shard, Tracking
    from sucre_bench.plugins.options import options_of

    engine = {"degrade": Degradation, "shard": Shard, "tracking": Tracking}
    if group in engine:
        return options_of(engine[group])
    kind, _, name = group.partition(".")
    if kind == "metrics":
        owners = [plugin_of("metric", name)]
    elif kind in KINDS:
        owners = [plugin_of(kind, chosen) for chosen in _chosen(kind, given).values()]
    else:
        owners = [plugin_of(kind, name) for kind in KINDS if (name := _chosen(kind, given).get(group, ""))]
    every = (option for plugin in owners if plugin for option in options_of(plugin.cls))
    return tuple({option.name: option for option in every}.values())


def _option(key: str, given: Mapping[str, str]) -> Option | None:
    group, _, name = key.rpartition(".")
    options = _options(group, given) if group else _top()
    return next((option for option in options if option.name == name), None)


def _top() -> tuple[Option, ...]:
    from sucre_bench.jobs.run_options import RunConfig
    from sucre_bench.plugins.options import options_of

    return tuple(option for option in options_of(RunConfig) if option.name not in _VALUES)


def _words_of(option: Option) -> list[str]:
    """The words that an option takes: those of a Literal, truth values, null, and its default if that is a number."""
    kinds = (option.type, *get_args(option.type))
    words = [*option.choices, *(("true", "false") if bool in kinds else ())]
    if type(None) in kinds:
        words.append("null")
    if not words and option.default is not MISSING and isinstance(option.default, (int, float)):
        words.append(str(option.default))
    return words


def places(start: str, folders_only: bool = False, prefix: str = "") -> list[CompletionItem[str]]:
    """The files and folders whose path starts so, with a home folder's ~ kept as it is."""
    folder, slash, name = start.rpartition("/")
    found = []
    try:
        inside = sorted(expanded(folder + slash or ".").iterdir())
    except OSError:
        return []
    for path in inside:
        is_shown = path.name.startswith(name) and (name.startswith(".") or not path.name.startswith("."))
        if is_shown and (path.is_dir() or not folders_only):
            found.append(CompletionItem(f"{prefix}{folder}{slash}{path.name}{'/' if path.is_dir() else ''}"))
    return found
