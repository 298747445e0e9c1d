"""Restores a view with the water that its options name, or shows the photograph, and says why.

| decision | function | result |
|---|---|---|
| the model that is fitted | `chosen_model` in judge.py | `Verdict` |
| the water of the view or of the dive | `fit_model` in models.py | `Fitted` |
| whether nothing dims the images | `is_in_air` | bool |
| the photograph where the water is a guess | `is_guess` | bool |
| what becomes of a veil that is not determined | `veil_of` | `Veil` |

What was decided is in `Solution.course`, and from there in the record of the view.
"""

from __future__ import annotations

import functools
from contextlib import suppress
from dataclasses import replace
from enum import Enum
from typing import Any

import numpy as np

from sucre_bench.errors import SolveError
from sucre_bench.imaging.display import normalisation
from sucre_bench.methods.sucre.exact import check_pairs
from sucre_bench.methods.sucre.judge import NO_WATER, NONE, Verdict, chosen_model, judging
from sucre_bench.methods.sucre.known_water import water_of
from sucre_bench.methods.sucre.light import EVEN, EVEN_LIGHT, Light
from sucre_bench.methods.sucre.models import Fit, Fitted, Model, fit_model, is_in_air, stepped
from sucre_bench.methods.sucre.observed import TOGETHER, Dive, Observed
from sucre_bench.methods.sucre.solution import MOST_NEGATIVE, Course, Solution
from sucre_bench.methods.sucre.uncertainty import (
    CHANNELS,
    UNKNOWN,
    WaterUncertainty,
    is_determined,
    with_disagreement,
)
from sucre_bench.plugins.call_method import display_of
from sucre_bench.scene import Scene

_AIR = "nothing dims these images with distance, as in air; no veil was removed"

# A channel is lost if its typical colour has a larger standard deviation than this, the whole scale.
_LOST = 1.0

# A view that shares less than this share of its points gets a word.
_OVERLAP = 0.05

_NO_OVERLAP = "if this view overlaps others, its depth map or pose is wrong; `sucre-bench describe` tells more"

_PHOTOGRAPH = (
    "these views do not determine the water; the colours are those of the photograph, and the display stretches "
    "them; take views from more distances"
)

_NOT_BETTER = (
    "no water predicts views that it was not fitted to 5 % better than none; the colours are those of the photograph, "
    "and the display stretches them"
)

_COMMON = "{}, so the dive's common water was taken, and the exposure of its first view"
_UNDETERMINED = "this view alone does not determine a water"
_NEGATIVE = "this view's own water makes {:.0%} of a channel darker than black"

_TYPICAL_EXPOSURE = "too few pixels are shared with others to find this view's exposure; the typical one was taken"

_UNJUDGED = "too few views overlap to judge a water on views that it was not fitted to"


def solved(seen: Observed) -> tuple[Observed, Solution]:
    """Return the solution in the water that the options name, and what it explains: in even light, if that differs."""
    options = seen.options
    if options.water not in ("own", "shared"):
        known = water_of(options.water, seen.scene, seen.view, seen.encoding)
        if not known.gains:
            return seen, seen.coloured(known.water)
        seen = seen.evened(Light.of_gains(known.gains, known.water))
        return seen, seen.coloured(known.water).decided(gains=known.gains)
    check_pairs(seen.observations)
    said = list[str]()
    if len(seen.scene) > TOGETHER and options.water == "shared" and options.light != EVEN:
        options = replace(options, light=EVEN)
        said.append(
            f"the light of more than {TOGETHER} views is not fitted together; if it differs, give parts of the dive"
        )
    verdict = chosen_model(seen.scene, judging(options))
    even, solution, words = _restored(seen, options, verdict)
    if (
        share := seen.observations.n_repeated
        / max(1, int(np.count_nonzero(seen.view.depth > 0)))
    ) < _OVERLAP:
        said.append(
            f"only {share:.1%} of the points lie where other views see them; {_NO_OVERLAP}"
        )
    if verdict.is_unjudged:
        said.append(_UNJUDGED)
    solution = solution.decided(model=verdict.model.words, judged=verdict.judged or None)
    return even, solution.with_limits([*said, *words])


def _restored(
    seen: Observed, options: Any, verdict: Verdict
) -> tuple[Observed, Solution, list[str]]:
    """Return the view in even light, its solution by the chosen model, and what to say."""
    if verdict.model == NO_WATER:
        limit = _PHOTOGRAPH if verdict.is_unjudged else _NOT_BETTER
        limit = _AIR if verdict.is_in_air else limit
        return (
            seen,
            _photograph(
                seen, Course(solver="none", device="cpu"), limit, is_clear=verdict.is_in_air
            ),
            [],
        )
    if options.water == "shared":
        return _in_water_of_dive(seen, options, verdict)
    if verdict.model.fit is Fit.EARLY:
        # its colours stop near the photograph's, as its water stops near its start
        early = stepped(verdict.model, seen)
        uncertainty = _doubted(early.uncertainty, verdict)
        growth = seen.coloured(early.water, uncertainty).growth
        early = replace(early, uncertainty=uncertainty, growth=growth)
        return seen, _unless_guessed(seen, early), []
    fitted = fit_model(verdict.model, seen)
    fitted = replace(fitted, uncertainty=_doubted(fitted.uncertainty, verdict))
    even, solution = _coloured(seen, fitted)
    negative = _most_negative(solution)
    is_dark = negative > MOST_NEGATIVE
    has_own = is_determined(solution.uncertainty) and not is_dark
    has_common = verdict.judged and (
        len(seen.scene) <= TOGETHER or verdict.model.light == EVEN_LIGHT
    )
    if has_common and not has_own:
        with suppress(SolveError):
            even_in_dive, in_dive, words = _in_water_of_dive(seen, options, verdict)
            is_fit = _most_negative(in_dive) < max(negative, MOST_NEGATIVE)
            if is_fit and not in_dive.is_photograph:
                why = _NEGATIVE.format(negative) if is_dark else _UNDETERMINED
                return even_in_dive, in_dive, [_COMMON.format(why), *words]
    return even, solution, []


