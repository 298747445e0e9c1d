"""The description of a scene, also as JSON and as a contact sheet.

The sheet has each view with its charts outlined, beside its depth in colours; one colour scale for all.
"""

import io
import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, evenly
from sucre_bench.engine.select_views import Selection
from sucre_bench.errors import InputError
from sucre_bench.imaging.drawing import depth_colours, save_marked
from sucre_bench.loading.named_sets import Found, Member, Picture, recognised_sets, set_table
from sucre_bench.machine.files import expanded, regular
from sucre_bench.machine.progress import track
from sucre_bench.programs.describe.exposure import Exposure, NoExposure, estimate_exposure
from sucre_bench.programs.describe.facts import Look, Overlap, Spread, ViewFacts, look_at, overlaps, spread_of
from sucre_bench.programs.describe.faults import Fault, find_faults
from sucre_bench.scene import Water

_BINS = 12
_MOST = 60  # views on a sheet, evenly chosen
_WIDE, _GAP, _TEXT, _HEAD = 300, 8, 20, 64  # pixels
_GRAY = 128


@dataclass(frozen=True, eq=False)
class Described:
    """The description of a scene.

    n_views: number of views in the scene, also those that are not described; scale: the note of `prepare`, with
    is_metric (whether lengths are metres) and note (how the scale was found), or None if there is none (lengths then
    count as metres); unit: of lengths; exposure: or why it is not known; spread: None without poses or depth; edges
    (B + 1,), shares (B,): the distances of all pixels with depth, empty without depth; sets: the named test sets of its
    photographs; shared: what these share with other sets, a line each.
    """

    dataset: str
    scene: str
    n_views: int
    scale: dict[str, Any] | None
    unit: str
    has: tuple[str, ...]
    water: Water | None
    looks: list[Look]
    overlaps: list[Overlap]
    exposure: Exposure | NoExposure
    spread: Spread | None
    edges: list[float]
    shares: list[float]
    faults: list[Fault]
    sets: list[Found]
    shared: list[str]

    @property
    def facts(self) -> list[ViewFacts]:
        """The facts of its views."""
        return [look.facts for look in self.looks]

    def as_object(self) -> dict[str, Any]:
        """Return it as plain data for JSON."""
        light = self.exposure if isinstance(self.exposure, Exposure) else None
        return {
            **{name: getattr(self, name) for name in ("dataset", "scene", "n_views", "scale", "unit", "has")},
            "water": self.water and {name: np.asarray(value).tolist() for name, value in vars(self.water).items()},
            "views": [asdict(view) for view in self.facts],
            "overlaps": [asdict(overlap) for overlap in self.overlaps],
            "exposure": light
            and {
                "gains": dict(zip(light.views, light.gains, strict=True)),
                "error": light.error,
                "differs": light.differs,
                "least_light": light.least,
            },
            "exposure_unknown": self.exposure.name.lower() if isinstance(self.exposure, NoExposure) else None,
            "measures_water": self.spread and {"text": self.spread.sentence(self.unit), **asdict(self.spread)},
            "distances": {"edges": self.edges, "shares": self.shares},
            "sets": [found.as_object() for found in self.sets],
            "shared": self.shared,
            "faults": [{**asdict(fault), "text": str(fault)} for fault in self.faults],
        }

    def table(self) -> str:
        """Return the table of its views as a named test set. Raises InputError if it describes only some of them."""
        if len(self.looks) < self.n_views:
            raise InputError(
                f"has {self.n_views} views", self.scene, f"give --most {self.n_views} for the table of all"
            )
        members = (
            Member(look.facts.name, (), (look.facts.width, look.facts.height), look.print, look.reference_print)
            for look in self.looks
        )
        return set_table(self.scene, members)

    def sheet(self, suffix: str = ".png") -> bytes:
        """Return the contact sheet as PNG or JPEG, by the suffix."""
        from PIL import Image, ImageDraw, ImageFont

        looks = [self.looks[k] for k in evenly(len(self.looks), _MOST)]
        columns = 1 if len(looks) <= 3 else 2 if len(looks) <= 12 else 3
        shapes = [next((p.shape for p in (look.picture, look.depth) if p is not None), (3, 4)) for look in looks]
        heights = [max(1, round(_WIDE * shape[0] / shape[1])) for shape in shapes]
        wide, high = 2 * _WIDE + 2 + _GAP, max(heights) + _TEXT + _GAP
        size = (columns * wide + _GAP, _HEAD + -(-len(looks) // columns) * high + _GAP)
        sheet = Image.new("RGB", size, "white")
        pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
        values = _distances(self.looks, 16)
        low, top = np.percentile(values, [1, 99]).tolist() if values.size else (0.0, 1.0)
        top = max(top, low * 1.001)
        title = f"{self.dataset}: {self.scene}, {len(self.looks)} of {self.n_views} views"
        pen.text((_GAP, _GAP), title, fill="black", font=ImageFont.load_default(18))
        bar = np.tile(np.linspace(low, top, 256), (10, 1))
        sheet.paste(Image.fromarray(depth_colours(bar, low, top, _GRAY)), (_GAP, 34))
        scale = f"distance {low:.3g} to {top:.3g} {self.unit}, gray: unknown"
        pen.text((_GAP + 264, 30), scale, fill="black", font=font)
        for place, (look, height) in enumerate(zip(looks, heights, strict=True)):
            x, y = _GAP + place % columns * wide, _HEAD + place // columns * high
            depth = None if look.distance is None else depth_colours(look.distance, low, top, _GRAY)
            for left, picture, absent, how in (
                (x, look.picture, "cannot be read", Image.Resampling.BOX),
                (x + _WIDE + 2, depth, "no depth", Image.Resampling.NEAREST),
            ):
                if picture is None:
                    pen.rectangle((left, y, left + _WIDE - 1, y + height - 1), fill="#dddddd")
                    pen.text((left + 8, y + 8), absent, fill="black", font=font)
                else:
                    sheet.paste(Image.fromarray(picture).resize((_WIDE, height), how), (left, y))
            if look.picture is not None:
                for corners in look.charts * (_WIDE / look.picture.shape[1]) + (x, y):
                    pen.line([tuple(corner) for corner in (*corners, corners[0])], fill="#ff2d6f", width=2)
            facts = look.facts
            caption = f"{facts.name}   depth on {facts.coverage:.0%}" if facts.has_depth else facts.name
            pen.text((x, y + height + 2), caption[-80:], fill="black", font=font)
        content = io.BytesIO()
        save_marked(content, sheet, suffix)
        return content.getvalue()


def _distances(looks: list[Look], step: int = 1) -> Array:
    known = [look.distance[look.distance > 0][::step] for look in looks if look.distance is not None]
    return np.concatenate(known) if known else np.empty(0)


def described(selection: Selection, most: int) -> Described:
    """Describe at most `most` of the selected views of a scene, evenly chosen."""
    scene, root = selection.scene, selection.dataset.options.get("root")
    try:
        noted = json.loads(regular(expanded(root) / "prepare.json").read_bytes())["scale"] if root else None
        scale = noted and {"is_metric": bool(noted["is_metric"]), "note": str(noted["note"])}
    except (OSError, InputError, ValueError, KeyError, TypeError, RecursionError):  # none, or another program's
        scale = None
    unit = "m" if scale is None or scale["is_metric"] else "units"
    chosen = [selection.views[k] for k in evenly(len(selection.views), most)]
    looks = [look_at(view, "reference" in scene.has) for view in track(chosen, "looking at views")]
    between, values, edges, shares = overlaps(looks), _distances(looks), [], []
    pictures = {look.facts.name: Picture((look.facts.width, look.facts.height), look.print) for look in looks}
    sets, shared = recognised_sets(pictures)
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
        exposure=estimate_exposure(looks),
        spread=spread_of(scene.views),
        edges=edges,
        shares=shares,
        faults=find_faults(looks, between, scale is not None),
        sets=sets,
        shared=shared,
    )
