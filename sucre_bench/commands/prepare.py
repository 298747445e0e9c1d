"""The command `sucre-bench prepare`."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import click

__all__ = ["prepare"]

_CAMERAS = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE")
_MOST_NAMED = 5  # photos that were left out, of a kind


@click.command(short_help="Make a scene of a folder of photos.")
@click.argument("photos", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--masks", type=click.Path(path_type=Path), help="Folder of masks, a.jpg.png or a.png for a.jpg; black is left out."
)
@click.option(
    "--matching",
    type=click.Choice(["auto", "exhaustive", "sequential"]),
    default="auto",
    show_default=True,
    help="Pairs of photos: all, or neighbours by name; auto: all up to 80 photos.",
)
@click.option(
    "--camera", type=click.Choice(_CAMERAS), default="SIMPLE_RADIAL", show_default=True, help="COLMAP camera model."
)
@click.option(
    "--cameras",
    type=click.Choice(["single", "folder", "image"]),
    default="single",
    show_default=True,
    help="Which photos share a camera (those of another size never do).",
)
@click.option(
    "--max-size",
    type=click.IntRange(min=0),
    default=0,
    metavar="PIXELS",
    help="Shrink larger photos to this longest side.",
)
@click.option(
    "--surface",
    type=click.Choice(["auto", "dense", "sparse"]),
    default="auto",
    show_default=True,
    help="Plane sweep, or a relief of the sparse points for flat seabeds; auto: dense up to 500 photos.",
)
@click.option(
    "--depth-size",
    type=click.IntRange(min=64),
    default=800,
    show_default=True,
    metavar="PIXELS",
    help="Longest side at which depth is swept.",
)
@click.option(
    "--scale", "factor", type=float, metavar="FACTOR", help="Metres per unit of the model, where known from before."
)
@click.option(
    "--distance",
    "distances",
    type=(str, str, float),
    multiple=True,
    metavar="A B METRES",
    help="Distance between the cameras of two photos; may be repeated.",
)
@click.option(
    "--length",
    "lengths",
    type=(str, float, float, float, float, float),
    multiple=True,
    metavar="IMAGE X Y X Y METRES",
    help="Distance between two pixels of an undistorted image; may be repeated.",
)
@click.option(
    "--depth-track",
    type=click.Path(path_type=Path),
    metavar="CSV",
    help="Table of image,depth: metres below the surface.",
)
@click.option("--again", is_flag=True, help="Make OUT anew where it was made with other options.")
def prepare(
    photos: Path,
    out: Path,
    factor: float | None,
    distances: Any,
    lengths: Any,
    depth_track: Path | None,
    again: bool,
    **options: Any,
) -> None:
    """Turn a folder of photos into a scene: undistorted images, a COLMAP model and depth maps.

    \b
    sucre-bench prepare photos/ dive/
    sucre-bench prepare photos/ dive/ --distance IMG_1.jpg IMG_9.jpg 1.85
    sucre-bench run dataset=colmap dataset.root=dive/ method=sucre

    Look at OUT/quality.html. Photos alone do not tell how large a scene is: without one of --distance, --length,
    --depth-track or --scale the depths are not metres. That may be given later, and is kept until another is given;
    what is done is not done again, and the same command goes on where it was stopped.
    """
    from sucre_bench.jobs.quoting import quoted
    from sucre_bench.machine import terminal
    from sucre_bench.machine.interrupts import terminated_as_interrupt
    from sucre_bench.programs.prepare import pipeline
    from sucre_bench.programs.prepare.pycolmap_loader import load_pycolmap
    from sucre_bench.programs.prepare.scale import Known, Length

    known = Known(
        factor,
        tuple(distances),
        tuple(Length(name, ((x, y), (x2, y2)), metres) for name, x, y, x2, y2, metres in lengths),
        depth_track,
    )
    load_pycolmap()  # before the next line, for it makes a kill dump its stack
    with terminal.live(), terminated_as_interrupt():
        try:
            done = pipeline.prepare(photos, out, pipeline.Options(**options), known, again)
        except KeyboardInterrupt:
            raise KeyboardInterrupt("stopped; the same command goes on from here") from None
    if not done.is_new:
        click.echo("nothing to do: all is there already, made of these photos with these options")
    for kind, left_out in (("damaged", done.damaged), ("without a place", done.unplaced)):
        for name, why in list(left_out.items())[:_MOST_NAMED]:
            click.echo(f"left out {name}: {why}")
        if len(left_out) > _MOST_NAMED:
            click.echo(f"left out {len(left_out) - _MOST_NAMED} more {kind}, named on the page")
    for warning in done.warnings:
        click.echo(f"beware   {warning}")
    covered = sum(q.coverage for q in done.qualities) / len(done.qualities)
    click.echo(f"placed   {len(done.qualities)} of {done.photos} photos, {100 * covered:.0f} % of pixels with depth")
    click.echo(f"scale    {done.scale.note}{', kept from before' if done.is_kept else ''}")
    click.echo(f"page     {out / 'quality.html'}")
    root = shlex.quote(f"dataset.root={quoted(str(out))}")
    click.echo(f"run it   sucre-bench run dataset=colmap {root} method=sucre")
