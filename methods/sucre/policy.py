"""Every decision on the way from observations to colours. Each is a function with a typed result.

| decision | function | result |
|---|---|---|
| stored intensities or linear light | `nearer_encoding` | `NearerEncoding` |
| which observations count less | `weighted` | observations, `WaterFit` and the share of wrong ones, None for none |
| noise that grows with light | `evenly_noisy` | observations and `WaterFit`, None for even weights |
| colours held above zero | `held_above_zero` | `WaterFit`, None if the free fit stays |
| light that differs | `choose` | `Chosen` |
| the water, or the photograph without one | `is_guess` | bool |
| blur that is not the footprint's | `blurred` | a sentence, None for none |
| what becomes of a veil that is not determined | `veil_of` | `Veil` |

What was decided is in `Solution.course`, and from there in the record of the view.

encoding=auto takes the encoding in which the model explains more. Water acts on light. A camera's files store a curve
of it, and the curve is often near sRGB. Where it is, the model explains linear light better; where the file holds
something else, as the demo does, stored intensities. The water is fitted to equal footprints in both, and the residuals
of linear light are divided by the slope of the curve. So both are in stored units, in which noise is alike.

One rule decides which parts of light (light.py) the observations pay for: pixels that no fit has seen. The image is cut
into tiles. Each model is fitted to every second tile and judged on the others, then the reverse. Its cost is the
bounded misfit of robust.py, in units of the noise without the new part. Errors within a tile are alike, so tiles count
as the independent ones: a model is taken if the mean gain over the tiles is more than three of its standard errors, and
more than a small share of the cost. Even light is judged against gains of views and channels with a lens. How much of
each there is, their spreads tell (light.py); a part without any is left out. Then a strobe is judged in place of the
lens.

Gains can stand for attenuation, where each view sees the ground from another distance. Then they explain a little, far
less than where light differs. Noise that grows with light gets weights if beta is known better with them.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import Any, Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import NotApplicableError, SolveError
from sucre_bench.imaging.display import normalisation
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.exact import WaterFit, fit
from sucre_bench.methods.sucre.known_water import water_of
from sucre_bench.methods.sucre.light import (
    EVEN,
    TILES,
    Light,
    LightFit,
    Parts,
    Problem,
    Sample,
    fit_light,
    parts_of,
    residuals_in,
)
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.paper import start_of
from sucre_bench.methods.sucre.passes import Backend, opened
from sucre_bench.methods.sucre.refine_noise import balanced, decoding_slope
from sucre_bench.methods.sucre.robust import (
    C2,
    WRONG,
    contradicted_views,
    fit_robustly,
    is_better,
    lies_in_patches,
    reweighted,
    robust_noise,
    trust,
    trusted,
)
from sucre_bench.methods.sucre.solution import (
    CHANNELS,
    FAR_COLOURS,
    SAMPLE,
    TOGETHER,
    Course,
    Dive,
    LightRecord,
    Observed,
    Solution,
    Tried,
    WaterUncertainty,
    clustered,
    coloured,
    colours_for_water,
    far_colours,
    is_determined,
    rescaled_to_noise,
    residuals_of,
    sampled,
    uncertainty_of,
)
from sucre_bench.multiview.observations import Observations
from sucre_bench.plugins.call_method import display_of
from sucre_bench.scene import Scene

# Pixels that observations are judged on, whether they fit, and pixels that both encodings are fitted to.
_JUDGED, _PIXELS = 5_000, 2_000

# Fewer wrong observations than this share change no water.
_FEW_WRONG = 1e-3

# A fit with colours above zero may leave residuals whose cost is larger by this share: .01 to .02 on photographs whose
# free fit takes shade for a veil. Noise of JPEG files makes dark colours negative with any veil; pushing them up raised
# the cost by .2 to 2.5.
_RISE = 0.05

# Linear light is chosen where it leaves less than this share of the residuals of stored intensities. Made scenes in
# linear light had .79 to .89, others 1.3 to 1.6; with uneven light, and on real photographs, both were near 1.
_BETTER = 0.95

# Observations that decide their pixel's colour alone have no residual.
_ALONE = 0.9

# Distances are alike if their percentile 95 is less than this many times their percentile 5. beta is not told from the
# light where its standard error over the median distance is above this optical depth.
_ALIKE, _LOOSE = 1.5, 0.1

# Blur that grows with distance looks like attenuation, less so in footprints so many times wider. Images are blurred if
# beta then falls by more than this: optical depth of the farthest, times standard errors, in the means of the channels.
# It is .13 and more under forward scatter, .08 at most over ripples of the ground. The least share of beta that is
# worth a word; the fewest pixels.
_WIDER, _BLURRED, _LITTLE, _ENOUGH = 3.0, 0.1, 0.02, 1_000

# With weights for noise that grows with light, the standard errors of beta must be below this share of those without,
# in the mean of the channels. They are at .3 to .75 under caustics, at .86 to 1.5 on photographs, at 1 in plain scenes.
_SHARPER = 0.8

# Gains of this much are worth a word: of exposure, and of channels.
_DIFFERENT = {1: 0.05, 3: 0.01}

# Less optical depth than this over the farthest distances is none. Pure water has as much in red over half a metre.
_AS_IN_AIR = 0.15

_AIR = "nothing dims these images with distance, as in air; no veil was removed"

# A channel is lost if its typical colour has a larger standard deviation than this, the whole scale.
_LOST = 1.0

# A view that shares less than this share of its points gets a word.
_OVERLAP = 0.05

_NO_OVERLAP = "if this view overlaps others, its depth map or pose is wrong; `sucre-bench describe` tells more"
_MIXED = "distances do not separate it from attenuation, so colours of far ground may be wrong"

_PHOTOGRAPH = (
    "these views do not determine the water; the colours are those of the photograph, and the display stretches "
    "them; take views from more distances"
)

NONE = WaterParameters.of_channels(np.zeros((3, 3)))


def solved(seen: Observed) -> tuple[Observed, Solution]:
    """Return the solution in the water that the options name, and what it explains: in even light, if that differs."""
    if seen.options.water not in ("own", "shared"):
        known = water_of(seen.options.water, seen.scene, seen.view, seen.encoding)
        if not known.gains:
            return seen, seen.coloured(known.water)
        seen = seen.evened(Light.of_gains(known.gains, known.water))
        return seen, seen.coloured(known.water).decided(gains=known.gains)
    is_shared, said = seen.options.water == "shared", list[str]()
    fitted = _of_dive(seen.scene, seen.options) if is_shared else _fitted_in_own_light(seen)
    if isinstance(fitted, SolveError):
        raise type(fitted)(*fitted.args)  # a new one: a traceback holds what a view has in memory
    if is_shared and fitted.light is not None and not fitted.light.is_known_of(seen.view.name):
        said.append("too few pixels are shared with others to find this view's exposure; the typical one was taken")
        light = fitted.light.with_typical(seen.view.name)
        own = np.exp(light.gains[-1])[0 if light.parts.gains == 1 else slice(None)].tolist()
        fitted = replace(fitted, light=light).decided(gains={**(fitted.course.gains or {}), seen.view.name: own})
    if (share := seen.observations.n_repeated / max(1, int(np.count_nonzero(seen.view.depth > 0)))) < _OVERLAP:
        said.append(f"only {share:.1%} of the points lie where other views see them; {_NO_OVERLAP}")
    if is_in_air(seen.observations, fitted):
        others = [limit for limit in fitted.uncertainty.limits if not limit.startswith(CHANNELS)]
        uncertainty = replace(fitted.uncertainty, limits=(_AIR, *others), is_weak=(False, False, False))
        fitted = replace(fitted, uncertainty=uncertainty)
    even = seen if fitted.light is None else seen.evened(fitted.light)
    solution = fitted.colours_of(even.observations, **seen.options.compute)
    if is_guess(solution):
        solution = _photograph(even, solution)
    return even, solution.with_limits([*said, *([] if is_shared else blurred(seen, solution))])


@functools.lru_cache(maxsize=4)  # every view of the scene asks for it
def _of_dive(scene: Scene, options: Any) -> Fitted | SolveError:
    """Return the common water; or why there is none, which is kept too, since finding out takes as long."""
    try:
        if len(scene) <= TOGETHER or options.light == EVEN:
            return _fitted_in_own_light(Dive.spread(options, scene))
        fitted = _fitted_in_own_light(Dive.spread(replace(options, light="even"), scene))
    except SolveError as fault:
        return fault
    said = f"the light of more than {TOGETHER} views is not fitted together; if it differs, give parts of the dive"
    return replace(fitted, uncertainty=fitted.uncertainty.with_limits([said]))


def _fitted_in_own_light(seen: Observed) -> Fitted:
    options, matched = seen.options, seen.matched if seen.options.footprint else None
    fitted = fit_water(seen.observations, matched, **options.fitting)
    parts = parts_of(options.light, "method.light")
    if parts == Parts() or (parts is None and not options.footprint) or (few := seen.matched) is None:
        return fitted
    if fitted.noise is not None:  # animals tell nothing of the light
        few = reweighted(few, fitted.free, robust_noise(few, fitted.free))
    chosen = choose(few, seen.view.name, parts, may_be_strobe=not options.one_coefficient)
    if chosen.fit is not None:
        return _in_even_light(seen, seen.evened(chosen.fit.light), chosen)
    return fitted.decided(light=LightRecord(tried=list(chosen.tried))) if chosen.tried else fitted


def _in_even_light(seen: Observed, even: Observed, chosen: Chosen) -> Fitted:
    """Return the water of observations that were brought to even light, and what to say of their light.

    The water is fitted anew, except under a strobe, whose veil is another. Its errors include those of the light.
    """
    assert chosen.fit is not None
    assert seen.matched is not None
    light, of_light = chosen.fit.light, chosen.fit.error
    if not even.observations.n_repeated:
        raise NotApplicableError("the light leaves no pixel that two views show; use method.light=even")
    if light.strobe is None:
        matched = light.removed(seen.matched) if seen.options.footprint else None
        fitted = fit_water(even.observations, matched, **seen.options.fitting)
    else:
        alone = even.coloured(replace(NONE, beta=light.water.beta))
        fitted = Fitted(alone.water, alone.water, alone.uncertainty, alone.course)
    near, median, far = np.quantile(seen.matched.distance, (0.05, 0.5, 0.95))
    is_mixed = (light.parts.strobe and far <= _ALIKE * near) or light.is_far_off
    is_mixed |= bool((of_light[:, 1] * median >= _LOOSE).any())
    uncertainty = fitted.uncertainty
    before = uncertainty.standard_error.by_channel()
    error, alike = np.fmax(before, of_light), uncertainty.alike
    if alike is not None:  # errors of beta are most of what places and views share
        alike = alike * np.divide(error, before, out=np.ones((3, 3)), where=before > 0)[:, 1, None, None] ** 2
    uncertainty = replace(uncertainty, standard_error=WaterParameters.of_channels(error), alike=alike)
    if is_mixed and light.parts.strobe:
        uncertainty = replace(uncertainty, is_weak=(True, True, True))
    said = [f"{one}; {_MIXED}" if is_mixed else one for one in sentences_of(light)]
    if not any(FAR_COLOURS in limit for limit in uncertainty.limits):
        said += far_colours(error[:, 1] * far)
    by_view = zip(light.views, np.exp(light.gains[:, 0] if light.parts.gains == 1 else light.gains), strict=True)
    gains = {name: gain.tolist() for name, gain in by_view if np.isfinite(gain).all()}
    if unknown := [name for name in even.observations.views if name not in gains]:
        said.append(f"views that share too few pixels to find their light took no part: {', '.join(unknown)}")
    fitted = replace(fitted, uncertainty=uncertainty.with_limits(said), light=light)
    return fitted.decided(
        light=LightRecord(
            parts=light.parts.words,
            tried=list(chosen.tried),
            least=light.least if light.falls_off else None,
            strobe=None if light.strobe is None else {"position": light.strobe.position, "lobe": light.strobe.lobe},
        ),
        gains={seen.view.name: 1.0} | gains if light.parts.gains else None,
    )


def sentences_of(light: Light) -> list[str]:
    """Say what was removed."""
    said = []
    if light.parts.gains:
        gains = np.exp(light.gains)
        low, high = np.nanmin(gains), np.nanmax(gains)
        what = "exposure" if light.parts.gains == 1 else "white balance"
        if high > (1 + _DIFFERENT[light.parts.gains]) * low:
            said.append(f"{what} differs between views; gains of {low:.2f} to {high:.2f} were fitted")
    if light.parts.lens and light.least < 1 - _DIFFERENT[3]:
        said.append(f"light falls off across the images, to {light.least:.0%} in the corners; the falloff was removed")
    if light.strobe is not None:
        said.append("a strobe beside the camera was fitted, and its light removed")
    return said


# -- the exact fit: weights, and colours above zero ---------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A water that was fitted to observations.

    free: before priors that count by clusters, and before colours above zero; noise: (3,) of a pixel's observation if
    robust weights count, which need it; light: that was removed before.
    """

    water: WaterParameters
    free: WaterParameters
    uncertainty: WaterUncertainty
    course: Course
    noise: Array | None = None
    light: Light | None = None

    def decided(self, **course: Any) -> Fitted:
        """Return it with more in its course."""
        return replace(self, course=replace(self.course, **course))

    def colours_of(self, observations: Observations, *, backend: Backend = "auto", device: Device = "auto") -> Solution:
        """Return the colours of observations in this water, with weights for how well they fit if these count."""
        of_all, uncertainty = None, self.uncertainty
        if self.noise is not None:
            of_all = trust(observations, self.water, self.noise)
            observations = trusted(observations, of_all)
        with opened(observations, backend, device) as kernel:
            if self.noise is None:  # the water's errors come from a sample, the colours' from their own noise
                own = uncertainty_of(self.water, kernel.system(self.water), None, observations.n_excess)
                noise = np.where(np.isfinite(own.noise), own.noise, uncertainty.noise)
                uncertainty = replace(uncertainty, noise=noise)
            solution = coloured(kernel, self.water, uncertainty, replace(self.course, device=kernel.device))
        return replace(solution, trust=of_all, light=self.light)


