"""Stitching of the closest observations (SUCRe, supplementary material: SUCRe vs. image stitching)."""

from dataclasses import dataclass

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.imaging.fill import FillOption


@method(needs={"depth", "poses"}, cites="Boittiaux et al. 2024, SUCRe, supplementary material")
@dataclass(frozen=True)
class Stitching(FillOption):
    """Give each pixel the colour of its closest observation in any view, without a water model.

    Pixels without depth have no colour, or with `fill` the photograph's own.

    Of equally close observations, the first in the scene's order counts.
    """

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the stitched image, NaN where the view has no depth.

        info: n_observations, n_views, unreadable (views that could not be read). Raises SolveError when no pixel has
        depth.
        """
        from sucre_bench.multiview.observe import observe

        observations = observe(view, scene.views)
        nearest = np.full(len(observations.pixels), np.inf, dtype=np.float32)
        colours = np.empty((3, len(nearest)), dtype=np.float32)
        for n, part in observations.slots():
            closer = observations.distance[part] < nearest[:n]
            nearest[:n][closer] = observations.distance[part][closer]
            colours[:, :n][:, closer] = observations.intensity(part)[:, closer]
        info = {
            "n_observations": len(observations),
            "n_views": len(observations.views),
            "unreadable": (*observations.unreadable, *observations.grey),
        }
        stitched = Restoration(observations.image(colours), info=info)
        return self.filled(
            stitched, view, lambda z: np.where(z[..., None] > 0, view.rgb, np.float32(np.nan))
        )
