"""The command line: sections of commands, each imported when it is called; exit codes; one-line errors."""

import errno
import io
import os
import re
import sys
from importlib import import_module

import click

from sucre_bench.errors import SucreBenchError, did_you_mean, escaped_breaks, is_utf8, shortened
from sucre_bench.machine.terminal import say

_BROKEN_PIPE = 141  # what a shell says of a process that SIGPIPE ended
_MEMORY = "there is not enough memory; end other programs, or give smaller images (dataset.image_scale)"
# Numbers of errors of writing into a file, which do not name it.
_OF_FILES = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


def main() -> None:
    """Run the command line and exit: 2 with one line on stderr for an expected fault, 130 after Ctrl-C."""
    # pyarrow's own allocator keeps much of what it has freed: 50 MB more for a table of 90,000 rows.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    # else a damaged image costs ten lines more
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # a letter that the locale lacks is a question mark
            stream.reconfigure(errors="replace")
    try:
        status = _status()
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader of the output, such as `head`, has closed it. The rest of the buffer goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = _BROKEN_PIPE
    sys.exit(status)


def _status() -> int:
    """Run the command line and return its exit code."""
    wrong = _unusable()
    if wrong:
        return _fault(wrong, 2)
    stdout = sys.stdout
    try:
        # No Python that a library starts imports a json.py of the current folder.
        os.environ.setdefault("PYTHONSAFEPATH", "1")
        cli(prog_name="sucre-bench", standalone_mode=False)
    except SystemExit as ended:
        if sys.stdout is not stdout:
            # click put another there, for it found that the reader of the pipe has gone
            return _BROKEN_PIPE
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except click.exceptions.NoArgsIsHelpError as fault:
        click.echo(fault.format_message())
    except click.exceptions.Exit as ended:
        return ended.exit_code
    except click.ClickException as fault:
        return _fault(_wrong_words(fault), fault.exit_code)
    except SucreBenchError as fault:
        return _fault(str(fault), 2)
    except MemoryError:
        return _fault(_MEMORY, 1)
    except ImportError as fault:
        if (fault.name or "").startswith("sucre_bench"):
            # ours, or a plugin file's: a fault of the code
            raise
        text = " ".join(str(fault).split())
        remedy = "install that package again, or mend the plugin that imports it"
        return _fault(f"a Python package does not import: {text}; {remedy}", 1)
    except (click.exceptions.Abort, KeyboardInterrupt) as stopped:
        # click makes an Abort of an interrupt
        say(str(stopped.__cause__ or stopped) or "stopped", "yellow")
        return 130
    except Exception as fault:
        cause: BaseException | None = fault
        while cause and not isinstance(cause, KeyboardInterrupt):
            cause = cause.__cause__ or cause.__context__
        if cause:  # a library made another error of an interrupt
            say("stopped", "yellow")
            return 130
        if isinstance(fault, OSError) and fault.errno == errno.ENOMEM:
            return _fault(_MEMORY, 1)
        text = _wrong_path(fault)
        if not text:
            raise
        return _fault(text, 2)
    return 0


def _wrong_words(fault: click.ClickException) -> str:
    """What click says is wrong with the command, with what to do."""
    text = " ".join(fault.format_message().split())
    if isinstance(fault, click.NoSuchOption):
        key = fault.option_name.lstrip("-")
        if key.partition(".")[0] in _keys_of_run(fault.ctx):
            text = f"no option {fault.option_name}; write {key}=VALUE"
    if isinstance(fault, click.UsageError) and not re.search(r"; |\?$", text):
        command = fault.ctx.command_path if fault.ctx else "sucre-bench COMMAND"
        text = f"{text.rstrip('.')}; see `{command} --help`"
    return text


def _wrong_path(fault: Exception) -> str:
    """What the system says is wrong with a path, with what to do; empty for a fault of the code."""
    if loop := re.fullmatch("Symlink loop from '(.*)'", str(fault)):
        # what Path.resolve raises before Python 3.13
        return f"{escaped_breaks(loop[1])}: links to itself; remove that link, or give another path"
    if not isinstance(fault, OSError):
        return ""
    if fault.filename is None and fault.errno not in _OF_FILES:
        return ""
    path = "a file" if fault.filename is None else os.fsdecode(fault.filename)
    reason = fault.strerror or type(fault).__name__  # of a path that no file system has, say
    return f"{escaped_breaks(path)}: {reason}; give another path, or make this one usable"