def fit_water(
    observations: Observations,
    matched: Observations | None = None,
    *,
    physical: bool = False,
    one_coefficient: bool = False,
    robust: bool | Literal["auto"] = False,
    backend: Backend = "auto",
    device: Device = "auto",
) -> Fitted:
    """Fit the water; with `robust`, to observations weighted by how well they fit. Raises what `fit` raises.

    matched: observations of some pixels that the water is fitted to instead (see multiview/footprints.py). Weak priors
    then count by errors that hold if the residuals of neighbours, or of a view, are alike.
    """
    how = partial(fit, one_coefficient=one_coefficient, backend=backend, device=device)
    sharp = sampled(observations, SAMPLE, singles=physical, seed=0)
    to_fit, said, noise, wrong = observations if matched is None else matched, list[str](), None, None
    found, weights = how(to_fit), None
    if matched is not None and (sharper := evenly_noisy(to_fit, found, how, backend, device)) is not None:
        to_fit, found = sharper
    few = sharp if matched is None else to_fit
    if robust:
        weights, said = weighted(few, matched is None, found, how, is_forced=robust is True)
    if weights is not None:
        to_fit, found, wrong = weights
        noise = robust_noise(sharp, found.water)
        if matched is None:
            to_fit = trusted(observations, trust(observations, found.water, noise))
            found = how(to_fit)
    elif robust and matched is not None:  # footprints that are cut off are left out of the fit, and may spoil colours
        v = trust(judged := sampled(sharp, _JUDGED * sharp.stacked, singles=False, seed=0), found.water)
        if (share := float((v < WRONG).mean())) > _FEW_WRONG and lies_in_patches(judged, v < WRONG):
            noise, wrong, said = robust_noise(sharp, found.water), share, contradicted_views(judged, v)
    free = found.water
    if matched is not None:
        how = partial(how, growth=grown(found, to_fit, one_coefficient))
        found = how(to_fit, near=found.water)
    above = held_above_zero(to_fit, None if matched is None else sharp, found, how) if physical else None
    found = above or found
    uncertainty = found.uncertainty if noise is None else rescaled_to_noise(found.uncertainty, noise)
    if matched is not None:
        uncertainty = clustered(uncertainty, to_fit, found.water, tied=one_coefficient)
    course = Course(
        solver="exact",
        device="cpu",
        steps=found.passes,
        converged=found.converged,
        footprint=matched is not None,
        unexplained=None if matched is None else float(robust_noise(few, found.water).mean()),
        robust=None if wrong is None else {"wrong": wrong},
        physical=above is not None if physical else None,
    )
    return Fitted(found.water, free, uncertainty.with_limits(said), course, noise)


