"""`sucre-bench describe`: describes a dataset and lists its faults."""

from __future__ import annotations

from pathlib import Path

import click

from sucre_bench.commands import completion_words
from sucre_bench.commands.common import json_option, plugin_option, refuse_options

_SUFFIXES = (".png", ".jpg", ".jpeg")


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument(
    "words",
    nargs=-1,
    type=click.UNPROCESSED,
    metavar="[DATASET|FOLDER] [KEY=VALUE]...",
    shell_complete=completion_words.complete_datasets,
)
@json_option
@click.option(
    "--sheet",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Where to write the contact sheet, .png or .jpg [default: SCENE-sheet.png]",
)
@click.option("--no-sheet", is_flag=True, help="Write no contact sheet.")
@click.option(
    "--most",
    default=400,
    show_default=True,
    type=click.IntRange(1),
    help="Describe at most this many views of a scene, evenly spread.",
)
@plugin_option
def describe(
    words: tuple[str, ...],
    as_json: bool,
    sheet: Path | None,
    no_sheet: bool,
    most: int,
) -> None:
    """Describe what a dataset holds, write a contact sheet, and list faults with their remedies.

    \b
    sucre-bench describe ./dive
    sucre-bench describe colmap dataset.root=dive/
    sucre-bench describe dataset=demo dataset.water=turbid every=4 --json

    The command recognises a folder by its files. It takes these words of `sucre-bench run`: dataset= and its options,
    views=, every=, first= and degrade.

    Exit codes: 0, at least one view was read; 2, no view could be read, or the command has a mistake.
    """
    from sucre_bench.engine.tasks import select
    from sucre_bench.errors import InputError
    from sucre_bench.machine import terminal
    from sucre_bench.machine.files import write_atomically
    from sucre_bench.programs.describe import description
    from sucre_bench.programs.describe.scale_note import noted_scale
    from sucre_bench.results import layout

    suffix = ".png" if sheet is None else sheet.suffix
    if sheet is not None and sheet.is_dir():
        raise InputError(f"{sheet}: is a folder; give --sheet a file, for example {sheet / 'sheet.png'}")
    if suffix.lower() not in _SUFFIXES:
        raise InputError(f"{sheet}: has no suffix of a picture; end it in {', '.join(_SUFFIXES)}")
    refuse_options(words, "describe")
    overrides = [word if "=" in word else f"dataset={word}" for word in words]
    with terminal.live():
        selections = select(overrides)
        described = [description.described(s.dataset.label, s.scene, s.views, most, noted_scale(s)) for s in selections]
    if as_json:
        click.echo(description.as_json(described))
    for one in described:
        if not as_json:
            description.show(one)
        if not no_sheet:
            name = f"{layout.file_name(one.name)}-sheet{suffix}"
            file_name = Path(name) if sheet is None else sheet if len(described) == 1 else sheet.with_name(name)
            write_atomically(file_name, one.sheet(suffix))
            click.echo(f"sheet    {file_name}", err=as_json)
    if not any(view.mean for one in described for view in one.facts):
        raise InputError("describe: no view could be read; mend the files named above")
