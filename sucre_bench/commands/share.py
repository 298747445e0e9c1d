"""`sucre-bench bundle` and `verify`: one file of a results folder, and its check."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Collection, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sucre_bench.commands import shared
from sucre_bench.errors import InputError, SucreBenchError, unknown_name
from sucre_bench.machine import progress, terminal
from sucre_bench.machine.files import check_folder, check_links, check_output
from sucre_bench.machine.terminal import say
from sucre_bench.programs.verify import TOLERANCE

if TYPE_CHECKING:
    from sucre_bench.programs.verify.verify_bundle import Outcome

_MOST = 20  # scores that are listed


# -- bundle ------------------------------------------------------------------------------------------------


@click.command()
@shared.argument("folder")
@shared.argument("file", metavar="FILE.zip")
@shared.option(
    "--pictures",
    of=("none", "restored", "all"),
    help="restored: put the restored images in; all: also views and references, if you may publish them.",
)
@shared.option(
    "--by", default="", metavar="TEXT", help='Who publishes the bundle, for example "Reef Lab".'
)
@shared.force_option
def bundle(folder: Path, file: Path, pictures: Any, by: str, force: bool) -> None:
    """Write a results folder as one file: scores, configuration and hashes.

    \b
    sucre-bench bundle results paper.zip
    sucre-bench bundle results paper.zip --pictures restored --by "Reef Lab"

    The command prints an id that stands for every hash in the file. Print the id in your paper. The same results always
    give the same bytes and the same id.
    """
    from sucre_bench.programs.bundle import bundle_results

    check_output(file, "bundle", force=force)
    check_links(folder)
    with progress.live():
        made = bundle_results(folder, file, pictures, by, _experiment(folder))
    size = file.stat().st_size
    click.echo(
        f"bundle   {file}, {f'{size / 1e6:.1f} MB' if size >= 1e6 else f'{size / 1e3:.0f} kB'}"
    )
    click.echo(f"id       {made.id}")
    click.echo(f"scores   {made.n_scores}, and seconds and memory")
    click.echo(f"files    {made.n_inside} files inside, {made.n_outside} outside by their hash")
    if pictures == "none":
        say(
            "verify can compute no score again: --pictures restored puts the pictures in",
            "yellow",
        )
    if made.local_paths:
        say(
            f"the bundle names folders of this machine: {', '.join(made.local_paths)}", "yellow"
        )


def _experiment(folder: Path) -> dict[str, str]:
    """Return the experiment's file that runs these results again. If there is none, say why and return none."""
    from sucre_bench import results
    from sucre_bench.jobs.experiment_file import EXPERIMENT, read_recorded

    results.read(folder)  # a folder without results is an error of its own
    try:
        content = read_recorded(folder)
        if not content:
            remedy = "repeat the run's command, which computes nothing again"
            raise InputError("is not there", folder / EXPERIMENT, remedy)
    except SucreBenchError as fault:
        say(f"no experiment.yaml in the bundle: {fault}", "yellow")
        return {}
    if plugins := content.get("plugins"):
        files = ", ".join(map(str, plugins))
        say(f"note: experiment.yaml needs {files}; publish that beside the bundle", "yellow")
    return {EXPERIMENT: (folder / EXPERIMENT).read_text(encoding="utf-8")}


# -- verify ------------------------------------------------------------------------------------------------


@click.command()
@shared.argument("file", metavar="FILE.zip")
@shared.option(
    "--data",
    multiple=True,
    metavar="[DATASET=]DIR",
    help="Folder of the data; may be repeated.",
)
@shared.option(
    "--id",
    "wanted",
    default="",
    metavar="ID",
    help="The id that was published with the bundle.",
)
@shared.option(
    "--tolerance",
    default=TOLERANCE,
    of=click.FloatRange(0, 1),
    help="How far a score may differ, as a share of the score.",
)
@shared.json_option
@shared.plugin_option
def verify(
    file: Path, data: Sequence[str], wanted: str, tolerance: float, as_json: bool
) -> None:
    """Check a bundle: verify its hashes and its data, and compute its scores again.

    \b
    sucre-bench verify paper.zip
    sucre-bench verify paper.zip --data dive/ --id 0123456789abcdef

    The command computes scores from the pictures in the bundle (bundle --pictures restored). Scores that need depth,
    charts or a reference need --data too. It executes nothing in a bundle, and unpacks nothing onto the disk.

    Exit codes: 0, nothing differs; 1, something differs; 2, the file is no bundle.
    """
    from sucre_bench.programs.verify import verify_bundle
    from sucre_bench.results.bundle_format import open_bundle

    with contextlib.redirect_stdout(sys.stderr), progress.live(), open_bundle(file) as bundle:
        datasets = set(bundle.rows["dataset"])
        found = verify_bundle.verify(bundle, _data_folders(datasets, data), tolerance)
    is_other = bool(wanted) and wanted.strip().lower() != found.id
    holds = found.holds and not is_other
    if as_json:
        shared.print_json({**asdict(found), "holds": holds})
        sys.exit(0 if holds else 1)
    if is_other:
        say(
            f"differs  the bundle's id is {found.id}, not {wanted}: it is not the one that was published",
            "red",
        )
    _print_outcome(found, tolerance)
    if not data and found.needs_data:
        words = shlex.join(["sucre-bench", "verify", str(file), "--data", "DIR"])
        terminal.show(f"more     {words}")
    if not holds:
        verdict = "NOT verified: something differs"
    elif found.is_whole:
        verdict = "verified: every hash holds, every score was computed again and agrees"
    elif found.n_agree:
        verdict = f"in part: every hash holds, {found.n_agree} of {found.n_scores} scores were computed again and agree"
    else:
        verdict = "hashes hold; no score could be computed again"
    terminal.show(verdict)
    sys.exit(0 if holds else 1)


def _data_folders(labels: Collection[str], given: Sequence[str]) -> dict[str, Path]:
    """Return the folder of the data by dataset label. labels: of all datasets; given: "DIR" for all, "DATASET=DIR".

    Raises InputError for a folder that is not there, and for a label that no dataset has.
    """
    folders: dict[str, Path] = {}
    for text in given:
        label, equals, place = text.rpartition("=")
        if label not in labels and equals and not Path(text).is_dir():
            raise unknown_name("--data", label, labels, "dataset")
        folder = Path(place if label in labels else text)
        check_folder(folder, "give the folder of the data")
        folders |= dict.fromkeys([label] if label in labels else labels, folder)
    return folders


def _print_outcome(found: Outcome, tolerance: float) -> None:
    by = f" by {found.by}" if found.by else ""
    click.echo(f"bundle   {found.id}{by}")
    click.echo(f"files    {found.n_files} hashes checked")
    n_not = sum(found.unchecked.values())
    common = f" ({found.n_common} on common pixels)" if found.n_common else ""
    terminal.show(
        f"scores   {found.n_agree} computed again{common} agree within {100 * tolerance:g} % or rounding "
        f"(largest difference {100 * found.largest:.2g} %), {len(found.differing)} differ, {n_not} not computed again"
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
        say(
            f"differs  {where}{region}: {one.stored:.6g}, computed again {one.computed:.6g}",
            "red",
        )
    more = len(found.faults[_MOST:]) + len(found.differing[_MOST:])
    if more:
        say(f"         and {more} more; --json lists all", "red")