def grown(found: WaterFit, to_fit: Observations, tied: bool) -> Array:
    """Return how many times larger (3,) errors are than those of independent observations: rms over the parameters."""
    old = found.uncertainty.standard_error.by_channel()
    new = clustered(found.uncertainty, to_fit, found.water, tied=tied).standard_error.by_channel()
    known = np.isfinite(old) & (old > 0)
    squares = np.divide(new, old, out=np.zeros((3, 3)), where=known) ** 2
    return np.sqrt(squares.sum(axis=1) / known.sum(axis=1).clip(1)).clip(1)


def weighted(
    few: Observations, is_sharp: bool, plain: WaterFit, how: Callable[..., WaterFit], *, is_forced: bool
) -> tuple[tuple[Observations, WaterFit, float] | None, list[str]]:
    """Return observations with robust weights where these serve, the fit to them, and the share of wrong ones.

    And what to say of contradicted views.
    few: that water and weights are iterated on; is_sharp: whether they are a sample of those of the plain fit, without
    weights; is_forced: whether weights are wanted in any case.
    """
    judged = sampled(few, _JUDGED * few.stacked, singles=False, seed=0)
    if not (is_forced or (trust(judged, plain.water) < WRONG).mean() > _FEW_WRONG):
        return None, []
    found, to_fit = fit_robustly(few, how, plain=None if is_sharp else plain)
    v = trust(judged, found.water)
    said = contradicted_views(judged, v)
    if not (is_forced or is_better(judged, plain.water, found.water, v)):
        return None, said
    return (to_fit, found, float((v < WRONG).mean())), said


