"""`sucre-bench site`: writes one page over many bundles."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sucre_bench.commands.output_files import check_output
from sucre_bench.commands.shared_options import plugin_option
from sucre_bench.errors import InputError
from sucre_bench.machine.files import check_folder, open_atomically
from sucre_bench.machine.notices import say
from sucre_bench.machine.plural import counted

if TYPE_CHECKING:
    from sucre_bench.programs.site.board import Entry


@click.command()
@click.argument("bundles", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--title", "heading", default="Restoration of underwater images", show_default=True, help="Title of the page."
)
@click.option("--data", "data", multiple=True, metavar="DATASET=DIR", help="Folder of the data; may be repeated.")
@plugin_option
def site(bundles: Path, out: Path, heading: str, data: Sequence[str]) -> None:
    """Write a lab's board: a page of tables over all bundles of a folder.

    \b
    sucre-bench site bundles/ public/
    sucre-bench site bundles/ public/ --title "Reef Lab" --data reef=dive/

    The command verifies each bundle first. One table has one dataset with the same images, and one variant and version
    of each metric. Results that do not fit get a table of their own, with the reason. The page names a bundle that
    differs from its hashes or scores, and puts it into no table.

    Exit codes: 0, all bundles are in tables; 1, a bundle differs; 2, the folder has no bundle.
    """
    from sucre_bench.machine import progress_display
    from sucre_bench.programs.site.board import State, board
    from sucre_bench.programs.site.page import write_page

    _check_folders(data)
    paths = sorted(bundles.glob("*.zip"))
    if not paths:
        raise InputError(f"{bundles}: holds no bundle; give a folder of files that `sucre-bench bundle` wrote")
    check_output(out / "index.html", "page")
    with progress_display.live():
        entries = [_entry(path, data) for path in paths]
        made = board(entries)
    _note_unknown(data, entries)
    page = write_page(out, made, heading)
    for entry in entries:
        if entry.rows is not None:
            _copy(bundles / entry.file, out / "bundles" / entry.file)
        colour = {State.VERIFIED: "green", State.PARTLY: "green", State.HASHES: "yellow", State.DIFFERS: "red"}[
            entry.state
        ]
        say(f"{entry.check:20} {entry.file}{': ' if entry.fault else ''}{entry.fault}", colour)
    click.echo(f"page     {page}: {counted(len(made.tables), 'table')} of {counted(len(entries), 'bundle')}")
    sys.exit(1 if any(entry.state is State.DIFFERS for entry in entries) else 0)


def _check_folders(data: Sequence[str]) -> None:
    for text in data:
        label, _, folder = text.rpartition("=")
        if not label:
            raise InputError(f"--data {text}: names no dataset; write DATASET=DIR")
        check_folder(Path(folder), "give the folder of the data")


def _note_unknown(data: Sequence[str], entries: Sequence[Entry]) -> None:
    known = sorted({str(name) for entry in entries if entry.rows is not None for name in entry.rows["dataset"]})
    for label in (text.rpartition("=")[0] for text in data):
        if label not in known:
            say(f"note: --data {label}=...: no bundle has this dataset; they have {', '.join(known)}", "yellow")


def _entry(path: Path, data: Sequence[str]) -> Entry:
    """Verify a bundle. A file that is none is an entry, too, with the reason."""
    from sucre_bench.commands.verify import data_folders
    from sucre_bench.programs.site.board import Entry, State
    from sucre_bench.programs.verify.verify_bundle import verify
    from sucre_bench.results.bundle_format import open_bundle

    try:
        with open_bundle(path) as bundle:
            datasets = set(bundle.rows["dataset"])
            given = [text for text in data if text.rpartition("=")[0] in datasets]
            found = verify(bundle, data_folders(datasets, given))
            rows, version = bundle.rows, bundle.version
            common = bundle.common if found.holds else None
    except InputError as fault:
        return Entry(path.name, "", "", "", State.DIFFERS, (0, 0), fault.beside(path), None)
    state = State.VERIFIED if found.is_whole else State.PARTLY if found.n_agree else State.HASHES
    faults = [*found.faults, *(f"{one.method} / {one.view} / {one.metric}" for one in found.differing)]
    more = f" and {len(faults) - 1} more" if len(faults) > 1 else ""
    fault_text = f"{faults[0]}{more}" if faults else ""
    state = state if found.holds else State.DIFFERS
    return Entry(
        path.name, found.id, found.by, version, state, (found.n_agree, found.n_scores), fault_text, rows, common
    )


def _copy(source: Path, target: Path) -> None:
    if not (target.exists() and target.samefile(source)):
        with source.open("rb") as content, open_atomically(target) as file:
            shutil.copyfileobj(content, file)
