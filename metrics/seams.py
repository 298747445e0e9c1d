"""Seams: steps of a picture that its photograph and distances do not account for (`sucre_bench.imaging.seams`).

Meant for pictures that are put together from several photographs (SUCRe, supplementary material, SUCRe vs. image
stitching: "apparent seams at places where different viewpoints were used"), and defined without knowing from which. A
method that changes each pixel by its colour and distance alone has no seams. A method that also looks at the
surroundings of a pixel may make a few.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.display import display
from sucre_bench.imaging.seams import find_seams
from sucre_bench.plugins.plugin import metric
from sucre_bench.scene import Restoration, Score, View


@metric(
    role="seams",
    needs={"depth"},
    requires=["cv2"],
    unit="share",
    better="lower",
    range=(0, 1),
    variants={
        "visible": "of the places where the photograph is smooth, those where the picture visibly steps",
        "height": "the unaccounted step, as a share of the picture's contrast, that one place in a hundred exceeds",
    },
    default=["visible"],
)
@dataclass(frozen=True)
class Seams:
    """Share of places where the picture has a step that the photograph does not have."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN where the photograph is nowhere smooth; coverage: the share of places looked at."""
        photograph = display(view.rgb, "none", view.encoding)
        found = find_seams(
            shown, photograph, view.depth if view.camera is None else view.distance
        )
        looked_at = np.isfinite(found.excess)
        share = float(looked_at.mean())
        n = round(share * shown.shape[0] * shown.shape[1])
        if not looked_at.any():
            yield Score(np.nan, n_pixels=0, coverage=0.0)
        elif variant == "visible":
            yield Score(float(found.is_seam[looked_at].mean()), n_pixels=n, coverage=share)
        else:
            yield Score(
                float(np.quantile(found.excess[looked_at], 0.99).clip(max=1)),
                n_pixels=n,
                coverage=share,
            )
