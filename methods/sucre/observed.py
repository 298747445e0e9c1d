"""A view with its observations, `Observed`; targets of a dive as one image, `Dive`; and samples of pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from sucre_bench import Arrays
from sucre_bench.arrays import Array, Indices, evenly
from sucre_bench.camera import pixel_rays
from sucre_bench.errors import InputError, SolveError
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.machine.progress import say, track
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.solution import Solution, colours_for_water
from sucre_bench.methods.sucre.uncertainty import WaterUncertainty
from sucre_bench.multiview.observations import Observations, pooled
from sucre_bench.scene import Encoding, Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.light import Light
    from sucre_bench.methods.sucre.sucre import Sucre


# Pixels of the sample: a fit on 5,000 was within 1e-4 of the full cost; four times as many cost little.
SAMPLE = 20_000
# The fewest with equal footprints that are worth a fit of their own.
_FEWEST_MATCHED = 200


@dataclass(frozen=True, eq=False)
class Observed:
    """A view of a scene as options see it: its image, and the observations of its pixels."""

    options: Sucre
    scene: Scene
    view: View
    observations: Observations

    light: Light | None = None
    """Of this view; it was removed from image and observations."""

    recorded: View | None = None
    """The view before its light was removed."""

    @staticmethod
    def of(options: Sucre, scene: Scene, view: View) -> Observed:
        """Raises NotApplicableError when no pixel has depth or none is seen twice."""
        return Observed(options, scene, view, options.observe(scene, view))

    @cached_property
    def matched(self) -> Observations | None:
        """A sample with equal footprints (multiview/footprints.py), None where too few pixels have one."""
        n = self.observations.n_repeated
        if n < _FEWEST_MATCHED:
            return None
        chosen = np.random.default_rng(0).choice(n, min(n, SAMPLE), replace=False)
        found = self.matched_at(self.observations.pixels[chosen])
        return found if found.n_repeated >= _FEWEST_MATCHED else None

    def matched_at(self, pixels: Indices) -> Observations:
        """Return observations of pixels (flat indices) with equal footprints."""
        from sucre_bench.multiview.footprints import matched_footprints

        shown = set(self.observations.views)
        views = [other for other in self.scene.views if other.name in shown]
        how = self.options.pairing_with(with_view=True, with_ray=True)
        return matched_footprints(self.view, views, pixels, **how)

    def alone(self) -> Observed:
        """Return the view with its own observations alone."""
        from sucre_bench.multiview.observe import observe

        view = self.recorded or self.view
        # light is a matter of views and rays
        is_evened = self.light is not None
        found = observe(
            view, [view], **self.options.pairing_with(with_view=is_evened, with_ray=is_evened)
        )
        return replace(self, observations=self.light.removed(found) if self.light else found)

    @property
    def encoding(self) -> Encoding:
        """The encoding of the intensities that are fitted."""
        return "linear" if self.options.encoding == "linear" else self.view.encoding

    @property
    def is_decoded(self) -> bool:
        return self.encoding != self.view.encoding

    @property
    def intensities(self) -> Array:
        """The view's intensities (H, W, 3) in the encoding that is fitted."""
        return srgb_decode(self.view.rgb) if self.is_decoded else self.view.rgb

    def first_colours(self, few: Observations) -> Array:
        """Return the colours (3, P) that the paper starts from: the view's own, or another's where not finite."""
        from sucre_bench.methods.sucre.paper import start_of

        return start_of(few, self.intensities.reshape(-1, 3))

    def with_rays(self) -> Observed:
        """Return the view with observations that have rays."""
        if self.observations.ray is not None:
            return self
        observations = self.options.observe(
            self.scene, self.recorded or self.view, with_view=True, with_ray=True
        )
        return replace(self, observations=observations)

    def evened(self, light: Light) -> Observed:
        """Return the view and its observations as even light would show them. Intensities may exceed 1."""
        assert self.view.camera is not None
        rays = np.moveaxis(pixel_rays(self.view.camera), -1, 0)[:2]
        recorded = np.moveaxis(self.intensities, -1, 0)
        own = (
            light.gains[[light.views.index(self.view.name)]]
            if self.view.name in light.views
            else np.zeros((1, 3))
        )
        alone = replace(light, views=(self.view.name,), gains=np.nan_to_num(own))
        even = np.moveaxis(recorded / alone.falling(rays, 0), 0, -1)
        rgb = (srgb_encode(even) if self.is_decoded else even).astype(np.float32)
        view = replace(self.view, pixels=Arrays(rgb, self.view.depth, self.view.reference))
        observations = light.removed(self.with_rays().observations)
        return replace(
            self, view=view, observations=observations, light=alone, recorded=self.view
        )

    def coloured(
        self, water: WaterParameters, uncertainty: WaterUncertainty | None = None
    ) -> Solution:
        """Return the colours in a water: see `colours_for_water`."""
        options = self.options
        return colours_for_water(
            self.observations, water, uncertainty, options.backend, options.device
        )


# Targets of a dive, spread evenly over the scene; fewer serve where only its model is judged.
_TARGETS = 40
JUDGED_TARGETS = 8
# Views whose light is fitted together at most: that takes minutes.
TOGETHER = 512

# Pixels of all targets of a dive that is judged.
_JUDGED = 6_000


