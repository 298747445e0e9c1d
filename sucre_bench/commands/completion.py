"""`sucre-bench completion`: prints the scripts by which shells complete commands, and answers what they ask.

A shell asks by `_SUCRE_BENCH_COMPLETE=SHELL_complete`, with the line up to the cursor in COMP_LINE; the answer is a
line a word. The scripts are of our own because click's part words at "=" (bash) or "," (fish). They also put a space
behind "method=", and complete no path behind "=". The words of `run` (key=value) come from the options of plugins.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import click
from click.shell_completion import CompletionItem, ShellComplete, add_completion_class

from sucre_bench.errors import SucreBenchError
from sucre_bench.machine.files import expanded

if TYPE_CHECKING:
    from sucre_bench.plugins.options import Option

_OPEN = ("=", ".", "/")  # the end of a word that goes on


class _Shell(ShellComplete):
    def get_completion_args(self) -> tuple[list[str], str]:
        """Return the words after the program's name, and the unfinished one."""
        words, incomplete = _split(os.environ.get("COMP_LINE", ""))
        starts = (n for n, word in enumerate(words) if Path(word).name == self.prog_name)
        return words[next(starts, 0) + 1 :], incomplete

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem[str]]:
        """Return click's completions, and the files that click leaves to the shells."""
        found: list[CompletionItem[str]] = []
        for item in super().get_completions(args, incomplete):
            is_place = item.type in ("file", "dir")
            found += places(item.value, item.type == "dir") if is_place else [item]
        return found

    def format_completion(self, item: CompletionItem[str]) -> str:
        """Return "open" or "plain" (a space follows), the word and its meaning, with tabs between them."""
        return f"{'open' if item.value.endswith(_OPEN) else 'plain'}\t{item.value}\t{_line(item)}"


class _Bash(_Shell):
    """Bash splits words at "=" and ":". COMP_WORD is the part after it; the text before it is left out."""

    name = "bash"
    source_template = """\
%(complete_func)s() {
    local kind value help
    COMPREPLY=()
    while IFS=$'\\t' read -r kind value help; do
        COMPREPLY+=("$value")
        if [[ $kind == open ]]; then compopt -o nospace 2>/dev/null; fi
    done < <(%(complete_var)s=bash_complete COMP_LINE="${COMP_LINE:0:COMP_POINT}" COMP_WORD="$2" "$1" 2>/dev/null)
}
complete -o nosort -F %(complete_func)s %(prog_name)s
"""

    def format_completion(self, item: CompletionItem[str]) -> str:
        word = os.environ.get("COMP_WORD", "")
        is_quoted, (_, typed) = word[:1] in ("'", '"'), _split(word)
        before = len(self.get_completion_args()[1]) - len(typed)
        text = item.value[before:]
        safe = text if is_quoted else re.sub(r"([\s'\"\\$`&|;<>()*?!#])", r"\\\1", text)
        return super().format_completion(CompletionItem(safe, help=item.help))


class _Zsh(_Shell):
    name = "zsh"
    source_template = """\
#compdef %(prog_name)s
%(complete_func)s() {
    local kind value help
    local -a plain plain_said open open_said
    while IFS=$'\\t' read -r kind value help; do
        if [[ $kind == open ]]; then
            open+=("$value"); open_said+=("$value${help:+  -- $help}")
        else
            plain+=("$value"); plain_said+=("$value${help:+  -- $help}")
        fi
    done < <(%(complete_var)s=zsh_complete COMP_LINE="${words[1,CURRENT-1]} $PREFIX" ${words[1]} 2>/dev/null)
    (( $#plain )) && compadd -U -V words -l -d plain_said -a plain
    (( $#open )) && compadd -U -V words -S '' -l -d open_said -a open
    return 0
}
if [[ $zsh_eval_context[-1] == loadautofunc ]]; then
    %(complete_func)s "$@"
else
    compdef %(complete_func)s %(prog_name)s
fi
"""


class _Fish(_Shell):
    """Fish itself knows that a word goes on behind "=", "." and "/"."""

    name = "fish"
    source_template = """\
function %(complete_func)s
    %(complete_var)s=fish_complete COMP_LINE=(commandline -cp | string collect) %(prog_name)s 2>/dev/null
end
complete --no-files --keep-order --command %(prog_name)s --arguments "(%(complete_func)s)"
"""

    def format_completion(self, item: CompletionItem[str]) -> str:
        return f"{item.value}\t{_line(item)}"


SHELLS: Mapping[str, type[_Shell]] = {"bash": _Bash, "zsh": _Zsh, "fish": _Fish}


def install() -> None:
    """Let click answer the shells by these, not by its own."""
    for name, shell in SHELLS.items():
        add_completion_class(shell, name)


