"""Reads the note of `sucre-bench prepare` that says whether lengths of a scene are metres."""

import json
from dataclasses import dataclass

from sucre_bench.engine.select_views import Selection
from sucre_bench.errors import InputError
from sucre_bench.machine.files import expanded, regular


@dataclass(frozen=True, slots=True)
class ScaleNote:
    """is_metric: whether lengths are metres; note: how the scale was found."""

    is_metric: bool
    note: str

    @property
    def unit(self) -> str:
        """The unit of lengths."""
        return "m" if self.is_metric else "units"


def noted_scale(selection: Selection) -> ScaleNote | None:
    """Return the note in prepare.json in the dataset's root; None if there is none."""
    root = selection.dataset.options.get("root")
    try:
        scale = json.loads(regular(expanded(root) / "prepare.json").read_bytes())["scale"] if root else None
        return scale and ScaleNote(bool(scale["is_metric"]), str(scale["note"]))
    except (OSError, InputError, ValueError, KeyError, TypeError, RecursionError):
        return None
