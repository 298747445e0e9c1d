"""`sucre-bench restore`: whole restored pictures of a folder of photographs, for use."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sucre_bench.commands import shared
from sucre_bench.errors import InputError
from sucre_bench.machine import progress
from sucre_bench.machine.files import check_working_folder
from sucre_bench.machine.text_formats import counted

if TYPE_CHECKING:
    from sucre_bench.programs.restore.pipeline import Options, Source
    from sucre_bench.programs.restore.write import Restored

_MOST_NAMED = 5
_MOST_LINES = 40  # doubtful pictures that get a line


@click.command()
@shared.argument("source", metavar="PHOTOS|DIVE")
@shared.argument("out", metavar="OUT")
@shared.words_argument("words", "[KEY=VALUE]...")
@shared.option("--method", default="sucre_plus", metavar="NAME", help="Method for the dive.")
@shared.option(
    "--single-view",
    default="fusion_2018",
    metavar="NAME",
    help="Method for photographs that overlap with no other.",
)
@shared.path_option(
    "--photos",
    metavar="FOLDER",
    help="Photographs that a DIVE was prepared from [default: where they were then].",
)
@shared.option(
    "--focal",
    of=float,
    metavar="WIDTHS",
    help="Hold this focal length, in longer sides of a photograph.",
)
@shared.flag(
    "--original-geometry",
    help="Distort pictures back, as the camera saw them; without it they are undistorted.",
)
@shared.option("--quality", of=click.IntRange(1, 100), default=95, help="Of JPEG and WebP.")
@shared.plugin_option
def restore(
    source: Path,
    out: Path,
    words: tuple[str, ...],
    method: str,
    single_view: str,
    photos: Path | None,
    focal: float | None,
    original_geometry: bool,
    quality: int,
) -> None:
    """Restore photographs for use: whole pictures with their names, formats, EXIF, GPS, XMP and colour profile.

    \b
    sucre-bench restore photos/ restored/
    sucre-bench restore dive/ restored/ --original-geometry
    sucre-bench restore photos/ restored/ --method dive_gray_world --quality 90
    sucre-bench restore photos/ restored/ method.water=own

    Photographs that overlap are prepared first, as `sucre-bench prepare` does, and restored together: one water, one
    exposure and one white for the dive. Others, and those whose picture is of no use, are restored one by one. DIVE is
    a folder that `prepare` made, or one of another program with depth maps. KEY=VALUE are options of the dataset or the
    method, as for `sucre-bench run`; and for surveys workers=4, shard.count=50 and hydra/launcher=slurm.

    OUT gets pictures/, contact-sheet.jpg, pictures.csv with how far each can be trusted, and work/, from which the same
    command continues if you stop it. Photographs are never changed.

    Exit codes: 0, every photograph has a picture; 1, some have none, or --single-view replaced a --method that failed;
    2, the command has a mistake; 130, stopped.
    """
    from sucre_bench.programs.restore import pipeline
    from sucre_bench.programs.restore.trust import Trust

    inputs = [source, *([photos] if photos else [])]
    check_working_folder(out, "work/restore.json", inputs)
    if any(folder.resolve() in out.resolve().parents for folder in inputs):
        raise InputError(
            "lies in the folder of the photographs", out, "name a folder elsewhere"
        )
    options = pipeline.Options(
        method, single_view, quality, original_geometry, *pipeline.sorted_words(words, method)
    )
    found, options, unplaced = _prepared(
        pipeline.source_of(source, photos), source, out, options, focal
    )
    done = pipeline.restore(found, out, options)
    for name, why in list(done.faults.items())[:_MOST_NAMED]:
        click.echo(f"no picture of {name}: {why}")
    if len(done.faults) > _MOST_NAMED:
        click.echo(f"no picture of {len(done.faults) - _MOST_NAMED} more photographs")
    if not done.names:
        raise InputError("no photograph could be restored", source, "mend what is named above")
    if done.n_instead:
        photographs = counted(done.n_instead, "photograph")
        click.echo(
            f"{method} made no good picture of {photographs}, so {single_view} balanced their colours"
        )
    for limit, n in Counter(limit for one in done.together for limit in one.limits).items():
        if 2 * n > len(done.together):  # what fewer pictures have stays in their records
            click.echo(f"the dive: {limit}")
    doubtful = [one for one in done.assessed if one.trust is not Trust.GOOD]
    for one in doubtful[:_MOST_LINES]:
        click.echo(f"{one.trust.value:10s}  {one.name}: {'; '.join(one.reasons)}")
    counts = Counter(one.trust.value for one in done.assessed)
    told = ", ".join(f"{n} {word}" for word, n in counts.items())
    click.echo(f"{told}; pictures.csv has a line for each picture")
    if done.together:
        trust = _of_water(done.together)
        measured = [one.measured for one in done.together if "beta" in one.record]
        if measured:
            share = sum(measured) / len(done.together)
            trust += f"; {share:.0%} of their pixels have a measured distance, and the others balanced colours"
    else:
        why = f", because {unplaced}" if unplaced else ""
        trust = f"Each is restored alone{why}: these are balanced colours, not true ones"
    n, sheet = len(done.names) + len(done.faults), out / "contact-sheet.jpg"
    click.echo(
        f"{len(done.names)} of {n} pictures are in {out / 'pictures'}, and {sheet} shows them. {trust}."
    )
    sys.exit(1 if done.faults or done.has_failed else 0)


def _of_water(together: Sequence[Restored]) -> str:
    """Return whether the water of a dive was measured, and if not, why."""
    from sucre_bench.programs.restore.trust import why_not_measured

    reasons = Counter(why_not_measured(one.record) for one in together)
    n_measured = reasons.pop("", 0)
    if not reasons:
        return "The water was measured"
    (reason, _), *_ = reasons.most_common(1)
    pictures = f" of {counted(len(together) - n_measured, 'picture')}" if n_measured else ""
    return f"The water{pictures} was not measured: {reason}"


def _prepared(
    found: Source, source: Path, out: Path, options: Options, focal: float | None
) -> tuple[Source, Options, str]:
    """Prepare photographs if the method needs that; return what is restored, how, and why photographs have no scene.

    Photographs that cannot be prepared, because they do not overlap for example, are restored one by one.
    """
    from dataclasses import replace

    from sucre_bench.jobs.catalogue import method_choice
    from sucre_bench.programs import prepare
    from sucre_bench.programs.prepare import pipeline
    from sucre_bench.programs.prepare.shots import load_pycolmap
    from sucre_bench.programs.restore.pipeline import noted, source_of

    is_alone = not found.is_dive and not method_choice(options.method, {}).plugin.needs
    if focal is not None and (found.is_dive or is_alone):
        raise InputError(
            "is for photographs that are prepared here",
            "--focal",
            "leave it out, or give it to prepare",
        )
    if found.is_dive:
        return found, options, ""
    if is_alone:
        return found, replace(options, single_view=options.method), ""
    load_pycolmap("restore")
    # refuses photographs of another source before they are prepared
    noted(found, out, options, again=False)
    wanted = prepare.Options(focal=focal)
    with progress.live():
        try:
            prepared = pipeline.prepare(source, out / "work" / "dive", wanted, again=True)
        except InputError as fault:
            progress.say(
                f"each photograph is restored alone, by {options.single_view}: {fault.without_remedy}"
            )
            return found, options, fault.fault
    for warning in prepared.warnings:
        click.echo(f"warning  {warning}")
    return source_of(out / "work" / "dive", source), options, ""
