"""The description of a scene, also as JSON and as a contact sheet.

The sheet has each view with its charts outlined, beside its depth in colours; one colour scale for all.
"""

import io
import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Size, evenly
from sucre_bench.engine.preflight import Selection
from sucre_bench.errors import ANY_FAULT
from sucre_bench.imaging.drawing import contact_sheet, depth_colours, font, save_marked
from sucre_bench.loading.named_sets import Found, Picture, recognised_sets
from sucre_bench.machine.files import expanded, regular
from sucre_bench.machine.progress import track
from sucre_bench.multiview.geometry_faults import Fault
from sucre_bench.multiview.overlaps import Overlap, overlaps
from sucre_bench.multiview.spread import Spread, spread_of
from sucre_bench.programs.describe.facts import Look, ViewFacts, look_at, placed
from sucre_bench.programs.describe.faults import find_faults
from sucre_bench.scene import Water

_BINS = 12
_MOST = 60  # views on a sheet, evenly chosen
# pixels
_WIDE = 300
_GAP = 8
_HEAD = 64
_GRAY = 128


@dataclass(frozen=True, eq=False)
class Described:
    """The description of a scene."""

    dataset: str
    scene: str

    n_views: int
    """Number of views in the scene, also those that are not described."""

    scale: dict[str, Any] | None
    """The note of `prepare`, with is_metric (whether lengths are metres) and note (how the scale was found). None if
    there is none; lengths then count as metres."""

    unit: str
    """Of lengths."""

    has: tuple[str, ...]
    water: Water | None
    looks: list[Look]
    overlaps: list[Overlap]

    spread: Spread | None
    """None without poses or depth."""

    # The distances of all pixels with depth: edges of their bins (B + 1,), and the share of each bin (B,). Empty
    # without depth.
    edges: list[float]
    shares: list[float]

    faults: list[Fault]

    sets: list[Found]
    """The named test sets of its photographs."""

    @property
    def facts(self) -> list[ViewFacts]:
        """The facts of its views."""
        return [look.facts for look in self.looks]

    def as_object(self) -> dict[str, Any]:
        """Return it as plain data for JSON."""
        return {
            **{
                name: getattr(self, name)
                for name in ("dataset", "scene", "n_views", "scale", "unit", "has")
            },
            "water": self.water
            and {name: np.asarray(value).tolist() for name, value in vars(self.water).items()},
            "views": [asdict(view) for view in self.facts],
            "overlaps": [asdict(overlap) for overlap in self.overlaps],
            "measures_water": self.spread
            and {"text": self.spread.sentence(self.unit), **asdict(self.spread)},
            "distances": {"edges": self.edges, "shares": self.shares},
            "sets": [found.as_object() for found in self.sets],
            "faults": [{**asdict(fault), "text": str(fault)} for fault in self.faults],
        }

    def sheet(self, suffix: str = ".png") -> bytes:
        """Return the contact sheet as PNG or JPEG, by the suffix."""
        from PIL import Image, ImageDraw

        values = _distances(self.looks, 16)
        low, top = np.percentile(values, [1, 99]).tolist() if values.size else (0.0, 1.0)
        top = max(top, low * 1.001)
        pairs, captions = [], []
        for look in (self.looks[k] for k in evenly(len(self.looks), _MOST)):
            shape = next(
                (plane.shape for plane in (look.picture, look.depth) if plane is not None),
                (3, 4),
            )
            size = (_WIDE, max(1, round(_WIDE * shape[0] / shape[1])))
            depth = (
                None if look.distance is None else depth_colours(look.distance, low, top, _GRAY)
            )
            picture = _tile(look.picture, size, "cannot be read", Image.Resampling.BOX)
            if look.picture is not None:
                for corners in look.charts * (_WIDE / look.picture.shape[1]):
                    outline = [tuple(corner) for corner in (*corners, corners[0])]
                    ImageDraw.Draw(picture).line(outline, fill="#ff2d6f", width=2)
            pairs.append((picture, _tile(depth, size, "no depth", Image.Resampling.NEAREST)))
            share = f"   depth on {look.facts.coverage:.0%}" if look.facts.has_depth else ""
            captions.append(f"{look.facts.name}{share}"[-80:])
        sheet = contact_sheet(pairs, captions, _WIDE, _HEAD)
        pen = ImageDraw.Draw(sheet)
        title = f"{self.dataset}: {self.scene}, {len(self.looks)} of {self.n_views} views"
        pen.text((_GAP, _GAP), title, fill="black", font=font(17))
        bar = np.tile(np.linspace(low, top, 256), (10, 1))
        sheet.paste(Image.fromarray(depth_colours(bar, low, top, _GRAY)), (_GAP, 34))
        scale = f"distance {low:.3g} to {top:.3g} {self.unit}, gray: unknown"
        pen.text((_GAP + 264, 30), scale, fill="black", font=font(13))
        content = io.BytesIO()
        save_marked(content, sheet, suffix)
        return content.getvalue()


def _tile(picture: np.ndarray | None, size: Size, absent: str, how: Any) -> Any:
    """A picture brought to a size, or a gray one that says why there is none. how: of resampling."""
    from PIL import Image, ImageDraw

    if picture is not None:
        return Image.fromarray(picture).resize(size, how)
    tile = Image.new("RGB", size, "#dddddd")
    ImageDraw.Draw(tile).text((8, 8), absent, fill="black", font=font(13))
    return tile


def _distances(looks: list[Look], step: int = 1) -> Array:
    known = [
        look.distance[look.distance > 0][::step] for look in looks if look.distance is not None
    ]
    return np.concatenate(known) if known else np.empty(0)


def described(selection: Selection, most: int) -> Described:
    """Describe at most `most` of the selected views of a scene, evenly chosen."""
    scene = selection.scene
    root = selection.dataset.options.get("root")
    try:
        noted = (
            json.loads(regular(expanded(root) / "prepare.json").read_bytes())["scale"]
            if root
            else None
        )
        scale = noted and {"is_metric": bool(noted["is_metric"]), "note": str(noted["note"])}
    except ANY_FAULT:  # none, or another program's
        scale = None
    unit = "m" if scale is None or scale["is_metric"] else "units"
    chosen = [selection.views[k] for k in evenly(len(selection.views), most)]
    looks = [
        look_at(view, "reference" in scene.has) for view in track(chosen, "looking at views")
    ]
    between = overlaps(placed(looks))
    values = _distances(looks)
    edges = []
    shares = []
    pictures = {
        look.facts.name: Picture((look.facts.width, look.facts.height), look.print)
        for look in looks
    }
    if values.size:
        low, high = np.percentile(values, [0.5, 99.5])
        counts, bounds = np.histogram(values.clip(low, high), bins=_BINS if high > low else 1)
        edges, shares = bounds.tolist(), (counts / counts.sum()).tolist()
    return Described(
        dataset=selection.dataset.label,
        scene=scene.name,
        n_views=len(scene),
        scale=scale,
        unit=unit,
        has=tuple(sorted(scene.has)),
        water=scene.water,
        looks=looks,
        overlaps=between,
        spread=spread_of(scene.views),
        edges=edges,
        shares=shares,
        faults=find_faults(looks, between, scale is not None),
        sets=recognised_sets(pictures),
    )
