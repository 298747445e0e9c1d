"""`sucre-bench texture`: writes a coloured surface of a scene, from a results folder."""

import time
from pathlib import Path

import click

from sucre_bench.commands.output_files import check_output
from sucre_bench.commands.shared_options import plugin_option, scene_options


@click.command()
@click.argument("results", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--method", required=True, metavar="LABEL", help='Label of the method that gives the colours; "input": the views.'
)
@scene_options
@click.option(
    "--voxel",
    type=click.FloatRange(0, min_open=True),
    metavar="METRES",
    help="Edge of a voxel [default: the median size of a pixel on the surface].",
)
@click.option("--mesh", is_flag=True, help="Write triangles, not points, into a .ply. A .glb always has triangles.")
@click.option(
    "--picture",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Also write a .png with the input beside the restored surface.",
)
@plugin_option
def texture(
    results: Path,
    out: Path,
    method: str,
    dataset: str,
    scene: str,
    voxel: float | None,
    mesh: bool,
    picture: Path | None,
) -> None:
    """Write a scene as points or a mesh in restored colours.

    \b
    sucre-bench texture results scene.glb --method sucre --picture scene.png
    sucre-bench texture results points.ply --method sucre --voxel 0.005
    sucre-bench texture results input.glb --method input

    RESULTS is a results folder of `sucre-bench run`. The command opens its dataset again, which must have depth and
    poses.
    """
    from sucre_bench.engine.reopen_results import INPUT, revisit
    from sucre_bench.loading.view_files import source_files
    from sucre_bench.machine import progress_display
    from sucre_bench.programs.texture import choose_cells, fuse, mean_up, write_model

    check_output(out, "surface")
    if picture is not None:
        check_output(picture, "picture")
    started = time.perf_counter()
    triangles = mesh or out.suffix.lower() == ".glb"
    with progress_display.live():
        found = revisit(results, [method], dataset, scene)
        if picture is not None:
            check_output(picture, "picture", (file for frame in found.frames for file in source_files(frame.view)))
        cells = choose_cells(found.frames, voxel)
        model = fuse(found.frames, method, cells, triangles)
        write_model(out, model, mean_up([frame.view for frame in found.frames]))
        if picture is not None:
            from sucre_bench.imaging.image_files import write_png
            from sucre_bench.programs.texture import side_by_side

            restored = model if triangles else fuse(found.frames, method, cells)
            models = {INPUT: fuse(found.frames, INPUT, cells, mask=method), method: restored}
            write_png(picture, side_by_side(models, found.frames)[..., ::-1])
    what = f"{len(model.points)} points" + (f", {len(model.triangles)} triangles" if triangles else "")
    size = f"{out.stat().st_size / 1e6:.1f} MB, voxels of {cells.voxel:.3g} m"
    click.echo(
        f"{found.dataset} / {found.scene} / {method}: {len(found.frames)} views, {what}, {size}, "
        f"{time.perf_counter() - started:.0f} s"
    )
    click.echo(f"surface  {out}")
    if picture is not None:
        click.echo(f"picture  {picture}")
