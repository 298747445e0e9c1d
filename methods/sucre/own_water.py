"""Finds the water of one image from its own observations, exactly, and decides what replaces it where it is a guess."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import NotApplicableError, SolveError
from sucre_bench.methods.sucre.choose import Chosen, choose
from sucre_bench.methods.sucre.diagnostics import FAR_COLOURS, clustered, far_colours, is_determined
from sucre_bench.methods.sucre.exact import fit
from sucre_bench.methods.sucre.light import Light, parts_of
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.paper import start_of
from sucre_bench.methods.sucre.robust import reweighted, robust_noise
from sucre_bench.methods.sucre.solution import Solution, colours_for_water, matched_at, sampled, solve_exact
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.sucre import Sucre

# Distances are alike if their percentile 95 is less than this many times their percentile 5. beta is not told from the
# light where its standard error over the median distance is above this optical depth.
_ALIKE, _LOOSE = 1.5, 0.1

# Blur that grows with distance looks like attenuation, less so in footprints so many times wider. Images are blurred if
# beta then falls by more than this: optical depth of the farthest, times standard errors, in the means of the channels.
# It is .13 and more under forward scatter, .08 at most over ripples of the ground. The least share of beta that is
# worth a word; pixels fitted to, the fewest.
_WIDER, _BLURRED, _LITTLE, _JUDGED, _ENOUGH = 3.0, 0.1, 0.02, 5_000, 1_000

# A gain of this much is worth a word.
_DIFFERENT = 0.05

_MIXED = "distances do not separate it from attenuation, so colours of far ground may be wrong"


@dataclass(frozen=True)
class OwnWater:
    """The exact fit of a method's options to one view of a scene."""

    options: Sucre
    scene: Scene
    view: View

    def solve(self, observations: Observations, matched: Observations | None) -> tuple[Observations, Solution]:
        """Return the solution, and the observations that it explains: in even light, if theirs is not.

        matched: a sample with equal footprints.
        """
        explained, solution = self._in_light(observations, matched)
        unknown = solution.is_under_strobe or solution.is_photograph
        if matched is None or not self.options.footprint or unknown or self.view.is_jpeg or "robust" in solution.about:
            return explained, solution
        return explained, solution.with_limits(self._blur(observations, matched, solution))

    def _blur(self, observations: Observations, matched: Observations, solution: Solution) -> list[str]:
        """Say if the images hold blur that is not the footprint's, such as forward scatter: see _WIDER.

        A wide footprint holds marine snow and animals too, and JPEG files have wide ones anyway: nothing tells there.
        """
        few = sampled(matched, _JUDGED, singles=False, seed=0)
        wide = matched_at(self.options, self.scene, self.view, observations, few.pixels, _WIDER)
        if len(common := np.intersect1d(few.pixels, wide.pixels)) < _ENOUGH:
            return []
        both = [one.take(np.flatnonzero(np.isin(one.pixels, common))) for one in (few, wide)]
        both = [solution.light.removed(one) if solution.light else one for one in both]
        try:
            narrow, wider = (fit(one, one_coefficient=self.options.one_coefficient) for one in both)
        except SolveError:
            return []
        error = clustered(narrow.uncertainty, both[:1], narrow.water).standard_error.beta
        known = np.isfinite(error) & (error > 0)
        if not known.any():
            return []
        drop, far = (narrow.water.beta - wider.water.beta)[known], np.quantile(few.distance, 0.95)
        share, sure = drop / narrow.water.beta[known], (drop / error[known]).mean()
        if min(share.mean(), sure) < _LITTLE or drop.mean() * far * sure < _BLURRED:
            return []
        return [
            "far images are more blurred than their pixels explain, by scattered light, focus or poses: attenuation "
            f"may be {share.max():.0%} too high or more, and far colours too bright"
        ]

    def _in_light(self, observations: Observations, matched: Observations | None) -> tuple[Observations, Solution]:
        parts = parts_of(self.options.light, "method.light")
        to_fit = matched if self.options.footprint else None
        solution = self._solved(observations, to_fit)
        if matched is None or (parts is None and to_fit is None):
            return observations, self._determined(observations, solution)
        options = self.options
        may_be_strobe = not (options.fill or options.one_coefficient) and options.colours == "multi_view"
        few = matched
        if "robust" in solution.about:  # animals tell nothing of the light
            few = reweighted(matched, solution.water, robust_noise(matched, solution.water))
        chosen = choose(few, self.view.name, solution.water, parts, may_be_strobe=may_be_strobe)
        if chosen.fit is None:
            return observations, self._determined(observations, solution)
        return self._in_even_light(chosen, matched)

    def _solved(self, observations: Observations, matched: Observations | None) -> Solution:
        options = self.options
        solution = solve_exact(
            observations,
            matched=matched,
            physical=options.physical,
            one_coefficient=options.one_coefficient,
            robust=options.robust,
            **options.compute,
        )
        about: dict[str, Any] = {"footprint": matched is not None}
        if matched is not None:
            about["unexplained"] = float(robust_noise(matched, solution.water).mean())
        return replace(solution, about=solution.about | about)

    def _determined(self, observations: Observations, solution: Solution) -> Solution:
        """Return the solution, or the photograph without a water if the water is a guess.

        It is one where weak priors decide the water of most channels, and noise fills a channel. The standard deviation
        is then that of one observation.
        """
        if is_determined(solution.uncertainty) or not (np.median(solution.deviation, axis=1) > _LOST).any():
            return solution
        none = WaterParameters.of_channels(np.zeros((3, 3)))
        without = colours_for_water(observations, none, None, self.options.backend, self.options.device)
        uncertainty = replace(without.uncertainty, limits=(_PHOTOGRAPH,), is_weak=(True, True, True))
        J = start_of(observations, self.options.intensities(self.view)).astype(np.float32)
        deviation = np.broadcast_to(uncertainty.noise[:, None], J.shape).astype(np.float32)
        about = solution.about | {"solver": "none"}
        return replace(without, J=J, deviation=deviation, uncertainty=uncertainty, about=about, is_photograph=True)

    def _in_even_light(self, chosen: Chosen, matched: Observations) -> tuple[Observations, Solution]:
        """Return the solution for observations that are brought to even light, and these.

        The water is fitted anew, except under a strobe, whose veil is another. Its errors include those of the light.
        """
        assert chosen.fit is not None
        light = chosen.fit.light
        where = self.options.backend, self.options.device
        all_of_it = self.options.observe(self.scene, self.view, with_view=True, with_ray=True)
        even = light.removed(all_of_it)
        if not even.n_repeated:
            raise NotApplicableError(
                f"{self.view.name}: the light leaves no pixel that two views show; use method.light=even"
            )
        if light.strobe is None:
            solution = self._solved(even, light.removed(matched) if self.options.footprint else None)
        else:
            none = np.zeros(3)
            solution = colours_for_water(even, WaterParameters(none, light.water.beta, none), None, *where)
        near, median, far = np.quantile(matched.distance, (0.05, 0.5, 0.95))
        is_mixed = (light.parts.strobe and far <= _ALIKE * near) or (chosen.fit.error[:, 1] * median >= _LOOSE).any()
        uncertainty = solution.uncertainty
        before = uncertainty.standard_error.by_channel()
        error = np.fmax(before, chosen.fit.error)
        if solution.growth is not None:  # errors of beta are most of what places and views share
            larger = np.divide(error, before, out=np.ones((3, 3)), where=before > 0)[:, 1:2]
            solution = replace(solution, growth=np.sqrt(1 + (solution.growth**2 - 1) * larger**2).astype(np.float32))
        is_weak = (True, True, True) if is_mixed and light.strobe is not None else uncertainty.is_weak
        uncertainty = replace(uncertainty, standard_error=WaterParameters.of_channels(error), is_weak=is_weak)
        solution = replace(solution, uncertainty=uncertainty)
        view = self.options.in_even_light(self.view, light)
        solution = replace(self, view=view)._determined(even, solution)
        about = {**solution.about, **light_record(chosen, self.view.name)}
        limits = [f"{said}; {_MIXED}" if is_mixed else said for said in sentences_of(light)]
        if not any(FAR_COLOURS in limit for limit in uncertainty.limits):
            limits += far_colours(error[:, 1] * far)
        known = {name for name, gain in zip(light.views, light.gains, strict=True) if np.isfinite(gain).all()}
        if unknown := [name for name in all_of_it.views if name not in known]:
            limits.append(f"views that share too few pixels to find their light took no part: {', '.join(unknown)}")
        return even, replace(solution, about=about, light=light).with_limits(limits)


