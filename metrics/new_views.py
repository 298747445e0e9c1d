"""New views of rendering methods: pictures WITH water against photographs that training did not see.

They say how well a method explains the scene, not how true its colours without water are: nobody wins a comparison of
restorations by them. `precomputed.with_water` computes them, in the photograph's encoding, over all pixels.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, NotApplicableError
from sucre_bench.plugins.plugin import metric
from sucre_bench.scene import Restoration, Score, View


def _scores(restored: Restoration, view: View, name: str) -> Iterator[Score]:
    told = restored.info.get("new_view", {})
    if "skipped" in told:
        raise NotApplicableError(told["skipped"])
    if "failed" in told:
        raise InputError(told["failed"])
    if told:
        yield Score(float(told[name]), n_pixels=view.rgb[..., 0].size)


@metric(
    needs={"restoration"},
    unit="dB",
    better="higher",
    range=(-np.inf, np.inf),
    variants={
        "held-out": "the picture with water against the photograph, views that were held out"
    },
)
@dataclass(frozen=True)
class NewViewPsnr:
    """Peak signal-to-noise ratio of a rendered view with water to the photograph that training did not see."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score; nothing where the method renders no water. NotApplicableError for a view that it saw."""
        yield from _scores(restored, view, "psnr")


@metric(
    needs={"restoration"},
    unit="",
    better="higher",
    range=(-1, 1),
    cites="Wang et al. 2004",
    variants={
        "held-out": "as new_view_psnr; Gaussian window, sigma 1.5, mean of the three channels"
    },
)
@dataclass(frozen=True)
class NewViewSsim:
    """Structural similarity of a rendered view with water to the photograph that training did not see."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score; nothing where the method renders no water. NotApplicableError for a view that it saw."""
        yield from _scores(restored, view, "ssim")