def _unusable() -> str:
    """What is wrong with the current folder, or with a word of the command; empty if nothing is."""
    try:
        os.getcwd()  # noqa: PTH109 - numerous libraries ask for it
    except OSError as fault:
        return f"the current folder: {fault.strerror}; go to another one, for example `cd ~`"
    wrong = [word for word in sys.argv if not is_utf8(word)]
    return f"{wrong[0]}: is no UTF-8; rename the file or folder" if wrong else ""


def _keys_of_run(context: click.Context | None) -> set[str]:
    """The keys of `sucre-bench run`, if a command takes them as words."""
    if context is None or not any(
        parameter.type is click.UNPROCESSED for parameter in context.command.params
    ):
        return set()
    from sucre_bench.jobs.run_options import RunConfig

    return {"experiment", *RunConfig.defaults()}


def _fault(text: str, status: int) -> int:
    for line in text.split("\n"):
        say(f"error: {shortened(escaped_breaks(line))}", "red")
    return status


# The table of contents of --help: each command with its module and its line of help. Its module is imported when it is
# called.
SECTIONS: dict[str, dict[str, tuple[str, str]]] = {
    "Is this number comparable?": {
        "score": ("score", "Score a folder of images with any published metric."),
    },
    "Restore my dive": {
        "restore": (
            "restore",
            "Restore photographs for use: whole pictures with EXIF and GPS.",
        ),
        "prepare": ("prepare", "Make a scene of photos: cameras, depth maps."),
        "describe": ("data", "Describe what a dataset holds, and list its faults."),
    },
    "Which method is better, by how much, is it chance?": {
        "run": ("run", "Restore views of a dataset with methods, and score them."),
        "compare": ("compare", "Compare methods: one table, and who leads."),
        "report": ("look", "Write the page of a results folder: tables, pictures."),
        "charts": ("data", "Mark colour charts on a page in your browser."),
        "study": ("study", "Ask people which restored images they prefer."),
    },
    "Share results": {
        "bundle": ("share", "Write a results folder as one file, with hashes."),
        "verify": ("share", "Check a bundle: hashes, data, scores."),
        "track": ("look", "Log in mlflow what it lacks of a results folder."),
    },
    "Add methods, metrics and datasets": {
        "list": ("extend", "List plugins, their options, and whether they run here."),
        "new": ("extend", "Write a working plugin to start from, and its test."),
        "check": ("extend", "Check whether a plugin keeps the contract."),
    },
    "This machine": {
        "doctor": ("doctor", "List what works on this machine, and what is missing."),
        "completion": ("completion", "Print the script for <TAB> completion in your shell."),
    },
}
_COMMANDS = {
    name: command for section in SECTIONS.values() for name, command in section.items()
}


class _LazyGroup(click.Group):
    """Lists commands by section, and imports a command when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            if ctx.resilient_parsing:
                return None  # a shell asks what a line may become
            return ctx.fail(
                f"no command is called '{cmd_name}'; {did_you_mean(cmd_name, _COMMANDS)}"
            )
        module = import_module(f"sucre_bench.commands.{_COMMANDS[cmd_name][0]}")
        command = getattr(module, "list_" if cmd_name == "list" else cmd_name)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        width = max(map(len, _COMMANDS))
        for title, commands in SECTIONS.items():
            formatter.write(f"\n{title}\n")
            with formatter.indentation():
                formatter.write_dl(
                    [(name.ljust(width), text) for name, (_, text) in commands.items()]
                )


@click.group(
    cls=_LazyGroup,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": 100,
        "color": True,
    },
)
@click.version_option(package_name="sucre-bench", prog_name="sucre-bench")
def cli() -> None:
    """Score, restore and compare underwater images.

    \b
    sucre-bench score restored/ --like published.csv   is this number comparable?
    sucre-bench restore photos/ restored/              restore my dive
    sucre-bench run -m dataset=demo method=underwater,gray_world,sucre out=results
    sucre-bench compare results                        which is better? chance?

    The --help of each command begins with examples.
    """
