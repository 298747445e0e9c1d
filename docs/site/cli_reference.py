"""The site's page cli.md, from the program itself: the options of each command, and the keys of `sucre-bench run`.

mkdocs calls `on_files` by its name.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING
from typing import Any

import click
from mkdocs.structure.files import File, Files

from sucre_bench.cli import SECTIONS, cli
from sucre_bench.jobs.run_options import RunConfig, Shard, Tracking
from sucre_bench.plugins.options import options_of

_GROUPS: dict[str, type[Any]] = {"shard": Shard, "tracking": Tracking}
_HEAD = """\
# Commands

Each command with its options, and every key of `sucre-bench run`. Examples stand in the `--help` of each command.

These options mean the same in every command that has them:

| option | what it does |
|---|---|
| `--help` | Show the help and exit. |
| `--json` | Print one [JSON value](json.md) on stdout and nothing else, for programs. |
| `--plugin FILE` | Load the plugins of this .py file; may be repeated. |
| `--force` | Write over a file that sucre-bench did not write. |
"""
_PIPE = r"\|"  # within a cell of a table
_EVERYWHERE = ("--help", "--json", "--plugin", "--force")


def on_files(files: Files, config: Any) -> Files:
    """Add the page."""
    page = "\n".join([_HEAD, *_commands(), *_keys()]).rstrip() + "\n"
    files.append(File.generated(config, "cli.md", content=page))
    return files


def _commands() -> Iterator[str]:
    context = click.Context(cli, info_name="sucre-bench")
    for title, names in SECTIONS.items():
        yield f"## {title}\n"
        for name in names:
            command = cli.get_command(context, name)
            assert command is not None
            own = click.Context(command, info_name=name, parent=context)
            first = (command.help or "").partition("\b\n")[0]
            arguments = " ".join(command.collect_usage_pieces(own)[1:])
            yield f"### {name}\n\n`{f'sucre-bench {name} {arguments}'.rstrip()}`: {' '.join(first.split())}\n"
            yield from _options(command, own)


def _options(command: click.Command, context: click.Context) -> Iterator[str]:
    records = [
        record
        for one in command.get_params(context)
        if (record := one.get_help_record(context))
    ]
    rows = [
        (name, text) for name, text in records if text and name.split()[0] not in _EVERYWHERE
    ]
    if rows:
        yield "| option | what it does |\n|---|---|"
        for name, text in rows:
            cells = (f"`{name}`", " ".join(text.split()))
            yield f"| {' | '.join(cell.replace('|', _PIPE) for cell in cells)} |"
        yield ""


def _keys() -> Iterator[str]:
    yield "## Keys of `sucre-bench run`\n"
    yield "`dataset=`, `method=` and `metrics=` choose plugins; `sucre-bench list` has their options.\n"
    yield "The keys of `degrade.` have [a page](degrade.md). Those of `study.` have "
    yield "[a section](run.md#tables-figures-and-curves). The others:\n"
    yield "| key | default | what it does |\n|---|---|---|"
    for option in options_of(RunConfig):
        if option.name not in ("dataset", "method", "metrics", "study", "degrade", *_GROUPS):
            yield _row(option.name, option)
    for group, of in _GROUPS.items():
        for option in options_of(of):
            yield _row(f"{group}.{option.name}", option)


def _row(name: str, option: Any) -> str:
    default = "" if option.default is MISSING else _shown(option.default)
    choices = (
        f" One of {', '.join(f'`{choice}`' for choice in option.choices)}."
        if option.choices
        else ""
    )
    return f"| `{name}` | {default} | {(option.help + choices).strip()} |"


def _shown(value: Any) -> str:
    text = (
        "null"
        if value is None
        else str(value).lower()
        if isinstance(value, bool)
        else str(value)
    )
    return f"`{text}`" if text else ""
