"""The description of a scene, and how it is shown: in the terminal, as JSON, or on a contact sheet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import click
import numpy as np

from sucre_bench.arrays import evenly
from sucre_bench.machine.json_text import json_text
from sucre_bench.programs.describe.contact_sheet import contact_sheet
from sucre_bench.programs.describe.depth_and_poses import Overlap, overlaps
from sucre_bench.programs.describe.facts import Look, ViewFacts, look_at
from sucre_bench.programs.describe.faults import Fault, find_faults
from sucre_bench.programs.describe.scale_note import ScaleNote
from sucre_bench.scene import Scene, View, Water

_BINS = 12
_ROWS = 30  # of a table in the terminal
_HEADS = ("view", "depth", "{unit} (1, 50, 99 %)", "overlap", "views", "disagrees", "mean R G B", "charts")


@dataclass(frozen=True, eq=False)
class Described:
    """The description of a scene: facts and overlaps of its views, and faults.

    n_views: number of views in the scene, also those that are not described; scale: the note of `prepare`, or None if
    there is none (lengths then count as metres); edges (B + 1,), counts (B,): histogram of distances over all views'
    pixels with depth, as shares.
    """

    dataset: str
    name: str
    n_views: int
    has: tuple[str, ...]
    water: Water | None
    facts: tuple[ViewFacts, ...]
    overlaps: tuple[Overlap, ...]
    faults: tuple[Fault, ...]
    edges: tuple[float, ...]
    counts: tuple[float, ...]
    looks: tuple[Look, ...]
    scale: ScaleNote | None = None

    @property
    def unit(self) -> str:
        """The unit of lengths."""
        return "m" if self.scale is None else self.scale.unit

    def sheet(self, suffix: str = ".png") -> bytes:
        """The contact sheet as PNG or JPEG, by the suffix."""
        title = f"{self.dataset}: {self.name}, {len(self.facts)} of {self.n_views} views"
        return contact_sheet(title, self.facts, self.looks, self.unit, suffix)


def described(
    dataset: str, scene: Scene, views: Sequence[View], most: int, scale: ScaleNote | None = None
) -> Described:
    """Describe at most `most` views of a scene, evenly chosen. scale: the note of prepare, or None."""
    chosen = [views[k] for k in evenly(len(views), most)]
    seen = look_at(chosen, "reference" in scene.has)
    facts, looks = [one for one, _ in seen], [look for _, look in seen]
    between = overlaps(looks)
    edges, counts = _histogram(looks)
    faults = find_faults(facts, looks, between, "m" if scale is None else scale.unit)
    return Described(
        dataset,
        scene.name,
        len(scene),
        tuple(sorted(scene.has)),
        scene.water,
        tuple(facts),
        tuple(between),
        tuple(faults),
        edges,
        counts,
        tuple(looks),
        scale,
    )


def as_json(scenes: Sequence[Described]) -> str:
    """Return descriptions as JSON: a list of scenes; unknown values are null."""
    return json_text([_plain_scene(one) for one in scenes])


def show(one: Described) -> None:
    """Print a description: facts, a table of views, the distances, and faults."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    from sucre_bench.machine import terminal

    sizes = Counter(f"{v.width}x{v.height}" for v in one.facts)
    focals = sorted({v.focal for v in one.facts if v.focal})
    has = ", ".join(one.has) or "images alone"
    said = {
        "scene": f"{one.name} of {one.dataset}: {len(one.facts)} of {one.n_views} views; has {has}",
        "images": ", ".join(f"{n} of {size}" for size, n in sizes.most_common(3))
        + f", {' and '.join(sorted({v.encoding for v in one.facts}))}",
        "cameras": f"{len(focals)}, focal {', '.join(f'{fx:.0f}' for fx, _ in focals[:3])} px" if focals else "none",
        "travel": _travel(one.facts, one.unit),
        "water": "not known" if one.water is None else _water(one.water),
    }
    if one.scale is not None:
        said["scale"] = one.scale.note
    if one.scale is not None and not one.scale.is_metric:
        meaning = "lengths are no metres, and beta and gamma not 1/m"
        said["scale"] += f"; {meaning}; run `sucre-bench prepare` again with a known length for metres"
    for name, text in said.items():
        terminal.out.print(Text(f"{name:8} {text}"), soft_wrap=True)
    between = {overlap.view: overlap for overlap in one.overlaps}
    rows = [_row(view, between.get(view.name)) for view in one.facts[:_ROWS]]
    heads = [head.format(unit=one.unit) for head in _HEADS]
    if terminal.out.is_terminal:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for head in heads:
            table.add_column(head, justify="left" if head == "view" else "right", overflow="fold")
        for row in rows:
            table.add_row(*row)
        terminal.out.print(table)
    else:
        widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
        for row in (heads, *rows):
            cells = [row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))]
            click.echo("  ".join(cells))
    if len(one.facts) > _ROWS:
        click.echo(f"... and {len(one.facts) - _ROWS} more views; --json has them all")
    for low, high, share in zip(one.edges, one.edges[1:], one.counts, strict=False):
        click.echo(f"{low:7.2f} to {high:6.2f} {one.unit}  {share:4.0%} {'#' * round(60 * share / max(one.counts))}")
    for fault in one.faults:
        terminal.out.print(Text(f"wrong    {fault}", style="yellow"), soft_wrap=True)
    things = {0: "nothing", 1: "1 thing"}.get(len(one.faults), f"{len(one.faults)} things")
    click.echo(f"found    {things} wrong")


