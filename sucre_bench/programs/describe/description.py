"""The description of a scene, also as JSON and as a contact sheet."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import evenly
from sucre_bench.engine.select_views import Selection
from sucre_bench.errors import InputError
from sucre_bench.machine.files import expanded, regular
from sucre_bench.programs.describe.contact_sheet import contact_sheet
from sucre_bench.programs.describe.depth_and_poses import Overlap, overlaps
from sucre_bench.programs.describe.exposure import Exposure, NoExposure, estimate_exposure
from sucre_bench.programs.describe.faults import Fault, find_faults
from sucre_bench.programs.describe.view_facts import Look, ViewFacts, look_at
from sucre_bench.scene import Water

_BINS = 12


@dataclass(frozen=True, slots=True)
class ScaleNote:
    """The note of `sucre-bench prepare` on the scale. is_metric: whether lengths are metres; note: how it was found."""

    is_metric: bool
    note: str


def _noted_scale(selection: Selection) -> ScaleNote | None:
    """Return the note in prepare.json in the dataset's root; None if there is none."""
    root = selection.dataset.options.get("root")
    try:
        scale = json.loads(regular(expanded(root) / "prepare.json").read_bytes())["scale"] if root else None
        return scale and ScaleNote(bool(scale["is_metric"]), str(scale["note"]))
    except (OSError, InputError, ValueError, KeyError, TypeError, RecursionError):
        return None


@dataclass(frozen=True, eq=False)
class Described:
    """The description of a scene: facts and overlaps of its views, their exposure, and faults.

    n_views: number of views in the scene, also those that are not described; exposure: or why it is not known; scale:
    the note of `prepare`, or None if there is none (lengths then count as metres); edges (B + 1,), counts (B,):
    histogram of distances over all views' pixels with depth, as shares.
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
    exposure: Exposure | NoExposure
    scale: ScaleNote | None = None

    @property
    def unit(self) -> str:
        """The unit of lengths."""
        return _unit(self.scale)

    def sheet(self, suffix: str = ".png") -> bytes:
        """The contact sheet as PNG or JPEG, by the suffix."""
        title = f"{self.dataset}: {self.name}, {len(self.facts)} of {self.n_views} views"
        return contact_sheet(title, self.facts, self.looks, self.unit, suffix)

    def as_object(self) -> dict[str, Any]:
        """Return it as plain data for JSON."""
        light = self.exposure if isinstance(self.exposure, Exposure) else None
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
            "distances": {"edges": self.edges, "shares": self.counts},
            "faults": [{**asdict(fault), "text": str(fault)} for fault in self.faults],
        }


def described(selection: Selection, most: int) -> Described:
    """Describe at most `most` of the selected views of a scene, evenly chosen."""
    scene, scale = selection.scene, _noted_scale(selection)
    chosen = [selection.views[k] for k in evenly(len(selection.views), most)]
    seen = look_at(chosen, "reference" in scene.has)
    facts, looks = [one for one, _ in seen], [look for _, look in seen]
    between = overlaps(looks)
    edges, counts = _histogram(looks)
    faults = find_faults(facts, looks, between, _unit(scale))
    return Described(
        selection.dataset.label,
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
        estimate_exposure(looks),
        scale,
    )


def _unit(scale: ScaleNote | None) -> str:
    return "m" if scale is None or scale.is_metric else "units"


def _histogram(looks: Sequence[Look]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    known = [distance[distance > 0] for look in looks if (distance := look.distance) is not None]
    values = np.concatenate(known) if known else np.empty(0)
    if not values.size:
        return (), ()
    low, high = np.percentile(values, [0.5, 99.5])
    counts, edges = np.histogram(values.clip(low, high), bins=_BINS if high > low else 1)
    return tuple(float(e) for e in edges), tuple(float(c) for c in counts / counts.sum())
