"""The description of a scene, also as JSON and as a contact sheet.

The sheet has each view with its charts outlined, beside its depth in colours; one colour scale for all.
"""

import io
import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import evenly
from sucre_bench.engine.select_views import Selection
from sucre_bench.errors import InputError
from sucre_bench.imaging.drawing import depth_colours
from sucre_bench.machine.files import expanded, regular
from sucre_bench.programs.describe.depth_and_poses import Overlap, overlaps
from sucre_bench.programs.describe.exposure import Exposure, NoExposure, estimate_exposure
from sucre_bench.programs.describe.faults import Fault, find_faults
from sucre_bench.programs.describe.view_facts import Look, ViewFacts, look_at
from sucre_bench.scene import Water

_BINS = 12
_MOST = 60  # views on a sheet, evenly chosen
_WIDE, _GAP, _TEXT, _HEAD = 300, 8, 20, 64  # pixels
_GRAY = 128


@dataclass(frozen=True, slots=True)
class ScaleNote:
    """The note of `sucre-bench prepare` on the scale. is_metric: whether lengths are metres; note: how it was found."""

    is_metric: bool
    note: str


@dataclass(frozen=True, eq=False)
class Described:
    """The description of a scene: facts and overlaps of its views, their exposure, and faults.

    n_views: number of views in the scene, also those that are not described; exposure: or why it is not known; scale:
    the note of `prepare`, or None if there is none (lengths then count as metres); unit: of lengths.
    """

    dataset: str
    name: str
    n_views: int
    has: tuple[str, ...]
    water: Water | None
    facts: list[ViewFacts]
    looks: list[Look]
    overlaps: list[Overlap]
    faults: list[Fault]
    exposure: Exposure | NoExposure
    scale: ScaleNote | None
    unit: str

    def histogram(self) -> tuple[list[float], list[float]]:
        """Return edges (B + 1,) and shares (B,) of the distances of all pixels with depth; empty without depth."""
        values = self._distances()
        if not values.size:
            return [], []
        low, high = np.percentile(values, [0.5, 99.5])
        counts, edges = np.histogram(values.clip(low, high), bins=_BINS if high > low else 1)
        return edges.tolist(), (counts / counts.sum()).tolist()

    def _distances(self, step: int = 1) -> Any:
        known = [distance[distance > 0][::step] for look in self.looks if (distance := look.distance) is not None]
        return np.concatenate(known) if known else np.empty(0)

    def as_object(self) -> dict[str, Any]:
        """Return it as plain data for JSON."""
        light = self.exposure if isinstance(self.exposure, Exposure) else None
        edges, shares = self.histogram()
        return {
            "dataset": self.dataset,
            "scene": self.name,
            "n_views": self.n_views,
            "scale": self.scale and asdict(self.scale),
            "unit": self.unit,
            "has": self.has,
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
            "distances": {"edges": edges, "shares": shares},
            "faults": [{**asdict(fault), "text": str(fault)} for fault in self.faults],
        }

    def sheet(self, suffix: str = ".png") -> bytes:
        """Return the contact sheet as PNG or JPEG, by the suffix."""
        from PIL import Image, ImageDraw, ImageFont

        chosen = evenly(len(self.looks), _MOST)
        columns = 1 if len(chosen) <= 3 else 2 if len(chosen) <= 12 else 3
        wide, high = 2 * _WIDE + 2 + _GAP, max(_height(self.looks[k]) for k in chosen) + _TEXT + _GAP
        rows = -(-len(chosen) // columns)
        sheet = Image.new("RGB", (columns * wide + _GAP, _HEAD + rows * high + _GAP), "white")
        pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
        values = self._distances(16)
        low, top = np.percentile(values, [1, 99]).tolist() if values.size else (0.0, 1.0)
        top = max(top, low * 1.001)
        title = f"{self.dataset}: {self.name}, {len(self.facts)} of {self.n_views} views"
        pen.text((_GAP, _GAP), title, fill="black", font=ImageFont.load_default(18))
        bar = np.tile(np.linspace(low, top, 256), (10, 1))
        sheet.paste(Image.fromarray(depth_colours(bar, low, top, _GRAY)), (_GAP, 34))
        scale = f"distance {low:.3g} to {top:.3g} {self.unit}, gray: unknown"
        pen.text((_GAP + 264, 30), scale, fill="black", font=font)
        for place, k in enumerate(chosen):
            row, column = divmod(place, columns)
            tile = _tile((wide - _GAP, high - _GAP), self.facts[k], self.looks[k], (low, top))
            sheet.paste(tile, (_GAP + column * wide, _HEAD + row * high))
        content = io.BytesIO()
        sheet.save(content, "PNG" if suffix.lower() == ".png" else "JPEG", quality=92)
        return content.getvalue()


def _tile(size: tuple[int, int], view: ViewFacts, look: Look, limits: tuple[float, float]) -> Any:
    """Return one view as a picture of that size. limits: the distances at the ends of the colour scale."""
    from PIL import Image, ImageDraw, ImageFont

    tile = Image.new("RGB", size, "white")
    pen, font = ImageDraw.Draw(tile), ImageFont.load_default(14)
    high = _height(look)
    depth = None if look.distance is None else depth_colours(look.distance, *limits, _GRAY)
    for x, picture, absent, how in (
        (0, look.picture, "cannot be read", Image.Resampling.BOX),
        (_WIDE + 2, depth, "no depth", Image.Resampling.NEAREST),
    ):
        if picture is None:
            pen.rectangle((x, 0, x + _WIDE - 1, high - 1), fill="#dddddd")
            pen.text((x + 8, 8), absent, fill="black", font=font)
        else:
            tile.paste(Image.fromarray(picture).resize((_WIDE, high), how), (x, 0))
    if look.picture is not None:
        for corners in look.charts * (_WIDE / look.picture.shape[1]):
            pen.line([tuple(corner) for corner in (*corners, corners[0])], fill="#ff2d6f", width=2)
    said = f"{view.name}   depth on {view.coverage:.0%}" if view.has_depth else view.name
    pen.text((0, high + 2), said[-80:], fill="black", font=font)
    return tile


def _height(look: Look) -> int:
    plane = look.picture if look.picture is not None else look.depth
    return _WIDE * 3 // 4 if plane is None else max(1, round(_WIDE * plane.shape[0] / plane.shape[1]))


def described(selection: Selection, most: int) -> Described:
    """Describe at most `most` of the selected views of a scene, evenly chosen."""
    scene, root = selection.scene, selection.dataset.options.get("root")
    try:
        noted = json.loads(regular(expanded(root) / "prepare.json").read_bytes())["scale"] if root else None
        scale = noted and ScaleNote(bool(noted["is_metric"]), str(noted["note"]))
    except (OSError, InputError, ValueError, KeyError, TypeError, RecursionError):  # none, or another program's
        scale = None
    unit = "m" if scale is None or scale.is_metric else "units"
    seen = look_at([selection.views[k] for k in evenly(len(selection.views), most)], "reference" in scene.has)
    facts, looks = [one for one, _ in seen], [look for _, look in seen]
    between = overlaps(looks)
    faults = find_faults(facts, looks, between, unit)
    has, light = tuple(sorted(scene.has)), estimate_exposure(looks)
    dataset = selection.dataset.label
    return Described(
        dataset, scene.name, len(scene), has, scene.water, facts, looks, between, faults, light, scale, unit
    )