def sentences_of(light: Light) -> list[str]:
    """Say what was removed."""
    said = []
    if light.parts.gains:
        gains = np.exp(light.gains)
        low, high = np.nanmin(gains), np.nanmax(gains)
        what = "exposure" if light.parts.gains == 1 else "white balance"
        if high > (1 + _DIFFERENT) * low or light.parts.gains == 3:
            said.append(f"{what} differs between views; gains of {low:.2f} to {high:.2f} were fitted")
    if light.parts.lens:
        said.append(f"light falls off across the images, to {light.least:.0%} in the corners; the falloff was removed")
    if light.strobe is not None:
        said.append("a strobe beside the camera was fitted, and its light removed")
    return said


def light_record(chosen: Chosen, target: str) -> dict[str, Any]:
    """Return the models of light that were tried, and the one that was fitted, as plain data for JSON."""
    assert chosen.fit is not None
    light = chosen.fit.light
    record: dict[str, Any] = {
        "parts": light.parts.words,
        "tried": [{"parts": one.parts.words, "gain": one.gain, "sigmas": one.sigmas} for one in chosen.tried],
    }
    if light.falls_off:
        record["least"] = light.least
    if light.strobe is not None:
        record["strobe"] = {"position": light.strobe.position.tolist(), "lobe": light.strobe.lobe.tolist()}
    gains = np.exp(light.gains[:, 0] if light.parts.gains == 1 else light.gains)
    by_name = {name: gain.tolist() for name, gain in zip(light.views, gains, strict=True) if np.isfinite(gain).all()}
    return {"light": record} | ({"gains": {target: 1.0} | by_name} if light.parts.gains else {})


