"""`sucre-bench report`, `texture`, `video` and `track`: results as a page, a surface, a video, and in mlflow."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import asdict
from pathlib import Path

import click
from rich.text import Text

from sucre_bench.commands import shared
from sucre_bench.errors import InputError
from sucre_bench.machine import progress, terminal
from sucre_bench.machine.files import check_links, check_output, is_ours, write_atomically
from sucre_bench.machine.text_formats import counted, json_text


@click.command("report")
@shared.argument("folder")
def report(folder: Path) -> None:
    """Write the page of a results folder: FOLDER/report/index.html.

    \b
    sucre-bench report results

    The page has tables, plots and pictures. It opens from disk, without a network.
    """
    from sucre_bench import compare, results
    from sucre_bench.reports import page
    from sucre_bench.results.common_scores import read_common

    check_links(folder)
    rows = compare.on_pixels(results.read(folder), lambda: read_common(folder))
    click.echo(page.write(folder, rows, compare.compare(rows)))


@click.command()
@shared.argument("results")
@shared.argument("out")
@shared.option(
    "--method", required=True, metavar="LABEL", help='Label of the method that gives the colours; "input": the views.'
)
@shared.dataset_option
@shared.scene_option
@shared.option(
    "--voxel",
    of=click.FloatRange(0, min_open=True),
    metavar="METRES",
    help="Edge of a voxel [default: the median size of a pixel on the surface].",
)
@shared.flag("--mesh", help="Write triangles, not points, into a .ply. A .glb always has triangles.")
@shared.option(
    "--picture", of=shared.PATH, metavar="FILE", help="Also write a .png with the input beside the restored surface."
)
@shared.plugin_option
@shared.force_option
def texture(
    results: Path,
    out: Path,
    method: str,
    dataset: str,
    scene: str,
    voxel: float | None,
    mesh: bool,
    picture: Path | None,
    force: bool,
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
    from sucre_bench.machine.provenance import load
    from sucre_bench.programs.texture import choose_cells, fuse, mean_up, write_model, write_picture

    load("texture", "open3d")
    check_output(out, "surface", force=force)
    if picture is not None:
        check_output(picture, "picture", force=force)
    check_links(results)
    started = time.perf_counter()
    triangles = mesh or out.suffix.lower() == ".glb"
    with progress.live():
        found = revisit(results, [method], dataset, scene)
        if picture is not None:
            inputs = [file for frame in found.frames for file in source_files(frame.view)]
            check_output(picture, "picture", inputs, force)
        cells = choose_cells(found.frames, voxel)
        model = fuse(found.frames, method, cells, triangles)
        write_model(out, model, mean_up([frame.view for frame in found.frames]))
        if picture is not None:
            restored = model if triangles else fuse(found.frames, method, cells)
            models = {INPUT: fuse(found.frames, INPUT, cells, mask=method), method: restored}
            write_picture(picture, models, found.frames)
    what = f"{len(model.points)} points" + (f", {len(model.triangles)} triangles" if triangles else "")
    size = f"{out.stat().st_size / 1e6:.1f} MB, voxels of {cells.voxel:.3g} m"
    click.echo(
        f"{found.dataset} / {found.scene} / {method}: {len(found.frames)} views, {what}, {size}, "
        f"{time.perf_counter() - started:.0f} s"
    )
    click.echo(f"surface  {out}")
    if picture is not None:
        click.echo(f"picture  {picture}")


@click.command()
@shared.argument("results")
@shared.argument("out")
@shared.option("--methods", required=True, metavar="A,B", help="Labels of methods, in the order of the panels.")
@shared.dataset_option
@shared.scene_option
@shared.option("--fps", default=10.0, of=click.FloatRange(0.1, 120), help="Views a second.")
@shared.flag(
    "--split", help="Show one panel for each method: the input left of a moving divider, the method right of it."
)
@shared.option("--height", default=540, of=click.IntRange(64, 4320), help="Greatest height of a panel, in pixels.")
@shared.plugin_option
@shared.force_option
def video(
    results: Path, out: Path, methods: str, dataset: str, scene: str, fps: float, split: bool, height: int, force: bool
) -> None:
    """Write a video of the views before and after, and measure how much each method flickers.

    \b
    sucre-bench video results dive.mp4 --methods gray_world,sucre
    sucre-bench video results dive.webm --methods sucre --split --fps 5

    RESULTS is a results folder of `sucre-bench run`. The video shows its views in capture order. The
    command writes the numbers beside the video, for example into dive.mp4.json.
    """
    from sucre_bench.engine.reopen_results import revisit
    from sucre_bench.programs.video import FORMULAE, composed, flicker, panel_size, write_video

    numbers = out.with_name(f"{out.name}.json")
    check_output(out, "video", force=force or is_ours(numbers))
    check_output(numbers, "numbers", force=force)
    check_links(results)
    labels = shared.labels_of(methods)
    if not labels:
        raise InputError("--methods: no label; give labels with commas between them")
    with progress.live():
        found = revisit(results, labels, dataset, scene)
        size = panel_size(found.frames[0], height)
        count = write_video(out, composed(found.frames, labels, size, fps, split), fps)
        flickers = flicker(found.frames, labels)
    left_out = f" ({found.left_out} that a method did not restore are left out)" if found.left_out else ""
    click.echo(f"{found.dataset} / {found.scene}: {count} views{left_out}, {out.stat().st_size / 1e6:.1f} MB")
    table = terminal.table(["method", "flicker"], ["mean", "95 %", "pairs"])  # narrow enough for any terminal
    for method, of_method in flickers.items():
        for n, (name, f) in enumerate(of_method.items()):
            interval = f"{f.low:.3g} to {f.high:.3g}" if math.isfinite(f.low) else ""
            table.add_row(Text("" if n else method), name, f"{f.mean:.3g}", interval, str(f.pairs))
    terminal.out.print(table)
    click.echo("flicker: " + "; ".join(f"{name}: {text}" for name, text in FORMULAE.items()))
    by_method = {method: {name: asdict(f) for name, f in values.items()} for method, values in flickers.items()}
    about = {"dataset": found.dataset, "scene": found.scene, "views": [frame.view.name for frame in found.frames]}
    told = {"program": "sucre_bench", **about, "fps": fps, "formulae": FORMULAE, "flicker": by_method}
    write_atomically(numbers, f"{json_text(told)}\n".encode())
    click.echo(f"video    {out}\nnumbers  {numbers}")


@click.command()
@shared.argument("folder")
@shared.option("--uri", default="", metavar="URI", help="mlflow's tracking URI [default: a store in FOLDER].")
@shared.option("--experiment", default="sucre_bench", help="Name of the experiment in mlflow.")
@shared.flag("--ui", help="Then serve mlflow's page on this machine until Ctrl-C.")
@shared.option("--port", default=5000, of=click.IntRange(1, 65535), help="Port of that page.")
def track(folder: Path, uri: str, experiment: str, ui: bool, port: int) -> None:
    """Log a results folder in mlflow, for example after a run on a cluster.

    \b
    sucre-bench track results --uri http://127.0.0.1:5000
    sucre-bench track results --ui

    The command logs only rows that mlflow does not have yet.
    """
    from sucre_bench import compare, results
    from sucre_bench.machine.provenance import require
    from sucre_bench.machine.text_formats import masked
    from sucre_bench.reports import mlflow
    from sucre_bench.results.common_scores import read_common

    require("track", "mlflow")
    uri = uri or mlflow.default_uri(folder)
    is_server = uri.startswith(("http://", "https://"))
    if ui and not is_server:
        mlflow.check_port(port)
    check_links(folder)
    rows = results.read(folder)
    comparisons = compare.compare(compare.on_pixels(rows, lambda: read_common(folder)))
    with progress.live():
        new = mlflow.log(folder, rows, comparisons, uri, experiment)
    page = mlflow.runs_page(uri, experiment, port) if ui else ""
    click.echo(f"mlflow   {masked(uri)}, experiment {experiment}: {counted(new, 'new run')}")
    if ui and is_server:
        click.echo(f"page     {masked(page)}")
    elif ui:
        click.echo("page     starting, about 10 s")
        sys.exit(mlflow.open_ui(uri, port, lambda: click.echo(f"page     {page}  (Ctrl-C ends it)")))