def _most_negative(solution: Solution) -> float:
    """Return the share of colours below zero in the channel that has most."""
    return float((solution.J < 0).mean(axis=1).max())


def _doubted(uncertainty: WaterUncertainty, verdict: Verdict) -> WaterUncertainty:
    """Return the uncertainty of a water with the disagreement of waters that are as good."""
    if verdict.disagreement is None:
        return uncertainty
    return with_disagreement(uncertainty, np.array(verdict.disagreement))


def _in_water_of_dive(
    seen: Observed, options: Any, verdict: Verdict
) -> tuple[Observed, Solution, list[str]]:
    """Return the view in even light, its solution in the common water of the dive, and what to say."""
    fitted = _of_dive(seen.scene, judging(options), verdict.model)
    if isinstance(fitted, SolveError):
        # a new one: a traceback holds what a view has in memory
        raise type(fitted)(*fitted.args)
    fitted = replace(fitted, uncertainty=_doubted(fitted.uncertainty, verdict))
    if fitted.light is None or fitted.light.is_known_of(seen.view.name):
        return *_coloured(seen, fitted), []
    light = fitted.light.with_typical(seen.view.name)
    own = np.exp(light.gains[-1])[0 if light.parts.gains == 1 else slice(None)].tolist()
    fitted = replace(fitted, light=light).decided(
        gains={**(fitted.course.gains or {}), seen.view.name: own}
    )
    return *_coloured(seen, fitted), [_TYPICAL_EXPOSURE]


@functools.lru_cache(maxsize=4)  # every view of the scene asks for it
def _of_dive(scene: Scene, options: Any, model: Model) -> Fitted | SolveError:
    """Return the common water; or why there is none, which is kept too, since finding out takes as long."""
    try:
        return fit_model(model, Dive.spread(options, scene))
    except SolveError as fault:
        return fault


def _coloured(seen: Observed, fitted: Fitted) -> tuple[Observed, Solution]:
    """Return the view in the light of the fit, and its colours in the water."""
    if is_in_air(seen.observations, fitted):
        others = [
            limit for limit in fitted.uncertainty.limits if not limit.startswith(CHANNELS)
        ]
        uncertainty = replace(
            fitted.uncertainty,
            limits=(_AIR, *others),
            is_weak=(False, False, False),
            standard_error=UNKNOWN,
        )
        fitted = replace(fitted, uncertainty=uncertainty)
    even = seen if fitted.light is None else seen.evened(fitted.light)
    return even, _unless_guessed(
        even, fitted.colours_of(even.observations, **seen.options.compute)
    )


def _unless_guessed(even: Observed, solution: Solution) -> Solution:
    """Return a solution, or the photograph where its water is a guess."""
    if not is_guess(solution):
        return solution
    photograph = _photograph(even, replace(solution.course, solver="none"), _PHOTOGRAPH)
    return replace(photograph, light=solution.light)


def is_guess(solution: Solution) -> bool:
    """Decide whether the water is a guess: weak priors decide it in most channels, and noise fills a channel."""
    return not is_determined(solution.uncertainty) and bool(
        (np.median(solution.deviation, axis=1) > _LOST).any()
    )


def _photograph(
    seen: Observed, course: Course, limit: str, *, is_clear: bool = False
) -> Solution:
    """Return the photograph without a water, and why; is_clear: in a medium that is known to dim nothing.

    Its standard deviation is that of one observation.
    """
    without = seen.coloured(NONE)
    uncertainty = replace(without.uncertainty, limits=(limit,), is_weak=(not is_clear,) * 3)
    J = seen.first_colours(seen.observations).astype(np.float32)
    deviation = np.broadcast_to(uncertainty.noise[:, None], J.shape).astype(np.float32)
    return replace(without, J=J, deviation=deviation, uncertainty=uncertainty, course=course)


class Veil(Enum):
    """What becomes of a veil that is not determined, an offset of each channel."""

    KNOWN = "nothing: it is determined, or there is none"
    UNSAID = "it stays in the colours, and the display removes it"
    SAID = "it stays in the picture, and the record says so"


def veil_of(solution: Solution, options: Any) -> Veil:
    """Decide what becomes of the veil of most channels."""
    if is_determined(solution.uncertainty) or solution.is_photograph:
        return Veil.KNOWN
    return Veil.UNSAID if normalisation(display_of(options)).removes_offsets else Veil.SAID