# -- what replaces a water that is not determined ----------------------------------------

# Less optical depth than this over the farthest distances is none. Pure water has as much in red over .2 m.
_CLEAR = 0.05

# A channel is lost if its typical colour has a larger standard deviation than this, the whole scale.
_LOST = 1.0

_PHOTOGRAPH = (
    "these views do not determine the water; the colours are those of the photograph, and the display stretches "
    "them; take views from more distances"
)

UNKNOWN_VEIL = (
    "the veil of most channels is not determined, so it stays in the colours as an offset of each channel; "
    "method.display=stretch-1-99 removes it from the picture"
)


DARKEST_AS_VEIL = (
    "the veil is not determined; the darkest colours of each channel were taken for it, so true black may be lighter"
)

# Colours that are darker than the black of a channel, as a share.
_BLACK = 0.005


def without_darkest(solution: Solution) -> tuple[Solution, Array]:
    """Return the solution with the black of each channel subtracted from its colours, and that black (3,).

    An unknown veil at one distance is an offset of each channel. Under water a strobe always makes one.
    """
    black = np.nanquantile(solution.J, _BLACK, axis=1).astype(np.float32)
    solution = replace(solution, J=solution.J - black[:, None], about=solution.about | {"black": black.tolist()})
    return solution.with_limits([DARKEST_AS_VEIL]), black


def has_unknown_veil(solution: Solution) -> bool:
    """Return whether the colours of most channels hold an offset that the observations do not determine."""
    return not solution.is_photograph and not is_determined(solution.uncertainty)


def is_in_air(observations: Observations, solution: Solution) -> bool:
    """Return whether the observations show that no channel is attenuated, so that there is no veil either.

    At least one channel must tell it, by the standard error of its beta: distances that are all alike tell nothing. One
    whose beta is 0, the end of the range, has no standard error.
    """
    far = float(np.quantile(observations.distance, 0.95))
    error = solution.uncertainty.standard_error.beta * far
    known = np.isfinite(error)
    return bool((solution.water.beta * far < _CLEAR).all() and known.any() and (error[known] < _CLEAR).all())