def _row(view: ViewFacts, overlap: Overlap | None) -> list[str]:
    near = "-" if view.distances is None else " ".join(f"{d:.2f}" for d in view.distances)
    lap = ["-"] * 3
    if overlap is not None:
        off = "-" if overlap.disagreement is None else f"{overlap.disagreement:.2%}"
        lap = [f"{overlap.seen:.0%}", str(overlap.partners), off]
    colours = " ".join(f"{m:.2f}" for m in view.mean) if view.mean else "unreadable"
    depth = f"{view.coverage:.0%}" if view.has_depth else "-"
    return [view.name, depth, near, *lap, colours, str(len(view.charts)) if view.charts else "-"]


def _travel(facts: Sequence[ViewFacts], unit: str) -> str:
    places = np.array([view.position for view in facts if view.position])
    if len(places) < 2:
        return "not known, no poses" if not len(places) else "one pose"
    return f"{np.linalg.norm(np.ptp(places, axis=0)):.2f} {unit} between the outermost of {len(places)} cameras"


def _water(water: Water) -> str:
    parts = (("B", water.veiling_light), ("beta", water.attenuation), ("gamma", water.backscatter))
    return ", ".join(f"{name} {' '.join(f'{v:.3g}' for v in values)}" for name, values in parts)


def _histogram(looks: Sequence[Look]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    known = [distance[distance > 0] for look in looks if (distance := look.distance) is not None]
    values = np.concatenate(known) if known else np.empty(0)
    if not values.size:
        return (), ()
    low, high = np.percentile(values, [0.5, 99.5])
    counts, edges = np.histogram(values.clip(low, high), bins=_BINS if high > low else 1)
    return tuple(float(e) for e in edges), tuple(float(c) for c in counts / counts.sum())


def _plain_scene(one: Described) -> dict[str, Any]:
    water = None if one.water is None else {k: np.asarray(v).tolist() for k, v in vars(one.water).items()}
    return {
        "dataset": one.dataset,
        "scene": one.name,
        "n_views": one.n_views,
        "scale": None if one.scale is None else asdict(one.scale),
        "unit": one.unit,
        "has": list(one.has),
        "water": water,
        "views": [asdict(view) for view in one.facts],
        "overlaps": [asdict(overlap) for overlap in one.overlaps],
        "distances": {"edges": list(one.edges), "shares": list(one.counts)},
        "faults": [{**asdict(fault), "text": str(fault)} for fault in one.faults],
    }
