"""What a shell's <TAB> completes: the words (key=value) of commands, as the plugins define them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    import click

    from sucre_bench.plugins.options import Option

__all__ = ["complete_datasets", "complete_metrics", "complete_views", "complete_words", "places"]

# Words of `sucre-bench run` whose values are these alone; booleans are known by their type.
_VALUES = {
    "hydra/launcher": ("joblib", "slurm"),
}


def complete_words(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete an override: its key, or its value, given the overrides before it."""
    given = dict(word.partition("=")[::2] for word in ctx.params.get(param.name or "") or () if "=" in word)
    key, equals, value = incomplete.partition("=")
    if not equals:
        return list(_starting(incomplete, _keys(key.rpartition(".")[0], given)))
    head, list_ = f"{key}=", re.fullmatch(r"(\[?)(.*,)?([^,]*)", value)
    assert list_ is not None
    done = f"{list_[1]}{list_[2] or ''}"
    if key in ("dataset", "method", "experiment", "metrics"):
        taken = set(done.strip("[").split(","))
        names = [(name, said) for name, said in _names(key) if name not in taken]
        if key == "metrics" and list_[1] == "":
            head, done = f"{head}[", ""
        return list(_starting(list_[3], names, head + done, "]" if key == "metrics" else ""))
    option = _option(key, given)
    words = _VALUES.get(key, ()) if option is None else _words_of(option)
    found = list(_starting(list_[3], ((word, "") for word in words), head + done))
    if key == "out" or key == "views" or (option is not None and Path in (option.type, *get_args(option.type))):
        found += places(value, prefix=head)
    return found


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
    plugin = _plugin("metrics", name)
    variants = {**plugin.variants, "all": "every variant"} if plugin else {}
    return list(_starting(variant, variants.items(), f"{before}{comma}{name}:"))


def _starting(
    start: str, words: Iterable[tuple[str, str]], before: str = "", after: str = ""
) -> Iterator[CompletionItem[str]]:
    for word, said in words:
        if word.startswith(start):
            yield CompletionItem(f"{before}{word}{after}", help=said)


def _keys(group: str, given: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """What may stand before "=": in a group (before its last dot), or at the top."""
    from sucre_bench.jobs.schema import RunConfig

    if group:
        yield from ((f"{group}.{option.name}=", option.help) for option in _options(group, given))
        return
    groups = ("dataset", "method", "metrics", "degrade", "shard", "tracking")
    plain = (f.name for f in fields(RunConfig) if f.name not in (*groups, "study"))
    yield from ((f"{name}=", "") for name in ("dataset", "method", "metrics", "experiment", *plain, *_VALUES))
    yield from ((f"{name}.", "") for name in groups)


def _names(group: str) -> Iterator[tuple[str, str]]:
    """Plugins and presets, or experiments, with what they are."""
    from sucre_bench import plugins
    from sucre_bench.jobs.presets import presets
    from sucre_bench.jobs.schema import GROUPS
    from sucre_bench.plugins.plugin import Plugin

    if group in GROUPS:
        for name, plugin in plugins.discover(GROUPS[group]).items():
            if isinstance(plugin, Plugin):
                yield name, plugin.summary
    for preset in presets(group):
        yield preset.name, preset.description


def _plugin(group: str, name: str) -> Any:
    """A group's plugin of this name, or that a preset of this name is of; None where there is none."""
    from sucre_bench import plugins
    from sucre_bench.jobs.presets import presets
    from sucre_bench.jobs.schema import GROUPS
    from sucre_bench.plugins.plugin import Plugin

    known = plugins.discover(GROUPS[group])
    if name not in known:
        bases = (base for preset in presets(group) if preset.name == name for base in preset.builds_on)
        name = next((base for base in bases if base in known), name)
    plugin = known.get(name)
    return plugin if isinstance(plugin, Plugin) else None


def _options(group: str, given: Mapping[str, str]) -> tuple[Option, ...]:
    """The options of the method, dataset or metric that was chosen before (the first of several), or of the engine."""
    from sucre_bench.degrade import Degradation
    from sucre_bench.jobs.presets import default_choice
    from sucre_bench.jobs.schema import Tracking
    from sucre_bench.jobs.shard import Shard
    from sucre_bench.plugins.options import options_of

    engine = {"degrade": Degradation, "shard": Shard, "tracking": Tracking}
    if group in engine:
        return options_of(engine[group])
    kind, _, name = group.partition(".")
    if kind in ("dataset", "method") and not name:
        name = given.get(kind, default_choice(kind)).split(",")[0]
    elif kind != "metrics":
        return ()
    plugin = _plugin(kind, name)
    return options_of(plugin.cls) if plugin else ()


def _option(key: str, given: Mapping[str, str]) -> Option | None:
    group, _, name = key.rpartition(".")
    own = _options(group, given) if group else _top()
    return next((option for option in own if option.name == name), None)


def _top() -> tuple[Option, ...]:
    from sucre_bench.jobs.schema import RunConfig
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
        inside = sorted(Path(folder + slash or ".").expanduser().iterdir())
    except OSError:
        return []
    for path in inside:
        is_shown = path.name.startswith(name) and (name.startswith(".") or not path.name.startswith("."))
        if is_shown and (path.is_dir() or not folders_only):
            found.append(CompletionItem(f"{prefix}{folder}{slash}{path.name}{'/' if path.is_dir() else ''}"))
    return found
