"""`sucre-bench completion`: prints click's script for a shell, and completes the words of `sucre-bench run`.

The words (key=value) come from the options of plugins. Bash parts words at "=" and ":", and replaces the last part.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import click
from click.shell_completion import CompletionItem, get_completion_class, split_arg_string

from sucre_bench.errors import SucreBenchError
from sucre_bench.machine.files import expanded

if TYPE_CHECKING:
    from sucre_bench.plugins.options import Option

# What click's scripts lack, and what mends it.
_MENDS = {
    "-o nosort": "-o nosort -o nospace",  # a value follows "method="
    'COMP_WORDS="${COMP_WORDS[*]}" COMP_CWORD=$COMP_CWORD': (  # bash: the words as typed, and what is replaced
        """COMP_WORDS="${COMP_LINE:0:COMP_POINT}$([[ $2 ]] || echo "''")" COMP_CWORD=-1"""
        ' COMP_PART="$2" COMP_QUOTE="${COMP_WORDS[COMP_CWORD]:0:1}"'
    ),
    "read type value": "read -r type value",  # a backslash stays
    "+=($value)": '+=("$value")',  # "[psnr]" is no pattern for files
    'split ","': 'split -m 1 ","',  # fish: "[psi,psnr]" is one word
}


@click.command("completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the script with which <TAB> completes commands, options and key=value words.

    \b
    echo 'source <(sucre-bench completion bash)' >> ~/.bashrc
    echo 'source <(sucre-bench completion zsh)' >> ~/.zshrc
    sucre-bench completion fish > ~/.config/fish/completions/sucre-bench.fish

    Completion then works in every new shell that finds sucre-bench, for example after `source .venv/bin/activate`. For
    the current shell only: source <(sucre-bench completion bash). bash must be 4.4 or newer. In ~/.zshrc, put the line
    after compinit.
    """
    command, kind = click.get_current_context().find_root().command, get_completion_class(shell)
    assert kind is not None
    script = kind(command, {}, "sucre-bench", "_SUCRE_BENCH_COMPLETE").source()
    for lacking, mended in _MENDS.items():
        script = script.replace(lacking, mended)
    click.echo(script)


# -- the words of run, describe, charts, check, score and compare ----------------------------------------------

_Found = Iterator[tuple[str, str]]  # words, each with what it is
# Words of `sucre-bench run` whose values are these alone; booleans are known by their type.
_VALUES = {"hydra/launcher": ("joblib", "slurm")}


