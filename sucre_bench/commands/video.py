"""`sucre-bench video`: writes a video of the views before and after, and measures flicker."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sucre_bench.commands.output_files import check_output
from sucre_bench.commands.shared_options import labels_of, plugin_option, scene_options
from sucre_bench.machine.records import json_text

if TYPE_CHECKING:
    from sucre_bench.programs.video import Flicker


@click.command()
@click.argument("results", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--methods", required=True, metavar="A,B", help="Labels of methods, in the order of the panels.")
@scene_options
@click.option("--fps", default=10.0, show_default=True, type=click.FloatRange(0.1, 120), help="Views a second.")
@click.option(
    "--split",
    is_flag=True,
    help="Show one panel for each method: the input left of a moving divider, the method right of it.",
)
@click.option(
    "--height",
    default=540,
    show_default=True,
    type=click.IntRange(64, 4320),
    help="Greatest height of a panel, in pixels.",
)
@plugin_option
def video(
    results: Path, out: Path, methods: str, dataset: str, scene: str, fps: float, split: bool, height: int
) -> None:
    """Write a video of the views before and after, and measure how much each method flickers.

    \b
    sucre-bench video results dive.mp4 --methods gray_world,sucre
    sucre-bench video results dive.webm --methods sucre --split --fps 5

    RESULTS is a results folder of `sucre-bench run`. The video shows its views in capture order. The
    command writes the numbers beside the video, for example into dive.mp4.json.
    """
    from sucre_bench.engine.reopen_results import revisit
    from sucre_bench.errors import InputError
    from sucre_bench.machine import progress_display, terminal
    from sucre_bench.machine.files import write_atomically
    from sucre_bench.programs.video import FORMULAE, composed, flicker, panel_size, write_video

    numbers = out.with_name(f"{out.name}.json")
    check_output(out, "video")
    check_output(numbers, "numbers")
    labels = labels_of(methods)
    if not labels:
        raise InputError("--methods: no label; give labels with commas between them")
    with progress_display.live():
        found = revisit(results, labels, dataset, scene)
        size = panel_size(found.frames[0], height)
        count = write_video(out, composed(found.frames, labels, size, fps, split), fps)
        flickers = flicker(found.frames, labels)
    left_out = f" ({found.left_out} that a method did not restore are left out)" if found.left_out else ""
    click.echo(f"{found.dataset} / {found.scene}: {count} views{left_out}, {out.stat().st_size / 1e6:.1f} MB")
    terminal.out.print(_table(flickers))
    click.echo("flicker: " + "; ".join(f"{name}: {text}" for name, text in FORMULAE.items()))
    by_method = {method: {name: asdict(f) for name, f in values.items()} for method, values in flickers.items()}
    about = {"dataset": found.dataset, "scene": found.scene, "views": [frame.view.name for frame in found.frames]}
    told = {**about, "fps": fps, "formulae": FORMULAE, "flicker": by_method}
    write_atomically(numbers, f"{json_text(told)}\n".encode())
    click.echo(f"video    {out}\nnumbers  {numbers}")


def _table(flickers: Mapping[str, Mapping[str, Flicker]]) -> Any:
    """A line a method and measure, narrow enough for any terminal."""
    from rich.text import Text

    from sucre_bench.machine import terminal

    table = terminal.table(["method", "flicker"], ["mean", "95 %", "pairs"])
    for method, by_statistic in flickers.items():
        for n, (name, f) in enumerate(by_statistic.items()):
            interval = f"{f.low:.3g} to {f.high:.3g}" if math.isfinite(f.low) else ""
            table.add_row(Text("" if n else method), name, f"{f.mean:.3g}", interval, str(f.pairs))
    return table
