"""Completion in the shell: commands and options as click knows them, words (key=value) as the plugins define them.

A shell asks by `_SUCRE_BENCH_COMPLETE=SHELL_complete`, with the line up to the cursor in COMP_LINE; the answer is a
line a word. The scripts are of our own because click's part what is typed at "=" (bash) or "," (fish), put a space
behind "method=", and complete no path behind "=".
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from click.shell_completion import CompletionItem, ShellComplete, add_completion_class

if TYPE_CHECKING:
    import click

    from sucre_bench.options import Option

__all__ = ["SHELLS", "complete_datasets", "complete_metrics", "complete_views", "complete_words", "install", "script"]

_VARIABLE, _PROGRAM = "_SUCRE_BENCH_COMPLETE", "sucre-bench"
_OPEN = ("=", ".", "/")  # the end of a word that goes on
# Words of `sucre-bench run` whose values are these alone; booleans are known by their type.
_VALUES = {
    "overwrite": ("missing", "always", "never"),
    "save": ("display", "full"),
    "hydra/launcher": ("joblib", "slurm"),
}


# -- what shells are told ------------------------------------------------------------------------------------


class _Shell(ShellComplete):
    def get_completion_args(self) -> tuple[list[str], str]:
        """Return the words after the program's name, and the one that is being written."""
        import os

        words, incomplete = _split(os.environ.get("COMP_LINE", ""))
        starts = (n for n, word in enumerate(words) if Path(word).name == self.prog_name)
        return words[next(starts, 0) + 1 :], incomplete

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem[str]]:
        """As click finds them, with the files that it leaves to the shells."""
        found: list[CompletionItem[str]] = []
        for item in super().get_completions(args, incomplete):
            is_place = item.type in ("file", "dir")
            found += _places(item.value, item.type == "dir") if is_place else [item]
        return found

    def format_completion(self, item: CompletionItem[str]) -> str:
        """Return "open" or "plain" (with a space behind it), the word and what it means, parted by tabs."""
        return f"{'open' if item.value.endswith(_OPEN) else 'plain'}\t{item.value}\t{_line(item)}"


class _Bash(_Shell):
    """Bash takes for a word what follows "=" or ":"; COMP_WORD is that, and what stands before it is left out."""

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
        import os

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


def script(shell: str, cli: click.Command) -> str:
    """Return what a shell is to read at its start."""
    return SHELLS[shell](cli, {}, _PROGRAM, _VARIABLE).source()


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


# -- words ---------------------------------------------------------------------------------------------------


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
        found += _places(value, prefix=head)
    return found


def complete_datasets(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete as `complete_words`, and a dataset's bare name before all else."""
    named = () if ctx.params.get(param.name or "") or "=" in incomplete else _names("dataset")
    return [*_starting(incomplete, named), *complete_words(ctx, param, incomplete)]


def complete_views(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem[str]]:
    """Complete as `complete_words`, and else the path of an image."""
    return [*complete_words(ctx, param, incomplete), *([] if "=" in incomplete else _places(incomplete))]


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
    from sucre_bench.job import RunConfig

    if group:
        yield from ((f"{group}.{option.name}=", option.help) for option in _options(group, given))
        return
    groups = ("dataset", "method", "metrics", "degrade", "shard", "tracking")
    plain = (f.name for f in fields(RunConfig) if f.name not in (*groups, "swept", "sharing", "study"))
    yield from ((f"{name}=", "") for name in ("dataset", "method", "metrics", "experiment", *plain, *_VALUES))
    yield from ((f"{name}.", "") for name in groups)


def _names(group: str) -> Iterator[tuple[str, str]]:
    """Plugins and presets, or experiments, with what they are."""
    from sucre_bench import plugins
    from sucre_bench.mistakes import GROUPS
    from sucre_bench.plugins import Plugin

    if group in GROUPS:
        for name, plugin in plugins.discover(GROUPS[group]).items():
            if isinstance(plugin, Plugin):
                yield name, plugin.summary
    for path in _presets(group):
        yield path.stem, ""


def _presets(group: str) -> list[Path]:
    return sorted((Path(__file__).parent / "conf" / group).glob("*.yaml"))


def _plugin(group: str, name: str) -> Any:
    """A group's plugin of this name, or that a preset of this name is of; None where there is none."""
    from sucre_bench import plugins
    from sucre_bench.mistakes import GROUPS
    from sucre_bench.plugins import Plugin

    known = plugins.discover(GROUPS[group])
    if name not in known:
        texts = [path.read_text(encoding="utf-8") for path in _presets(group) if path.stem == name]
        name = next((base for text in texts for base in re.findall(r"^ +- (\w+)$", text, re.M) if base in known), name)
    plugin = known.get(name)
    return plugin if isinstance(plugin, Plugin) else None


def _options(group: str, given: Mapping[str, str]) -> tuple[Option, ...]:
    """The options of the method, dataset or metric that was chosen before (the first of several), or of the engine."""
    from sucre_bench.degrade import Degradation
    from sucre_bench.job import Shard, Tracking
    from sucre_bench.options import options_of

    engine = {"degrade": Degradation, "shard": Shard, "tracking": Tracking}
    if group in engine:
        return options_of(engine[group])
    kind, _, name = group.partition(".")
    if kind in ("dataset", "method") and not name:
        name = given.get(kind, _by_default(kind)).split(",")[0]
    elif kind != "metrics":
        return ()
    plugin = _plugin(kind, name)
    return options_of(plugin.cls) if plugin else ()


def _by_default(kind: str) -> str:
    """What the configuration chooses where nothing is chosen."""
    chosen = (Path(__file__).parent / "conf" / "config.yaml").read_text(encoding="utf-8")
    found = re.search(rf"^  - {kind}: (\w+)$", chosen, re.M)
    return found[1] if found else ""


def _option(key: str, given: Mapping[str, str]) -> Option | None:
    group, _, name = key.rpartition(".")
    own = _options(group, given) if group else _top()
    return next((option for option in own if option.name == name), None)


def _top() -> tuple[Option, ...]:
    from sucre_bench.job import RunConfig
    from sucre_bench.options import options_of

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


def _places(start: str, folders_only: bool = False, prefix: str = "") -> list[CompletionItem[str]]:
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
