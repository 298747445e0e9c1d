"""Colourfulness M3 (Hasler & Suesstrunk 2003, Measuring colourfulness in natural images)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from sucre_bench import Restoration, Score, View, metric


@metric(
    unit="",
    better="none",
    range=(0, np.inf),
    cites="Hasler & Suesstrunk 2003",
    variants={
        "255": "of intensities to 255, as published: 15 is slightly, 109 extremely colourful",
        "1": "to 1",
    },
)
@dataclass(frozen=True)
class Colourfulness:
    """How colourful a picture is: spread and mean of its opponent colours. It describes; more is not better."""

    def score(self, restored: Restoration, shown: np.ndarray, view: View, variant: str) -> Iterator[Score]:
        """Yield one score over the pixels that have a colour, NaN where none has."""
        seen = np.isfinite(shown).all(axis=-1)
        if not seen.any():
            yield Score(np.nan, n_pixels=0, coverage=0.0)
            return
        red, green, blue = shown[seen].astype(np.float64).T * float(variant)
        opponents = np.array([red - green, (red + green) / 2 - blue])  # rg, yb
        value = np.hypot(*opponents.std(axis=1)) + 0.3 * np.hypot(*opponents.mean(axis=1))
        yield Score(float(value), n_pixels=int(seen.sum()), coverage=float(seen.mean()))
