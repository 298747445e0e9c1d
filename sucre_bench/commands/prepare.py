"""`sucre-bench prepare`: makes a scene of photographs."""

import sys
from pathlib import Path
from typing import Any, get_args

import click

from sucre_bench.commands import shared
from sucre_bench.machine import progress
from sucre_bench.machine.processes import terminated_as_interrupt
from sucre_bench.programs.prepare import CameraModel, Cameras, Matching, Options, Surface

_DEFAULT = Options()
_MOST_NAMED = 5  # left-out photos of a kind that are named


@click.command()
@shared.argument("photos")
@shared.argument("out")
@shared.path_option(
    "--masks",
    help="Folder of masks: a.jpg.png or a.png for a.jpg. Black pixels get no matches and no depth.",
)
@shared.path_option(
    "--model",
    help="Model of another program, whose camera positions are kept: folder of COLMAP, hloc, Metashape or nerfstudio.",
)
@shared.path_option(
    "--mesh",
    metavar="FILE",
    help="Mesh in the coordinates of --model, .ply, .obj or .glb: its depths are taken.",
)
@shared.path_option(
    "--depth",
    metavar="FOLDER",
    help="Depth or disparity maps of the photos in any unit, .npy, .npz, .png, .tif or .exr. They are fitted to the"
    " sparse points.",
)
@shared.option(
    "--matching",
    of=get_args(Matching),
    help="exhaustive: match all pairs of photos; sequential: neighbours by name; auto: all pairs up to 80 photos.",
)
@shared.option(
    "--camera", of=get_args(CameraModel), default=_DEFAULT.camera, help="COLMAP's camera model."
)
@shared.option(
    "--cameras",
    of=get_args(Cameras),
    help="single: all photos share a camera; folder: those of a folder do; image: none do. Photos of different sizes"
    " never do.",
)
@shared.option(
    "--focal",
    of=float,
    metavar="WIDTHS",
    help="Hold this focal length, in longer sides of a photo.",
)
@shared.option(
    "--max-size",
    of=click.IntRange(min=0),
    default=_DEFAULT.max_size,
    metavar="PIXELS",
    help="Shrink larger photos to this longest side; 0 (default): do not.",
)
@shared.option(
    "--surface",
    of=get_args(Surface),
    help="dense: plane sweep; sparse: a relief of the sparse points, for flat seabeds; auto: dense up to 500 photos.",
)
@shared.option(
    "--depth-size",
    of=click.IntRange(min=64),
    default=_DEFAULT.depth_size,
    metavar="PIXELS",
    help="Longest side of the images in the plane sweep.",
)
@shared.option(
    "--scale",
    "factor",
    of=float,
    metavar="FACTOR",
    help="Metres per unit of the model, if you know it.",
)
@shared.option(
    "--distance",
    "distances",
    of=click.Tuple([str, str, float]),
    multiple=True,
    metavar="A B METRES",
    help="Distance between the cameras of two photos; may be repeated.",
)
@shared.option(
    "--length",
    "lengths",
    of=click.Tuple([str, float, float, float, float, float]),
    multiple=True,
    metavar="IMAGE X Y X Y METRES",
    help="Distance between two pixels of an undistorted image; may be repeated.",
)
@shared.path_option(
    "--depth-track",
    metavar="CSV",
    help="Table with the columns image,depth: metres below the water's surface.",
)
@shared.flag("--again", help="Replace an OUT that was made with other options.")
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
    """Make a scene of a folder of photos: undistorted images, a COLMAP model and depth maps.

    \b
    sucre-bench prepare photos/ dive/
    sucre-bench prepare photos/ dive/ --distance IMG_1.jpg IMG_9.jpg 1.85
    sucre-bench prepare photos/ dive/ --model colmap/sparse --scale 1
    sucre-bench restore dive/ restored/
    sucre-bench run dataset=./dive method=sucre_plus method.fill=true

    Then look at OUT/quality.html. Photos alone do not give the scale of a scene: without --distance, --length,
    --depth-track or --scale the depths are not metres. You may add one of these later; the command keeps it until you
    give another. If you stop prepare, the same command continues.

    Exit codes: 0, the scene is made; 1, no photo of it has depth; 2, the command has a mistake, or no photos can be
    related; 130, stopped.
    """
    from sucre_bench.programs.prepare import pipeline
    from sucre_bench.programs.prepare.scale import known_scale
    from sucre_bench.programs.prepare.shots import load_pycolmap

    known = known_scale(factor, distances, lengths, depth_track)
    load_pycolmap()  # before `live`, for it makes a kill dump its stack
    with progress.live(), terminated_as_interrupt():
        try:
            done = pipeline.prepare(photos, out, Options(**options), known, again)
        except KeyboardInterrupt:
            raise KeyboardInterrupt("stopped; the same command continues from here") from None
    if not done.is_new:
        click.echo("nothing to do: OUT was made of these photos with these options")
    for kind, left_out in (("damaged", done.damaged), ("without a place", done.unplaced)):
        for name, why in list(left_out.items())[:_MOST_NAMED]:
            click.echo(f"left out {name}: {why}")
        if len(left_out) > _MOST_NAMED:
            click.echo(f"left out {len(left_out) - _MOST_NAMED} more {kind}, named on the page")
    for warning in done.warnings:
        click.echo(f"warning  {warning}")
    covered = sum(q.coverage for q in done.qualities) / len(done.qualities)
    click.echo(
        f"placed   {len(done.qualities)} of {done.photos} photos, {100 * covered:.0f} % of pixels with depth"
    )
    off = sorted(
        (q.depth_error, q.name) for q in done.qualities if q.depth_error == q.depth_error
    )
    if off:
        median, (worst, name) = off[len(off) // 2][0], off[-1]
        at_worst = f"{100 * worst:.2f} % in {name} at worst"
        click.echo(f"depth    {100 * median:.2f} % off the sparse points (median), {at_worst}")
    click.echo(f"lens     focal length {done.focal}")
    click.echo(f"scale    {done.scale.note}{', kept from before' if done.is_kept else ''}")
    click.echo(f"page     {out / 'quality.html'}")
    if not covered:
        click.echo("depth    no photo has any, so no method that needs depth can restore them")
        sys.exit(1)