def complete_words(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete an override, its key or its value, given the words before it; or the path of a line-up or an image."""
    before = ctx.params.get(param.name or "") or ()
    given = dict(word.partition("=")[::2] for word in before if "=" in word)
    line_up = [word for word in before if "=" not in word]
    found = [*_overrides(incomplete, given | ({"": line_up[0]} if line_up else {}))]
    found += places(incomplete) if incomplete and "=" not in incomplete and not found else ()
    return _items(incomplete, found)


def complete_datasets(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete as `complete_words`, and a dataset's bare name before all else."""
    named = () if ctx.params.get(param.name or "") else _starting(incomplete, _names("dataset"))
    return [*_items(incomplete, named), *complete_words(ctx, param, incomplete)]


def complete_metrics(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete the last of several metrics parted by commas: its name, or its variant behind a colon."""
    before, comma, last = incomplete.rpartition(",")
    return _items(incomplete, _starting(last, _metrics(last), before + comma))


def _items(typed: str, found: Iterable[tuple[str, str]]) -> list[CompletionItem[str]]:
    """The words as they go into the line. Bash replaces the last part of what is typed, and escapes nothing."""
    part, is_bash = os.environ.get("COMP_PART", typed), "COMP_PART" in os.environ
    head = typed.removesuffix(part if typed.endswith(part) else "".join(split_arg_string(part)))
    special = " \t'\"\\$`&|;<>()*?!#" if is_bash and os.environ["COMP_QUOTE"] not in ("'", '"') else ""
    escaped = str.maketrans({letter: f"\\{letter}" for letter in special})
    return [CompletionItem(word.removeprefix(head).translate(escaped), help=said) for word, said in found]


def _overrides(typed: str, given: Mapping[str, str]) -> _Found:
    """The overrides that a word may become. given: the values of the words before by key, a line-up's by ""."""
    from sucre_bench.jobs.lineup import KINDS
    from sucre_bench.jobs.run_options import RunConfig

    key, equals, value = typed.partition("=")
    group, _, name = key.rpartition(".")
    if not equals and group:
        yield from _starting(typed, ((f"{group}.{option.name}=", option.help) for option in _options(group, given)))
        return
    if not equals:
        groups = ["dataset", "method", "metrics", "degrade", "shard", "tracking"]
        groups += [name for kind in KINDS if kind in given or "" in given for name in _chosen(kind, given)]
        plain = (f.name for f in fields(RunConfig) if f.name not in (*groups, "study"))
        keys = [f"{name}=" for name in ("dataset", "method", "metrics", "experiment", *plain, *_VALUES)]
        yield from _starting(typed, ((word, "") for word in (*keys, *(f"{name}." for name in groups))))
        return
    bracket = value[: value.startswith("[")]  # of several values, the last is completed
    others, comma, last = value[len(bracket) :].rpartition(",")
    head, is_list = f"{key}={bracket}{others}{comma}", key == "metrics"
    if key in ("dataset", "method", "experiment", "metrics") and not last.startswith(("/", ".")):
        known = _metrics(last) if is_list else _names(key)
        opens = is_list and not bracket and ":" not in last  # bash completes only what follows the colon
        names = ((name, said) for name, said in known if name not in others.split(","))
        head = f"{key}=[{others}{comma}" if opens else head
        yield from _starting(last, names, head, "]" if opens or bracket else "")
        return
    option = next((option for option in _options(group, given) if option.name == name), None)
    words, kinds = [*_VALUES.get(key, ())], tuple[Any, ...]()
    if option is not None:
        kinds = (option.type, *get_args(option.type))
        words += [*option.choices, *(("true", "false") if bool in kinds else ())]
        words += ["null"] if type(None) in kinds else []
    words += _chosen("method", given) if key == "baseline" else ()
    yield from _starting(last, ((word, "") for word in words), head)
    if key in ("out", "views", "dataset") or Path in kinds:
        yield from places(value, f"{key}=")


def _metrics(start: str) -> _Found:
    """The metrics with what they are; behind a colon the variants of one, with what sets each apart."""
    from sucre_bench.jobs.catalogue import plugin_of

    name, colon, _ = start.partition(":")
    if not colon:
        yield from _names("metrics")
    elif plugin := plugin_of("metric", name):
        variants = {**plugin.variants, "all": "every variant"}
        yield from ((f"{name}:{variant}", said) for variant, said in variants.items())


def _starting(start: str, words: Iterable[tuple[str, str]], before: str = "", after: str = "") -> _Found:
    return ((f"{before}{word}{after}", said) for word, said in words if word.startswith(start))


def _names(group: str) -> _Found:
    """Plugins and presets, or experiments, with what they are."""
    from sucre_bench import plugins
    from sucre_bench.jobs.catalogue import GROUPS, presets

    for kind in (kind for kind, folder in GROUPS.items() if folder == group):
        yield from ((name, plugin.summary) for name, plugin in plugins.usable(kind).items())
    for preset in presets(group):
        yield preset.name, preset.description


def _chosen(kind: Literal["dataset", "method"], given: Mapping[str, str]) -> dict[str, str]:
    """What words or a line-up choose, else what runs by default: names, and labels of a line-up, each with its name."""
    from sucre_bench.jobs.catalogue import default_choice
    from sucre_bench.jobs.lineup import line_up_in

    if kind in given:
        return {name: name for name in given[kind].split(",")}
    entries = {}
    if "" in given:
        with contextlib.suppress(SucreBenchError):
            line_up = line_up_in(Path(given[""])).entries(kind)
            entries = {name: entry.name for entry in line_up for name in (entry.name, entry.label) if name}
    return entries or {default_choice(kind): default_choice(kind)}


def _options(group: str, given: Mapping[str, str]) -> tuple[Option, ...]:
    """The options of chosen methods or datasets, of all or of the one that is named; of a metric, or of the engine."""
    from sucre_bench.degrade import Degradation
    from sucre_bench.jobs.catalogue import plugin_of
    from sucre_bench.jobs.lineup import KINDS
    from sucre_bench.jobs.run_options import RunConfig, Shard, Tracking
    from sucre_bench.plugins.options import options_of

    engine = {"": RunConfig, "degrade": Degradation, "shard": Shard, "tracking": Tracking}
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


def places(start: str, before: str = "") -> _Found:
    """The files and folders whose path starts so, with a home folder's ~ kept as it is."""
    folder, slash, name = start.rpartition("/")
    with contextlib.suppress(OSError):
        for path in sorted(expanded(folder + slash or ".").iterdir()):
            if path.name.startswith(name) and (name.startswith(".") or not path.name.startswith(".")):
                yield f"{before}{folder}{slash}{path.name}{'/' if path.is_dir() else ''}", ""