def evenly_noisy(
    to_fit: Observations, plain: WaterFit, how: Callable[[Observations], WaterFit], backend: Backend, device: Device
) -> tuple[Observations, WaterFit] | None:
    """Return the fit with weights for noise that grows with light; None if it does not know beta better."""
    even = balanced(to_fit, colours_for_water(to_fit, plain.water, None, backend, device))
    found = how(even)
    old = clustered(plain.uncertainty, to_fit, plain.water).standard_error.beta
    new = clustered(found.uncertainty, even, found.water).standard_error.beta
    known = np.isfinite(old) & (old > 0)
    return (even, found) if known.any() and (new[known] / old[known]).mean() < _SHARPER else None


def held_above_zero(
    to_fit: Observations, sharp: Observations | None, free: WaterFit, how: Callable[..., WaterFit]
) -> WaterFit | None:
    """Return the fit whose colours are held above zero; None if it explains the observations worse than the free one.

    sharp: whose colours are held, where `to_fit` has equal footprints. Without these it always counts.
    """
    above = how(to_fit, physical=True, sharp=sharp)
    return above if sharp is None or (above.cost <= (1 + _RISE) * free.cost).all() else None


# -- what is not known ----------------------------------------------------------------------------------------


def is_in_air(observations: Observations, fitted: Fitted) -> bool:
    """Decide whether nothing dims the images: no channel has a veil or is attenuated, and the distances tell it.

    A beta of 0, the end of the range, may have no error. Then distances must differ: all alike, they tell nothing.
    """
    uncertainty, water = fitted.uncertainty, fitted.water
    near, far = np.quantile(observations.distance, (0.05, 0.95))
    error = uncertainty.standard_error.beta * far
    told = error[np.isfinite(error)] < _AS_IN_AIR
    is_told = told.all() if len(told) else far > _ALIKE * near
    is_clear = not water.B.any() and (water.beta * far < _AS_IN_AIR).all()
    return bool(all(uncertainty.is_weak) and is_clear and is_told)


