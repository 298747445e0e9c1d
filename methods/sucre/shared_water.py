"""Takes samples of many target images, to fit one water to a whole dive.

A single image often sees too few distances to determine its water, and a dive has one water. Every target gives a
sample of its pixels and the fit sums over all samples, so memory holds samples and never a whole dive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sucre_bench.arrays import evenly
from sucre_bench.errors import InputError, SolveError
from sucre_bench.machine.progress import say, track
from sucre_bench.methods.sucre.samples import SAMPLE, sampled
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Scene, View


def samples_of_targets(
    scene: Scene,
    observe: Callable[[View], Observations],
    match: Callable[[View, Observations], Observations | None],
    *,
    most: int,
    singles: bool,
    seed: int,
) -> Sequence[tuple[Observations, Observations | None]]:
    """Return samples of the observations of up to `most` targets, spread evenly over the scene.

    observe: pairs one target; match: observations of some of its pixels with matched footprints, None for none; each
    result has both. Views without a pose or depth, or with a damaged file, are left out.
    Raises SolveError when none is left.
    """
    kept: list[tuple[Observations, Observations | None]] = []
    last = "no view shares a pixel with another"
    for k in track(evenly(len(scene), most), "shared water"):
        view = scene.views[k]
        try:
            observations = observe(view)
        except (InputError, SolveError) as fault:
            last = str(fault)
            say(f"shared water skips {view.name}: {fault}")
            continue
        if observations.n_repeated:
            kept.append((sampled(observations, SAMPLE, singles=singles, seed=seed + k), match(view, observations)))
    if not kept:
        raise SolveError(f"the scene's water cannot be fitted, {last}; use method.water=FILE with a known one")
    return kept
