"""`sucre-bench verify`: check a bundle."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Collection, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sucre_bench.commands.shared_options import echo_wrapped, json_option, plugin_option, print_json
from sucre_bench.errors import unknown_name
from sucre_bench.machine.files import check_folder
from sucre_bench.machine.notices import say
from sucre_bench.programs.verify import TOLERANCE

if TYPE_CHECKING:
    from sucre_bench.programs.verify.outcome import Outcome

_MOST = 20  # scores that are listed


@click.command()
@click.argument("file", type=click.Path(path_type=Path), metavar="FILE.zip")
@click.option("--data", "data", multiple=True, metavar="[DATASET=]DIR", help="Folder of the data; may be repeated.")
@click.option("--id", "wanted", default="", metavar="ID", help="The id that was published with the bundle.")
@click.option(
    "--tolerance",
    default=TOLERANCE,
    show_default=True,
    type=click.FloatRange(0, 1),
    help="How far a score may differ, as a share of the score.",
)
@json_option
@plugin_option
def verify(file: Path, data: Sequence[str], wanted: str, tolerance: float, as_json: bool) -> None:
    """Check a bundle: verify its hashes and its data, and compute its scores again.

    \b
    sucre-bench verify paper.zip
    sucre-bench verify paper.zip --data dive/ --id 0123456789abcdef

    The command computes scores from the pictures in the bundle (bundle --pictures restored). Scores that need depth,
    charts or a reference need --data too. It executes nothing in a bundle, and unpacks nothing onto the disk.

    Exit codes: 0, nothing differs; 1, something differs; 2, the file is no bundle.
    """
    from sucre_bench.machine import progress_display
    from sucre_bench.programs.verify import verify_bundle
    from sucre_bench.results.bundle_format import open_bundle

    with contextlib.redirect_stdout(sys.stderr), progress_display.live(), open_bundle(file) as bundle:
        datasets = set(bundle.rows["dataset"])
        found = verify_bundle.verify(bundle, data_folders(datasets, data), tolerance)
    is_other = bool(wanted) and wanted.strip().lower() != found.id
    if as_json:
        print_json(_as_object(found, is_other))
    else:
        if is_other:
            say(f"differs  the bundle's id is {found.id}, not {wanted}: it is not the one that was published", "red")
        _print(found, tolerance)
        if not data and found.needs_data:
            words = shlex.join(["sucre-bench", "verify", str(file), "--data", "DIR"])
            made = "; for the dataset demo, DIR may be any folder" if "demo" in datasets else ""
            echo_wrapped(f"more     {words}{made}", 9)
        echo_wrapped(_verdict(found, is_other))
    sys.exit(0 if found.holds and not is_other else 1)


def data_folders(labels: Collection[str], given: Sequence[str]) -> dict[str, Path]:
    """Return the folder of the data by dataset label. labels: of all datasets; given: "DIR" for all, "DATASET=DIR".

    Raises InputError for a folder that is not there, and for a label that no dataset has.
    """
    folders: dict[str, Path] = {}
    for text in given:
        label, equals, folder = text.rpartition("=")
        if label in labels:
            given_folders = {label: Path(folder)}
        elif equals and not Path(text).is_dir():
            raise unknown_name("--data", label, labels, "dataset")
        else:
            given_folders = dict.fromkeys(labels, Path(text))
        folders |= given_folders
        for place in given_folders.values():
            check_folder(place, "give the folder of the data")
    return folders


def _print(found: Outcome, tolerance: float) -> None:
    by = f" by {found.by}" if found.by else ""
    click.echo(f"bundle   {found.id}{by}")
    click.echo(f"files    {found.n_files} hashes checked")
    n_not = sum(found.unchecked.values())
    common = f" ({found.n_common} on common pixels)" if found.n_common else ""
    echo_wrapped(
        f"scores   {found.n_agree} computed again{common} agree within {100 * tolerance:g} % or 8-bit rounding, "
        f"{len(found.differing)} differ, {n_not} not computed again",
        9,
    )
    for reason, count in found.unchecked.items():
        click.echo(f"         {count}: {reason}")
    if found.other_versions:
        click.echo(f"note     other code of the metric here: {', '.join(found.other_versions)}")
    for fault in found.faults[:_MOST]:
        say(f"differs  {fault}", "red")
    for one in found.differing[:_MOST]:
        where = f"{one.dataset} / {one.method} / {one.view} / {one.metric} ({one.variant})"
        region = "" if one.region == "image" else f" {one.region}"
        region += " on common pixels" if one.pixels == "common" else ""
        say(f"differs  {where}{region}: {one.stored:.6g}, computed again {one.computed:.6g}", "red")
    more = len(found.faults[_MOST:]) + len(found.differing[_MOST:])
    if more:
        say(f"         and {more} more; --json lists all", "red")


def _verdict(found: Outcome, is_other: bool) -> str:
    if is_other or not found.holds:
        return "NOT verified: something differs"
    if found.is_whole:
        return "verified: every hash holds, every score was computed again and agrees"
    if found.n_agree:
        return f"in part: every hash holds, {found.n_agree} of {found.n_scores} scores were computed again and agree"
    return "hashes hold; no score could be computed again"


def _as_object(found: Outcome, is_other: bool) -> dict[str, object]:
    differing = [
        {k: (str(v) if isinstance(v, float) and v - v else v) for k, v in asdict(one).items()}
        for one in found.differing
    ]
    return {**asdict(found), "differing": differing, "holds": found.holds and not is_other}