@click.command("completion")
@click.argument("shell", type=click.Choice(list(SHELLS)))
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
    command = click.get_current_context().find_root().command
    click.echo(SHELLS[shell](command, {}, "sucre-bench", "_SUCRE_BENCH_COMPLETE").source(), nl=False)


def _split(line: str) -> tuple[list[str], str]:
    """The whole words of a line as shells read them, and the last one, which may be empty or in an open quote."""
    lexer = shlex.shlex(line, posix=True)
    lexer.whitespace_split, lexer.commenters = True, ""
    words: list[str] = []
    try:
        words.extend(lexer)
    except ValueError:  # an open quote, or a backslash at the end
        return words, lexer.token
    return (words, "") if not words or line[-1:].isspace() else (words[:-1], words[-1])


def _line(item: CompletionItem[str]) -> str:
    return " ".join((item.help or "").split())


# -- the words of run, describe, charts, check, score and compare ----------------------------------------------

# Words of `sucre-bench run` whose values are these alone; booleans are known by their type.
_VALUES = {"hydra/launcher": ("joblib", "slurm")}


def complete_words(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete an override: its key, or its value, given the words before it."""
    from sucre_bench.jobs.lineup import KINDS
    from sucre_bench.jobs.run_options import RunConfig

    before = ctx.params.get(param.name or "") or ()
    given = dict(word.partition("=")[::2] for word in before if "=" in word)
    line_up = [word for word in before if "=" not in word]
    given |= {"": line_up[0]} if line_up else {}
    key, equals, value = incomplete.partition("=")
    group, _, name = key.rpartition(".")
    if not equals and group:
        return list(_starting(incomplete, ((f"{group}.{o.name}=", o.help) for o in _options(group, given))))
    if not equals:
        groups = ["dataset", "method", "metrics", "degrade", "shard", "tracking"]
        groups += [name for kind in KINDS if kind in given or "" in given for name in _chosen(kind, given)]
        plain = (f.name for f in fields(RunConfig) if f.name not in (*groups, "study"))
        keys = [f"{name}=" for name in ("dataset", "method", "metrics", "experiment", *plain, *_VALUES)]
        return list(_starting(incomplete, ((word, "") for word in (*keys, *(f"{name}." for name in groups)))))
    if key in ("dataset", "method", "experiment", "metrics", "baseline"):
        return list(_named(key, value, given))
    head, option = f"{key}=", next((option for option in _options(group, given) if option.name == name), None)
    words, kinds = [*_VALUES.get(key, ())], tuple[Any, ...]()
    if option is not None:
        kinds = (option.type, *get_args(option.type))
        words += [*option.choices, *(("true", "false") if bool in kinds else ())]
        words += ["null"] if type(None) in kinds else []
        if not words and option.default is not MISSING and isinstance(option.default, (int, float)):
            words.append(str(option.default))
    opening, before_last, last = _parts(value)
    found = list(_starting(last, ((word, "") for word in words), f"{head}{opening}{before_last}"))
    if key in ("out", "views") or Path in kinds:
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
    bracket, before_last, last = _parts(value)
    head = f"{key}={bracket}{before_last}"
    if key == "dataset" and (last.startswith(".") or "/" in last):
        yield from places(last, folders_only=True, prefix=head)
        return
    if key == "baseline":
        yield from _starting(last, ((name, "") for name in _chosen("method", given)), head)
        return
    is_list, taken = key == "metrics", set(before_last.split(","))
    known = _metrics(last) if is_list else _names(key)
    names = [(name, said) for name, said in known if name not in taken]
    opens = is_list and not bracket and ":" not in last  # bash completes only what follows the colon
    yield from _starting(last, names, f"{key}=[" if opens else head, "]" if opens or bracket else "")


def _parts(value: str) -> tuple[str, str, str]:
    """A value's opening bracket, what stands before its last word, and that word: each may be empty."""
    bracket = value[: value.startswith("[")]
    before, comma, last = value[len(bracket) :].rpartition(",")
    return bracket, before + comma, last


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
    return list(_starting(last, _metrics(last), before + comma))


def _metrics(start: str) -> Iterator[tuple[str, str]]:
    """The metrics with what they are; behind a colon the variants of one, with what sets each apart."""
    from sucre_bench.jobs.catalogue import plugin_of

    name, colon, _ = start.partition(":")
    if not colon:
        yield from _names("metrics")
    elif plugin := plugin_of("metric", name):
        variants = {**plugin.variants, "all": "every variant"}
        yield from ((f"{name}:{variant}", said) for variant, said in variants.items())


def _starting(
    start: str, words: Iterable[tuple[str, str]], before: str = "", after: str = ""
) -> Iterator[CompletionItem[str]]:
    for word, said in words:
        if word.startswith(start):
            yield CompletionItem(f"{before}{word}{after}", help=said)


def _names(group: str) -> Iterator[tuple[str, str]]:
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
