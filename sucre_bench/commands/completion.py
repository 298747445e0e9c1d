"""`sucre-bench completion`: prints click's script for a shell, and completes the words of `sucre-bench run`.

The words (key=value) come from the options of plugins. Bash parts words at "=" and ":", and replaces the last part.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import click
from click.shell_completion import CompletionItem, get_completion_class, split_arg_string

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

_Found = Iterable[tuple[str, str]]  # words, each with what it is
_KINDS: tuple[Literal["dataset", "method"], ...] = ("dataset", "method")
_GROUPS = (*_KINDS, "metrics", "experiment")


def complete_words(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem[str]]:
    """Complete an override, its key or its value, given the words before it; or the path of an experiment or image."""
    words = ctx.params.get(param.name or "") or ()
    given = dict(word.partition("=")[::2] for word in words if "=" in word)
    if "=" in incomplete:
        return _items(incomplete, _values(incomplete, given))
    keys = [*_starting(incomplete, _keys(incomplete, given))]
    return _items(incomplete, keys or (places(incomplete) if incomplete else ()))


def complete_datasets(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem[str]]:
    """Complete as `complete_words`, and a dataset's bare name before all else."""
    named = () if ctx.params.get(param.name or "") else _starting(incomplete, _names("dataset"))
    return [*_items(incomplete, named), *complete_words(ctx, param, incomplete)]


def complete_metrics(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem[str]]:
    """Complete the last of several metrics parted by commas: its name, or its variant behind a colon."""
    before, comma, last = incomplete.rpartition(",")
    return _items(incomplete, _starting(last, _names("metrics", last), before + comma))


def _items(typed: str, found: Iterable[tuple[str, str]]) -> list[CompletionItem[str]]:
    """The words as they go into the line. Bash replaces the last part of what is typed, and escapes nothing."""
    part, is_bash = os.environ.get("COMP_PART", typed), "COMP_PART" in os.environ
    head = typed.removesuffix(part if typed.endswith(part) else "".join(split_arg_string(part)))
    special = (
        " \t'\"\\$`&|;<>()*?!#" if is_bash and os.environ["COMP_QUOTE"] not in ("'", '"') else ""
    )
    escaped = str.maketrans({letter: f"\\{letter}" for letter in special})
    return [
        CompletionItem(word.removeprefix(head).translate(escaped), help=said)
        for word, said in found
    ]


def _starting(
    start: str, words: Iterable[tuple[str, str]], before: str = "", after: str = ""
) -> _Found:
    return ((f"{before}{word}{after}", said) for word, said in words if word.startswith(start))


def _keys(typed: str, given: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """The keys that a word may begin with; behind a dot the options of what stands before it."""
    from sucre_bench.jobs.run_options import OPTION_GROUPS

    group, dot, _ = typed.rpartition(".")
    hidden = () if dot else (*OPTION_GROUPS, *_GROUPS, "study")
    for option in _options(group, given):
        if option.name not in hidden:
            yield f"{group}{dot}{option.name}=", option.help
    if not dot:
        chosen = ",".join(given.get(kind, "") for kind in _KINDS).split(",")
        yield from ((f"{name}=", "") for name in (*_GROUPS, "hydra/launcher", "hydra/sweeper"))
        yield from ((f"{name}.", "") for name in (*_GROUPS[:3], *OPTION_GROUPS, *chosen) if name)


def _values(typed: str, given: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """The word with the values that its key takes: names, an option's choices, or paths."""
    key, _, value = typed.partition("=")
    bracket = "[" if value.startswith("[") else ""
    others, comma, last = value.removeprefix("[").rpartition(",")
    # bash completes only what follows the colon
    opens = key == "metrics" and not bracket and ":" not in last
    head = f"{key}={'[' if opens else bracket}{others}{comma}"
    group, _, name = key.rpartition(".")
    option = next((option for option in _options(group, given) if option.name == name), None)
    kinds = () if option is None else (option.type, *get_args(option.type))
    if key in _GROUPS or key.startswith("hydra/"):
        names = ((name, said) for name, said in _names(key, last) if name not in others.split(","))
        yield from _starting(last, names, head, "]" if opens or bracket else "")
    elif option is not None:
        words = [*option.choices]
        words += ["true", "false"] if bool in kinds else []
        words += ["null"] if type(None) in kinds else []
        words += given.get("method", "").split(",") if key == "baseline" else []
        yield from _starting(last, ((word, "") for word in words if word), head)
    if key in ("out", "views", "dataset") or Path in kinds:
        yield from places(value, f"{key}=")


def _names(group: str, start: str = "") -> _Found:
    """What Hydra lists of a group, with what it is; behind a colon the variants of a metric."""
    from sucre_bench import plugins
    from sucre_bench.jobs import catalogue, configs

    if group.startswith("hydra/"):
        return [(name, "") for name in configs.loader().get_group_options(group)]
    kind = next((kind for kind, folder in catalogue.GROUPS.items() if folder == group), None)
    name, colon, _ = start.partition(":")
    if kind and colon:
        plugin = catalogue.plugin_of(kind, name)
        variants = {**plugin.variants, "all": "every one"} if plugin else {}
        return [(f"{name}:{variant}", said) for variant, said in variants.items()]
    usable = plugins.usable(kind) if kind else {}
    summaries = {name: plugin.summary for name, plugin in usable.items()}
    return (summaries | configs.descriptions(group)).items()


def _options(group: str, given: Mapping[str, str]) -> Iterable[Option]:
    """The options of chosen methods or datasets, of all or of the one that is named; of a metric, or of the engine."""
    from sucre_bench.jobs import catalogue, configs
    from sucre_bench.jobs.run_options import OPTION_GROUPS, RunConfig
    from sucre_bench.plugins.options import options_of

    engine: dict[str, type[Any]] = {"": RunConfig, **OPTION_GROUPS}
    if group in engine:
        return options_of(engine[group])
    if group.startswith("metrics."):
        owners = [catalogue.plugin_of("metric", group.partition(".")[2])]
    else:
        owners = [
            catalogue.plugin_of(kind, name)
            for kind in _KINDS
            for name in (given.get(kind) or configs.defaults()[kind]).split(",")
            if group in (kind, name)
        ]
    every = (option for plugin in owners if plugin for option in options_of(plugin.cls))
    return {option.name: option for option in every}.values()


def places(start: str, before: str = "") -> Iterator[tuple[str, str]]:
    """The files and folders whose path starts so, with a home folder's ~ kept as it is."""
    folder, slash, name = start.rpartition("/")
    with contextlib.suppress(OSError):
        for path in sorted(expanded(folder + slash or ".").iterdir()):
            if path.name.startswith(name) and (
                name.startswith(".") or not path.name.startswith(".")
            ):
                yield f"{before}{folder}{slash}{path.name}{'/' if path.is_dir() else ''}", ""