@dataclass(frozen=True, eq=False)
class Dive(Observed):
    """Targets of a scene as one image, of samples of their pixels: memory never holds a whole dive.

    A single image often sees too few distances to determine its water, and a dive has one water. view: the first
    target, whose light counts as 1.
    """

    targets: Sequence[Observed] = ()

    @staticmethod
    def spread(options: Sucre, scene: Scene, most: int = _TARGETS) -> Dive:
        """Return targets spread over the scene, and with `_TARGETS` more, so that common views link all views.

        Views without a pose or depth, or with a damaged file, are left out. SolveError when none is left.
        """
        targets = list[Observed]()
        linked = list[set[str]]()
        last = "no view shares a pixel with another"
        spread = evenly(len(scene), most)
        is_linked = most == _TARGETS and len(scene) <= TOGETHER
        others = sorted(set(range(len(scene))) - set(spread)) if is_linked else []
        n = (
            max(2 * SAMPLE // _TARGETS, SAMPLE // len(spread))
            if most == _TARGETS
            else _JUDGED // len(spread)
        )
        for k in track(
            [*spread, *others], "common water" if most == _TARGETS else "judging models"
        ):
            view = scene.views[k]
            names = {one.name for one in scene.views[k : k + 2]}
            if k in others and any(names <= group for group in linked):
                # it links nothing to the next view
                continue
            try:
                found = options.observe(scene, view, with_view=True, with_ray=True)
            except (InputError, SolveError) as fault:
                last = str(fault)
                if most == _TARGETS:
                    say(f"common water skips {view.name}: {fault}")
                continue
            if found.n_repeated:
                targets.append(
                    Observed(options, scene, view, sampled(found, n, singles=True, seed=0))
                )
                new = set(() if (matched := targets[-1].matched) is None else matched.views)
                apart = [group for group in linked if not group & new]
                linked = [*apart, new.union(*(group for group in linked if group & new))]
        if not targets:
            raise SolveError(
                f"the scene's water cannot be fitted, {last}",
                remedy="use method.water=FILE with a known one",
            )
        whole = _pooled(scene, [one.observations for one in targets])
        return Dive(options, scene, targets[0].view, whole, targets=targets)

    @cached_property
    def matched(self) -> Observations | None:
        found = [few for one in self.targets if (few := one.matched) is not None]
        return _pooled(self.scene, found) if found else None

    def half(self, names: frozenset[str]) -> Half:
        """Return the dive as some views show it."""

        def of_half(observations: Observations) -> Observations:
            return observations.in_views(
                np.array([name in names for name in observations.views])
            )

        matched = None if self.matched is None else of_half(self.matched)
        if matched is not None:
            matched = matched.take(np.arange(matched.n_repeated))
        observations = of_half(self.observations)
        return Half(
            self.options,
            self.scene,
            self.view,
            observations,
            targets=self.targets,
            footprints=matched,
        )

    def first_colours(self, few: Observations) -> Array:
        names = np.array(
            [
                few.views.index(one.view.name) if one.view.name in few.views else -1
                for one in self.targets
            ]
        )
        own = names[few.pixels // (few.shape[0] // few.stacked * few.shape[1])]
        first = few.intensity(slice(0, len(few.pixels)))
        assert few.view is not None
        for n, part in few.slots():
            is_own = few.view[part] == own[:n]
            first[:, :n][:, is_own] = few.intensity(part)[:, is_own]
        return first

    def evened(self, light: Light) -> Observed:
        """Return the samples as even light would show them."""
        return replace(self, observations=light.removed(self.observations))


@dataclass(frozen=True, eq=False)
class Half(Dive):
    """A dive as half of its views show it."""

    footprints: Observations | None = None
    """Footprints of the dive in these views."""

    @cached_property
    def matched(self) -> Observations | None:
        enough = self.footprints is not None and self.footprints.n_repeated >= _FEWEST_MATCHED
        return self.footprints if enough else None


def _pooled(scene: Scene, parts: Sequence[Observations]) -> Observations:
    return pooled(parts, [view.name for view in scene.views])


def sampled(observations: Observations, n: int, *, singles: bool, seed: int) -> Observations:
    """Return n random pixels of those seen more than once, and with `singles` as large a share of the others."""
    rng = np.random.default_rng(seed)
    repeated = observations.n_repeated
    all_pixels = len(observations.pixels)
    if n >= repeated:
        return observations.take(np.arange(all_pixels if singles else repeated))
    chosen = [rng.choice(repeated, n, replace=False)]
    if singles:
        share = round((all_pixels - repeated) * n / repeated)
        chosen.append(repeated + rng.choice(all_pixels - repeated, share, replace=False))
    return observations.take(np.sort(np.concatenate(chosen)))


def first_slot(observations: Observations) -> Observations:
    """Return each pixel with its first observation alone, which any water explains: it can only hold a colour up.

    The first that has a weight in all channels: those of a view whose light is not known have none.
    """
    n = len(observations.pixels)
    first = np.arange(n)
    if observations.weight is not None:
        for _, part in reversed(list(observations.slots())):
            known = np.flatnonzero(
                np.atleast_2d(observations.weight[..., part] > 0).all(axis=0)
            )
            first[known] = part.start + known
    return replace(
        observations,
        counts=np.ones(n, dtype=np.int32),
        starts=np.array([0, n]),
        distance=observations.distance[first],
        colour=observations.colour[:, first],
        weight=None if observations.weight is None else observations.weight[..., first],
        view=None,
        ray=None,
    )