def is_guess(solution: Solution) -> bool:
    """Decide whether the water is a guess: weak priors decide it in most channels, and noise fills a channel."""
    return not is_determined(solution.uncertainty) and bool((np.median(solution.deviation, axis=1) > _LOST).any())


def _photograph(seen: Observed, solution: Solution) -> Solution:
    """Return the photograph without a water. Its standard deviation is that of one observation."""
    without = seen.coloured(NONE)
    uncertainty = replace(without.uncertainty, limits=(_PHOTOGRAPH,), is_weak=(True, True, True))
    J = start_of(seen.observations, seen.intensities.reshape(-1, 3)).astype(np.float32)
    deviation = np.broadcast_to(uncertainty.noise[:, None], J.shape).astype(np.float32)
    course = replace(solution.course, solver="none")
    return replace(without, J=J, deviation=deviation, uncertainty=uncertainty, course=course, light=solution.light)


def blurred(seen: Observed, solution: Solution) -> list[str]:
    """Say if the images hold blur that is not the footprint's, such as forward scatter: see _WIDER.

    A wide footprint holds marine snow and animals too, and JPEG files have wide ones anyway: nothing tells there.
    """
    unknown = solution.is_under_strobe or solution.is_photograph or solution.trust is not None or seen.view.is_jpeg
    if unknown or not seen.options.footprint or seen.matched is None:
        return []
    few = sampled(seen.matched, _JUDGED, singles=False, seed=0)
    wide = seen.matched_at(few.pixels, _WIDER)
    if len(common := np.intersect1d(few.pixels, wide.pixels)) < _ENOUGH:
        return []
    both = [one.take(np.flatnonzero(np.isin(one.pixels, common))) for one in (few, wide)]
    both = [solution.light.removed(one) if solution.light else one for one in both]
    try:
        narrow, wider = (fit(one, one_coefficient=seen.options.one_coefficient, near=solution.water) for one in both)
    except SolveError:
        return []
    error = clustered(narrow.uncertainty, both[0], narrow.water).standard_error.beta
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


