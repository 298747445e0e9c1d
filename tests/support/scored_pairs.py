"""Scores of pairs of restored views, of images that a test makes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from sucre_bench import Scene, results
from sucre_bench.engine.score import scorers
from sucre_bench.engine.score_pairs import Entrant, pair_rows
from sucre_bench.imaging.display import display
from sucre_bench.jobs.catalogue import metric_choices
from sucre_bench.restored_pair import RestoredView
from sucre_bench.results.rows import Row


def pair_scores(scene: Scene, images: Mapping[str, Mapping[str, np.ndarray]], *metrics: str) -> pd.DataFrame:
    """The rows of some methods. images: what each method made of each view; metrics: as `sucre_bench.score` takes."""
    chosen = scorers(metric_choices(metrics))

    def entrant(method: str) -> Entrant:
        def opened(name: str) -> RestoredView:
            image = images[method][name].astype(np.float32)
            return RestoredView(scene[name], lambda: display(image, "none", scene[name].encoding), lambda: image)

        bases = {name: Row(dataset="made", scene=scene.name, view=name, method=method) for name in images[method]}
        return Entrant(bases, opened, chosen)

    made = pair_rows(scene, [entrant(method) for method in images])
    return results.frame([row for rows in made for row in rows])
