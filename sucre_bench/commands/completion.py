"""`sucre-bench completion`: prints click's script for a shell, and completes the words of `sucre-bench run`.

Keys, names, paths, and the words that an option takes are completed. Bash parts words at "=" and ":", and replaces
the last part.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

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
    """Complete an override: its key, the words that it takes, or a path; or the path of an experiment or image.

    The first word of `describe` may be the bare name of a dataset.
    """
    from sucre_bench import plugins
    from sucre_bench.errors import SucreBenchError

    for file in ctx.params.get("plugin_files") or ():
        with contextlib.suppress(SucreBenchError):  # the command says what is wrong with it
            plugins.load_file(file)
    key, equals, value = incomplete.partition("=")
    words = ctx.params.get(param.name or "") or ()
    if not equals:
        named = _names("dataset", key) if ctx.info_name == "describe" and not words else []
        found = [*named, *(one for one in _keys(key, words) if one.startswith(key))]
        return _items(incomplete, found or _paths(key))
    options = [*_options(key, words)]
    known = [*_names(key, value), *(word for one in options for word in _values(one, value))]
    found = [f"{key}={name}" for name in dict.fromkeys(known)]
    if key in ("out", "views", "dataset") or any(Path in one.kinds for one in options):
        found += _paths(value, f"{key}=")
    return _items(incomplete, found)


def complete_metrics(
    ctx: click.Context, param: click.Parameter, incomplete: str
) -> list[CompletionItem[str]]:
    """Complete the last of several metrics parted by commas: its name, or its variant behind a colon."""
    return _items(incomplete, _names("metrics", incomplete))


def _items(typed: str, found: Iterable[str]) -> list[CompletionItem[str]]:
    """The words as they go into the line. Bash replaces the last part of what is typed, and escapes nothing."""
    part = os.environ.get("COMP_PART", typed)
    head = typed.removesuffix(part if typed.endswith(part) else "".join(split_arg_string(part)))
    is_bare = os.environ.get("COMP_QUOTE", "'") not in ("'", '"')
    special = r"([ \t'\"\\$`&|;<>()*?!#])" if is_bare else "()$^"
    return [CompletionItem(re.sub(special, r"\\\1", word.removeprefix(head))) for word in found]


def _keys(typed: str, words: Sequence[str]) -> Iterator[str]:
    """The keys that a word may begin with; behind a dot the options of what stands before it. words: before it."""
    from sucre_bench.jobs import catalogue
    from sucre_bench.jobs.run_options import OPTION_GROUPS, RunConfig

    chosen = _chosen(words)
    group, dot, _ = typed.rpartition(".")
    options = RunConfig.defaults()
    if not dot:
        yield from (f"{name}=" for name in options if name not in (*OPTION_GROUPS, "study"))
        yield from ("experiment=", "hydra/launcher=", "hydra/sweeper=")
        yield from (f"{name}." for name in (*chosen, "metrics", *OPTION_GROUPS))
        yield from (f"{name}." for names in chosen.values() for name in names)
    elif group in OPTION_GROUPS:
        yield from (f"{group}.{name}=" for name in options[group])
    for kind, names in chosen.items() if dot else ():
        owned = [catalogue.option_names(kind, name) for name in names if group in (kind, name)]
        yield from dict.fromkeys(f"{group}.{option}=" for known in owned for option in known)


def _chosen(words: Sequence[str]) -> dict[Literal["dataset", "method"], list[str]]:
    """The names of the datasets and methods that words choose, or that the configuration does."""
    from sucre_bench.jobs import hydra_configs

    given = hydra_configs.choices() | dict(word.partition("=")[::2] for word in words)
    return {"dataset": given["dataset"].split(","), "method": given["method"].split(",")}


def _options(key: str, words: Sequence[str]) -> Iterator[Option]:
    """The options that a key means: of the run, or of the datasets or methods that the words before it choose."""
    from sucre_bench.jobs import catalogue
    from sucre_bench.jobs.run_options import OPTION_GROUPS, RunConfig
    from sucre_bench.plugins.options import options_of

    group, _, name = key.rpartition(".")
    groups: dict[str, Any] = {"": RunConfig, **OPTION_GROUPS}
    if group in groups:
        owners = [groups[group]]
    else:
        chosen = _chosen(words).items()
        named = [(kind, one) for kind, names in chosen for one in names if group in (kind, one)]
        owners = [
            plugin.cls for plugin in itertools.starmap(catalogue.plugin_of, named) if plugin
        ]
    for owner in owners:
        yield from (option for option in options_of(owner) if option.name == name)


def _values(option: Option, value: str) -> Iterator[str]:
    """The value with the last of its words completed, if the option takes words, true or false."""
    last = value.rpartition(",")[2]
    words = (*option.choices, *(("true", "false") if bool in option.kinds else ()))
    before = value.removesuffix(last)
    taken = before.split(",")
    return (before + word for word in words if word.startswith(last) and word not in taken)


def _names(group: str, value: str) -> list[str]:
    """The value with the last of its names completed: of plugins, presets and experiments, or of Hydra.

    A metric's variant stands behind a colon.
    """
    from sucre_bench import plugins
    from sucre_bench.jobs import catalogue, hydra_configs

    last = re.split(r"[\[,]", value)[-1]
    before = value.removesuffix(last)
    kind = next((kind for kind, folder in catalogue.GROUPS.items() if folder == group), None)
    metric = plugins.get("metric", last.partition(":")[0]) if ":" in last else None
    if metric and kind == "metric":
        known = [f"{metric.name}:{variant}" for variant in (*metric.variants, "all")]
    elif group.startswith("hydra/"):
        known = hydra_configs.loader().get_group_options(group)
    else:
        known = [*(plugins.usable(kind) if kind else ()), *hydra_configs.descriptions(group)]
    taken = before.strip("[,").split(",")
    return [f"{before}{name}" for name in known if name.startswith(last) and name not in taken]


def _paths(start: str, before: str = "") -> Iterator[str]:
    """The files and folders whose path starts so, with a home folder's ~ kept as it is."""
    folder, slash, name = start.rpartition("/")
    with contextlib.suppress(OSError):
        for path in sorted(expanded(folder + slash or ".").iterdir()):
            is_wanted = path.name.startswith(name)
            if is_wanted and (name.startswith(".") or not path.name.startswith(".")):
                yield f"{before}{folder}{slash}{path.name}{'/' if path.is_dir() else ''}"