class Veil(Enum):
    """What becomes of a veil that is not determined, an offset of each channel."""

    KNOWN = "nothing: it is determined, or there is none"
    UNSAID = "it stays in the colours; the display removes it, or it is a strobe's"
    SAID = "it stays in the picture, and the record says so"
    DARKEST = "the darkest colours of each channel are taken for it"


def veil_of(solution: Solution, options: Any) -> Veil:
    """Decide what becomes of the veil of most channels. Under water a strobe always makes one."""
    if is_determined(solution.uncertainty) or solution.is_photograph:
        return Veil.KNOWN
    if solution.is_under_strobe:
        return Veil.DARKEST if options.refine else Veil.UNSAID
    return Veil.UNSAID if normalisation(display_of(options)).removes_offsets else Veil.SAID


# -- encoding -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class NearerEncoding:
    """The encoding that the model explains better; ratio: residuals of linear light over those of stored intensities.

    They are those of the fits that decided: without gains if these refuse linear light, else with a gain for each view.
    None if nothing tells.
    """

    encoding: Literal["view", "linear"]
    ratio: float | None = None


def nearer_encoding(seen: Observed) -> NearerEncoding:
    """Return the encoding in which the water of a view explains more: stored intensities where too few pixels tell.

    seen: stored intensities. The footprints of linear light are means of decoded images: over rough texture, decoded
    means of stored intensities explain neither encoding. Linear light must also explain more where each view has a
    gain: a camera's exposure that follows the distance is a curve.
    """
    if seen.options.water != "own" or seen.view.encoding == "linear" or seen.matched is None:
        return NearerEncoding("view")
    few = sampled(seen.matched, _PIXELS, singles=False, seed=0)
    try:
        decoded = replace(seen, options=replace(seen.options, encoding="linear")).matched_at(few.pixels)
        for parts in (Parts(), Parts(gains=1)):
            stored = _residual(seen, few, parts)
            linear = _residual(seen, decoded, parts, decoding_slope)
            if not linear < _BETTER * stored:
                return NearerEncoding("view", linear / stored if stored > 0 else None)
    except (NotApplicableError, SolveError):
        return NearerEncoding("view")
    return NearerEncoding("linear", linear / stored)


def _residual(
    seen: Observed, sample: Observations, parts: Parts, slope: Callable[[Array], Array] = np.ones_like
) -> float:
    """Return the median size of studentised residuals in stored units; slope: of intensities by stored ones."""
    water = fit(sample, **seen.options.compute).water
    if parts != Parts():
        few = Sample.of(sample, seen.view.name)
        light = fit_light(few, parts, Light.even(water, few.views)).light
        sample, water = light.removed(sample), light.water
    J = replace(seen, observations=sample).coloured(water).J
    r, h, _, explained = residuals_of(sample, J, water)
    recorded = explained if sample.weight is None else explained * np.sqrt(sample.weight)
    r = r / slope(recorded.clip(0, 1))
    return float(np.median(np.abs(r / np.sqrt(1 - h.clip(0, _ALONE)))[h < _ALONE]))


# -- which parts of light the observations pay for -------------------------------------------------------


# Pixels that parts are chosen on, the fewest worth it, and pixels that the chosen light is fitted to.
_TRIED_ON, _FEWEST, _FITTED = 1_500, 200, 4_000

