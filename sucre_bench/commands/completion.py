"""`sucre-bench completion`: prints the scripts by which shells complete commands.

A shell asks by `_SUCRE_BENCH_COMPLETE=SHELL_complete`, with the line up to the cursor in COMP_LINE; the answer is a
line a word. The scripts are of our own because click's part what is typed at "=" (bash) or "," (fish), put a space
behind "method=", and complete no path behind "=".
"""

import os
import re
import shlex
from collections.abc import Mapping
from pathlib import Path

import click
from click.shell_completion import CompletionItem, ShellComplete, add_completion_class

from sucre_bench.commands.completion_words import places

_VARIABLE, _PROGRAM = "_SUCRE_BENCH_COMPLETE", "sucre-bench"
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
    click.echo(script(shell, click.get_current_context().find_root().command), nl=False)


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
