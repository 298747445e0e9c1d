"""`sucre-bench completion`: prints click's script for a shell, and completes the words of `sucre-bench run`.

Keys and names are completed; paths are left to the shell. Bash parts words at "=" and ":", and replaces the last part.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable, Iterator, Sequence

import click
from click.shell_completion import CompletionItem, get_completion_class

# What click's scripts lack, and what mends it.
_MENDS = {
    "-o nosort": "-o nosort -o nospace",  # a value follows "method="
    'COMP_WORDS="${COMP_WORDS[*]}" COMP_CWORD=$COMP_CWORD': (  # bash: the words as typed, and what is replaced
        """COMP_WORDS="${COMP_LINE:0:COMP_POINT}$([[ $2 ]] || echo "''")" COMP_CWORD=-1"""
        ' COMP_PART="$2"'
    ),
    "+=($value)": '+=("$value")',  # "[psnr" is no pattern for files
    'split ","': 'split -m 1 ","',  # fish: "[psi,psnr" is one word
}


@click.command("completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the script with which <TAB> completes commands, options, and the keys and names of key=value words.

    \b
    echo 'source <(sucre-bench completion bash)' >> ~/.bashrc
    echo 'source <(sucre-bench completion zsh)' >> ~/.zshrc
    sucre-bench completion fish > ~/.config/fish/completions/sucre-bench.fish

    Completion then works in every new shell that finds sucre-bench, for example after `source .venv/bin/activate`. For
    the current shell only: source <(sucre-bench completion bash). bash must be 4.4 or newer. In ~/.zshrc, put the line
    after compinit.
    """
    kind = get_completion_class(shell)
    assert kind is not None
    root = click.get_current_context().find_root().command
    script = kind(root, {}, "sucre-bench", "_SUCRE_BENCH_COMPLETE").source()
    for lacking, mended in _MENDS.items():
        script = script.replace(lacking, mended)
    click.echo(script)


def complete_words(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem[str]]:
    """Complete an override: its key, or the name that it chooses. What is neither may be a path.

    The first word of `describe` may be the bare name of a dataset.
    """
    from sucre_bench import plugins
    from sucre_bench.errors import SucreBenchError

    for file in ctx.params.get("plugin_files") or ():
        with contextlib.suppress(SucreBenchError):  # the command says what is wrong with it
            plugins.load_file(file)
    key, equals, value = incomplete.partition("=")
    words = ctx.params.get(param.name or "") or ()
    if equals:
        found = [f"{key}={name}" for name in _names(key, value)]
    else:
        found = [one for one in dict.fromkeys(_keys(key, words)) if one.startswith(key)]
        if ctx.info_name == "describe" and not words:
            found += _names("dataset", key)
    return _items(incomplete, found) or [CompletionItem(incomplete, type="file")]


def complete_metrics(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem[str]]:
    """Complete the last of several metrics parted by commas."""
    return _items(incomplete, _names("metrics", incomplete))


def _items(typed: str, found: Iterable[str]) -> list[CompletionItem[str]]:
    """The words as they go into the line: bash replaces the last part of what is typed."""
    part = os.environ.get("COMP_PART", typed).strip("'\"")
    head = typed.removesuffix(part)
    return [CompletionItem(word.removeprefix(head)) for word in found]


def _keys(typed: str, words: Sequence[str]) -> Iterator[str]:
    """The keys that a word may begin with; behind a dot the options of what stands before it. words: before it."""
    from sucre_bench.jobs import catalogue, hydra_configs
    from sucre_bench.jobs.run_options import OPTION_GROUPS, RunConfig

    options = RunConfig.defaults()
    chosen = hydra_configs.choices() | dict(word.partition("=")[::2] for word in words)
    group, dot, _ = typed.rpartition(".")
    if not dot:
        yield from (f"{name}=" for name in options if name not in (*OPTION_GROUPS, "study"))
        yield from ("experiment=", "hydra/launcher=", "hydra/sweeper=")
        yield from (f"{name}." for name in ("dataset", "method", "metrics", *OPTION_GROUPS))
    elif group in OPTION_GROUPS:
        yield from (f"{group}.{name}=" for name in options[group])
    for kind in catalogue.KINDS:
        for name in chosen[kind].split(","):
            if not dot:
                yield f"{name}."
            elif group in (kind, name):
                for option in catalogue.option_names(kind, name):
                    yield f"{group}.{option}="


def _names(group: str, value: str) -> list[str]:
    """The value with the last of its names completed: of plugins, presets and experiments."""
    from sucre_bench import plugins
    from sucre_bench.jobs import catalogue, hydra_configs

    last = re.split(r"[\[,]", value)[-1]
    before = value.removesuffix(last)
    known = [*hydra_configs.descriptions(group)]
    for kind, folder in catalogue.GROUPS.items():
        if folder == group:
            known = [*plugins.usable(kind), *known]
    taken = before.strip("[,").split(",")
    return [f"{before}{name}" for name in known if name.startswith(last) and name not in taken]
