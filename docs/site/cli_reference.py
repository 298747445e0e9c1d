"""Writes docs/cli.md from the program itself: the help of each command, and the keys of `sucre-bench run`.

python docs/site/cli_reference.py            write docs/cli.md
python docs/site/cli_reference.py --check    exit with 1 if docs/cli.md is not what this would write
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import MISSING
from pathlib import Path
from typing import Any

import click

from sucre_bench.cli import SECTIONS, cli
from sucre_bench.degrade import Degradation
from sucre_bench.jobs.run_options import RunConfig, Shard, Tracking
from sucre_bench.plugins.options import options_of

_PAGE = Path(__file__).parent.parent / "cli.md"
_WIDTH = 100
_GROUPS: dict[str, type[Any]] = {"shard": Shard, "tracking": Tracking, "degrade": Degradation}
_HEAD = """\
# Commands

This page has the help of every command, and every key of `sucre-bench run`. `python docs/site/cli_reference.py` writes
it; do not edit it by hand. [Running methods](run.md) explains the keys with examples.
"""


def reference() -> str:
    """Return the page as Markdown."""
    return "\n".join([_HEAD, *_commands(), *_keys()]).rstrip() + "\n"


def _commands() -> Iterator[str]:
    context = click.Context(cli, info_name="sucre-bench", max_content_width=_WIDTH, terminal_width=_WIDTH)
    for title, names in SECTIONS.items():
        yield f"## {title}\n"
        for name in names:
            command = cli.get_command(context, name)
            assert command is not None
            own = click.Context(command, info_name=name, parent=context, terminal_width=_WIDTH)
            yield f"### sucre-bench {name}\n\n```text\n{command.get_help(own)}\n```\n"


def _keys() -> Iterator[str]:
    yield "## Keys of `sucre-bench run`\n"
    yield "`dataset=`, `method=` and `metrics=` choose plugins; `sucre-bench list` has their options. The other keys:\n"
    yield "| key | default | what it does |\n|---|---|---|"
    for option in options_of(RunConfig):
        if option.name not in ("dataset", "method", "metrics", "study", *_GROUPS):
            yield _row(option.name, option)
    for group, of in _GROUPS.items():
        for option in options_of(of):
            yield _row(f"{group}.{option.name}", option)


def _row(name: str, option: Any) -> str:
    default = "" if option.default is MISSING else _shown(option.default)
    choices = f" One of {', '.join(f'`{choice}`' for choice in option.choices)}." if option.choices else ""
    return f"| `{name}` | {default} | {(option.help + choices).strip()} |"


def _shown(value: Any) -> str:
    text = "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
    return f"`{text}`" if text else ""


if __name__ == "__main__":
    if "--check" in sys.argv[1:]:
        if not _PAGE.is_file() or _PAGE.read_text(encoding="utf-8") != reference():
            sys.exit(f"{_PAGE}: is out of date; run python docs/site/cli_reference.py")
    else:
        _PAGE.write_text(reference(), encoding="utf-8")