# Standard errors, and the share of the cost, that a part must gain. Light that differs gains .45 to 1, under seven mild
# faults too; gains of views that stand for attenuation gain .11 to .16 on photographs of a camera with manual exposure.
_SURE, _SHARE = 3.0, 0.3

# The share of the squared residuals that a rough descent must save before more is fitted, which saves time.
_PROMISED = 0.1

# All but a strobe. A strobe is tried where the lens leaves less light than this in the corners, which saves time.
_ALL, _DIM = Parts(gains=3, lens=True), 0.8

# From here on, a channel may have been cut off.
_FULL = 0.99


@dataclass(frozen=True, slots=True, eq=False)
class Chosen:
    """The light of the chosen parts, None for even light, and the models that were judged."""

    fit: LightFit | None
    tried: tuple[Tried, ...] = ()


def choose(matched: Observations, target: str, parts: Parts | None, *, may_be_strobe: bool) -> Chosen:
    """Return the light of observations with `view` and `ray`; target: a name; parts: None to choose them."""
    whole = uncut(matched)
    if whole.n_repeated < _FEWEST or parts == Parts():
        return Chosen(None)
    few = sampled(whole, _TRIED_ON, singles=False, seed=0)
    water, tried = fit(few).water, list[Tried]()
    light = Light.even(water, whole.views)
    if parts is None:
        noise = robust_noise(whole, water)
        parts, light, tried = _chosen(Sample.of(few, target), light, noise, may_be_strobe=may_be_strobe)
        if parts == Parts():
            return Chosen(None, tuple(tried))
    sample = Sample.of(sampled(whole, _FITTED, singles=False, seed=0), target)
    return Chosen(fit_light(sample, parts, light), tuple(tried))


def uncut(observations: Observations) -> Observations:
    """Return the pixels that no view shows with a channel at the end of the scale, where light is cut off."""
    kept = np.ones(len(observations.pixels), dtype=bool)
    for n, part in observations.slots():
        kept[:n] &= (observations.intensity(part) < _FULL).all(axis=0)
    return observations if kept.all() else observations.take(np.flatnonzero(kept))


def _chosen(sample: Sample, light: Light, noise: Array, *, may_be_strobe: bool) -> tuple[Parts, Light, list[Tried]]:
    """Return the parts of light that count, the light that was fitted with them, and every model that was judged.

    light: even.
    """
    tile, fold = sample.tile[0] * TILES + sample.tile[1], sample.tile.sum(axis=0) % 2
    halves = [(sample.take(fold == k), tile[fold == k]) for k in range(2)]
    parts, tried, problem = light.parts, list[Tried](), Problem(sample, _ALL)
    start = problem.unknowns(light)
    promises = problem.descend(start, _PROMISED)[1].cost < (1 - _PROMISED) * problem.system(start).cost
    if not promises or min(len(tile) for _, tile in halves) < _FEWEST // 2:  # what views share lies in few tiles
        return parts, light, tried
    better, cost = _ALL, _held_out(halves, parts, light, noise)
    while not parts.strobe:
        found = fit_light(sample, better, light)
        new = _held_out(halves, better, found.light, noise)
        gain = (cost - new)[cost + new > 0]
        if len(gain) < 2:  # noise-free: nothing is left to explain
            break
        sigmas = float(gain.mean() / max(gain.std(ddof=1) / np.sqrt(len(gain)), 1e-12))
        tried.append(Tried(better.words, float(gain.sum() / cost.sum()), sigmas))
        if not (tried[-1].gain > _SHARE and sigmas > _SURE):
            break
        parts, light, cost = found.needed, found.light, new
        if not may_be_strobe or light.least > _DIM:
            break
        better = replace(parts, lens=False, strobe=True)
    return parts, light, tried


def _held_out(halves: list[tuple[Sample, Array]], parts: Parts, light: Light, noise: Array) -> Array:
    """Return the bounded misfit of each tile, from the fit to the other half."""
    cost = np.zeros(TILES**2)
    for (fitted, _), (judged, tile) in (halves, halves[::-1]):
        found = fit_light(fitted, parts, light).light
        r, _, leverage = residuals_in(judged, replace(found, gains=np.nan_to_num(found.gains)))
        squares = (r**2 / noise[:, None, None] ** 2 / np.maximum(1 - leverage, 1e-3)).sum(axis=0)
        cost += np.bincount(tile, (squares / (1 + squares / C2)).sum(axis=1), TILES**2)
    return cost
