"""Chooses the model of a dive by what it predicts in views that it has not seen.

Every second view of the dive is one half; of three views, each pair is taken for one. Each model is fitted to one half,
and predicts the other, for some targets:

- *held-out error*: the median of |predicted - observed| over means of tiles of the target, in each view of the other
  half, over that of no water, where a colour is the mean of its observations. One gain for each view and channel is
  fitted to predicted means alike, so that no model gains by an exposure that nobody could foresee. Means over a tile do
  not see blur, nor poses and depth that are pixels off.
- *negative*: the share of colours below zero in a channel. A veil and colours that share an offset explain views
  alike: residuals cannot see it, but it makes many colours negative.
- *drift*: how far, in a* b*, the median shown colour of the farthest third of the target lies from that of the nearest
  third. Water that is removed too much turns far ground.

A model is admissible if at most 5 % of the colours in each channel are negative, and its drift is at most 1.2 times the
photograph's, or that of the first steps of the paper's Adam where these tell a water and leave no more negative: a veil
pales far ground, so a photograph drifts less. The admissible model of the least held-out error leads; of those within
5 %, the one that stands first in `_candidates`: fewer parts of light, footprints before pixels, since these are right
where poses and depth are, and robust weights before equal ones. It must predict better than the paper's steps, or these
are taken: drift, which sees differences of the ground too, does not rule them out. They stop near their start, so they
must predict 5 % better than it does: a start that the views do not move is no measurement. The photograph stays if
neither is 5 % better than no water, or than the light of the chosen model without its water: a lamp can explain views
alone. It stays, too, if the chosen water is no better than the mean of its attenuation in all channels and no veil,
since that is a lamp's falloff with distance. Each measure is the median over the targets.

What is wrong alike in many views (light, depth, poses) shows in no residual. So the water's errors count, too, how far
the waters of the halves lie apart, and those of other admissible models that predict as well (`disagreement`).
docs/supplement.md has the tables of real dives and of made seas behind this rule.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask, evenly
from sucre_bench.errors import NotApplicableError, SolveError
from sucre_bench.imaging.cielab import to_lab
from sucre_bench.imaging.display import display
from sucre_bench.machine.cache import get_or_make
from sucre_bench.machine.files import user_cache
from sucre_bench.machine.provenance import hash_of
from sucre_bench.methods.sucre.light import EVEN, EVEN_LIGHT, Light, LightFit, Parts, parts_of
from sucre_bench.methods.sucre.model import WaterParameters, transmission, veil
from sucre_bench.methods.sucre.models import Fit, Fitted, Model, fit_model, is_in_air, light_of
from sucre_bench.methods.sucre.observed import JUDGED_TARGETS, Dive, sampled
from sucre_bench.methods.sucre.paper import INITIAL_WATER
from sucre_bench.methods.sucre.robust import trust, trusted
from sucre_bench.methods.sucre.solution import MOST_NEGATIVE, Judged
from sucre_bench.methods.sucre.sucre import Sucre
from sucre_bench.multiview.observations import Observations
from sucre_bench.plugins.call_method import is_in_run
from sucre_bench.scene import Scene

# Targets, and pixels of each, that models are judged on.
_TARGETS = 3
_PIXELS = 10_000
# Tiles along the longer side; fewest pixels of a tile's mean, and fewest means that tell anything.
_TILES = 30
_FEWEST = 8
_ENOUGH = 30

# Views of a longer scene that take part, neighbours in its middle.
_VIEWS = 64

# Lights that tell whether any differs: without a gain from one of them, no other is tried.
_TELLING = (Parts(lens=True), Parts(3, lens=True))

# The rule: see above.
BETTER = 0.95
_TIE = 1.05
_DRIFT = 1.2

# The display that drift is measured in.
_SHOWN = "black-0.5-white-99"

NONE = WaterParameters.of_channels(np.zeros((3, 3)))
NO_WATER = Model(Fit.NOTHING)


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """The chosen model."""

    model: Model

    judged: tuple[Judged, ...] = ()
    """Those it was chosen from, the chosen one first."""

    is_unjudged: bool = False
    """Whether there was a choice that no views could make."""

    is_in_air: bool = False
    """Whether nothing dims the images."""

    disagreement: Sequence[Sequence[Sequence[float]]] | None = None
    """Covariance of B, beta and gamma (3 channels, 3, 3) among waters that predict unseen views as well."""


def judging(options: Any) -> Any:
    """Return the options that decide a method's model and common water, so that methods of one run share a verdict."""
    decide = {
        **vars(options),
        "water": "own",
        "colours": "multi_view",
        "refine": False,
        "fill": False,
    }
    return Sucre(**decide)


@functools.lru_cache(maxsize=4)  # every view of the scene asks for it
def chosen_model(scene: Scene, options: Any) -> Verdict:
    """Return the model of a dive, of those that the options allow.

    Without two halves that overlap it is the first steps of the paper, or what the options say; and the photograph, if
    the steps predict the views they were fitted to no better than their start. In a run, a verdict is stored in the
    user's cache for other processes and runs.
    """
    allowed, early = list(_candidates(options)), list(_early(options))
    if len(allowed) == 1:
        return Verdict(allowed[0])
    by_words = {model.words: model for model in (NO_WATER, *allowed, *early)}

    def read(path: Path) -> Verdict | None:
        with suppress(OSError, ValueError, LookupError, TypeError):
            stored = json.loads(path.read_bytes())
            judged = tuple(Judged(**one) for one in stored["judged"])
            return Verdict(**{**stored, "model": by_words[stored["model"]], "judged": judged})
        return None

    def make(path: Path) -> Verdict:
        verdict = _judged(scene, options, allowed, early)
        if not verdict.is_unjudged:
            stored = {**asdict(verdict), "model": verdict.model.words}
            path.write_text(json.dumps(stored), encoding="utf-8")
        return verdict

    if not (scene.data_id and is_in_run()):
        return _judged(scene, options, allowed, early)
    of = [scene.data_id, [view.name for view in scene.views], repr(options)]
    key = hash_of((Path(__file__).parent,), ("torch", "jax"), of)
    try:
        return get_or_make(user_cache() / "judged" / f"{key}.json", read, make, silent_s=-1)
    except OSError:  # no place to write to
        return _judged(scene, options, allowed, early)


def _judged(scene: Scene, options: Any, allowed: list[Model], early: list[Model]) -> Verdict:
    middle = max(0, (len(scene) - _VIEWS) // 2)
    part = (
        replace(scene, views=scene.views[middle : middle + _VIEWS])
        if len(scene) > _VIEWS
        else scene
    )
    unjudged = Verdict([*early, *allowed][0], is_unjudged=True)
    try:
        dive = Dive.spread(options, part, JUDGED_TARGETS)
    except (SolveError, NotApplicableError):
        return unjudged
    court = Court.of(dive)
    if found := court and court.verdict(allowed, early):
        return found
    court = Court.of(dive, on_itself=True)
    steps = court.judged(early[0]) if court and early else None
    if court and steps and not court.moves(steps, early[0]):
        return replace(unjudged, model=NO_WATER)
    return unjudged


def _candidates(options: Any) -> Iterator[Model]:
    """Yield the models that options allow, the preferred ones first."""
    given = parts_of(options.light)
    lights = (
        [EVEN_LIGHT, Parts(lens=True), Parts(1, lens=True), Parts(3, lens=True)]
        if given is None
        else [given]
    )
    for light in lights:
        for fit in (Fit.FOOTPRINTS, Fit.PIXELS):
            for is_robust in (True, False):
                for is_physical in (False, True):
                    model = Model(fit, is_physical, is_robust, light=light)
                    if _allows(options.footprint, fit is Fit.FOOTPRINTS) and (
                        _allows(options.physical, is_physical)
                        and _allows(options.robust, is_robust)
                    ):
                        yield model


def _early(options: Any) -> Iterator[Model]:
    """Yield the models of the paper's first steps that options allow."""
    is_plain = options.light in ("auto", EVEN) and options.footprint is not True
    if is_plain and options.physical is not True and options.robust is not True:
        for one_coefficient in (False, True):
            yield Model(Fit.EARLY, one_coefficient=one_coefficient)


def _allows(option: Any, value: bool) -> bool:
    return option == "auto" or option is value


@dataclass(frozen=True, eq=False)
class Target:
    """Some pixels of a target, which models are judged on."""

    observations: Observations
    """With `view` and `ray`."""

    distance: Array
    """From the target's camera, (P,) m."""

    @cached_property
    def intensity(self) -> Array:
        return self.observations.intensity(slice(None)).astype(np.float64)

    @cached_property
    def place(self) -> Indices:
        return self.observations.place

    @cached_property
    def tile(self) -> Indices:
        """The tile of each pixel, (P,)."""
        height, width = self.observations.shape
        side = max(height, width) / _TILES
        y, x = np.divmod(self.observations.pixels, width)
        return (y // side).astype(np.int64) * _TILES + (x // side).astype(np.int64)

    def seen_in(self, names: frozenset[str]) -> Mask:
        """Return whether each observation (N,) is of one of these views."""
        assert self.observations.view is not None
        is_named = np.array([name in names for name in self.observations.views])
        return np.asarray(is_named[self.observations.view])

    def colours(self, fit: Fitted | None, used: Mask) -> tuple[Array, Array, Array]:
        """Return the colours J (3, P) of the used observations (N,) bool, and what a and b are times l (3, N).

        fit: None for no water. Observations count less where the fit has robust weights.
        """
        z, n = self.observations.distance.astype(np.float64), len(self.observations.pixels)
        water = NONE if fit is None else fit.water
        l: Array = np.ones((3, len(z)))
        weight: Array = used.astype(np.float64)
        even = self.observations
        if fit is not None and fit.light is not None:
            light = _typical(fit.light, even)
            l, even = light.on(even), light.removed(even)
        if fit is not None and fit.noise is not None:
            weight = used * trust(trusted(even, used.astype(np.float32)), water, fit.noise)
        a = l * transmission(z, water.beta[:, None])
        b = l * veil(z, water.B[:, None], water.gamma[:, None])
        seen, information = (
            np.stack(
                [np.bincount(self.place, channel * weight, n) for channel in values]
            ).astype(np.float64)
            for values in (a * (self.intensity - b), a * a)
        )
        return (
            np.divide(seen, information, out=np.full((3, n), np.nan), where=information > 0),
            a,
            b,
        )

    def errors(
        self, fit: Fitted | None, half: frozenset[str], on_itself: bool = False
    ) -> Array:
        """Return the errors (3, M) of tile means in views outside a half, by a fit to the half: shares of the scale.

        on_itself: in the views of the half instead.
        """
        assert self.observations.view is not None
        used = self.seen_in(half)
        J, a, b = self.colours(fit, used)
        judged = (used if on_itself else ~used) & np.isfinite(J[0, self.place])
        predicted = (J[:, self.place] * a + b)[:, judged]
        of = (
            self.tile[self.place[judged]] * len(self.observations.views)
            + self.observations.view[judged]
        )
        tiles, which, n = np.unique(of, return_inverse=True, return_counts=True)
        means = [
            np.stack([np.bincount(which, channel, len(tiles)) for channel in values])[
                :, n >= _FEWEST
            ]
            / n[n >= _FEWEST]
            for values in (predicted, self.intensity[:, judged])
        ]
        view = tiles[n >= _FEWEST] % len(self.observations.views)
        errors = np.empty_like(means[0])
        for k in np.unique(view):
            guess, true = (mean[:, view == k] for mean in means)
            gain = np.median(true / guess.clip(min=1e-3), axis=1, keepdims=True)
            errors[:, view == k] = np.abs(gain * guess - true)
        return errors

    def drift(self, J: Array) -> float:
        """Return the drift of colours (3, P), as they are shown."""
        known = np.isfinite(J).all(axis=0)
        z = self.distance[known]
        near, far = np.quantile(z, (1 / 3, 2 / 3))
        shown = to_lab(
            display(np.ascontiguousarray(J[:, known].T[:, None], np.float32), _SHOWN)
        )[:, 0]
        between = np.median(shown[z >= far], axis=0) - np.median(shown[z <= near], axis=0)
        return float(np.hypot(*between[1:]))


def _typical(light: Light, observations: Observations) -> Light:
    """Return the light of all views of observations, with the median of the gains where a gain is not known."""
    gains = light.over(observations.views).gains
    typical = np.nan_to_num(np.nanmedian(light.gains, axis=0))
    return replace(
        light, views=observations.views, gains=np.where(np.isfinite(gains), gains, typical)
    )


def _grey(water: WaterParameters) -> WaterParameters:
    """Return a dimming with distance that is alike in all channels, and no veil."""
    return WaterParameters.of_channels(np.outer(np.ones(3), [0, water.beta.mean(), 0]))


@dataclass(frozen=True, eq=False)
class Court:
    """A dive whose models are judged."""

    halves: list[frozenset[str]]
    """Names of views that models are fitted to."""

    parts: list[Dive]
    """The dive as each half shows it, and whole."""

    targets: list[tuple[Target, float, float]]
    """Each with the median of no water's errors, and the photograph's drift."""

    on_itself: bool = False
    """Whether fits to all views are judged on these views."""

    lights: dict[tuple[Parts, bool], list[LightFit]] = field(default_factory=dict)
    """One for each of `parts`. The key is the parts of the light, and whether it was fitted robustly."""

    fitted: dict[Model, list[Fitted]] = field(default_factory=dict)
    """Fits of each model, one for each of `parts`."""

    @staticmethod
    def of(dive: Dive, on_itself: bool = False) -> Court | None:
        """Return the court of a dive; None if its halves share too little.

        on_itself: judge fits to all views on these.
        """
        names = dive.observations.views
        if on_itself:
            parts = [names]
        elif len(names) == 3:
            parts = [names[:2], names[::2], names[1:]]
        else:
            parts = [names[::2], names[1::2]]
        halves = [frozenset(part) for part in parts if len(part) > 1]
        if not halves:
            return None
        targets = []
        for k in evenly(len(dive.targets), _TARGETS):
            view = dive.targets[k].view
            whole = dive.options.observe(dive.scene, view, with_view=True, with_ray=True)
            few = sampled(whole, _PIXELS, singles=False, seed=0)
            target = Target(few, view.distance.ravel()[few.pixels])
            plain = np.concatenate(
                [target.errors(None, half, on_itself).ravel() for half in halves]
            )
            if len(plain) >= 3 * _ENOUGH and np.median(plain) > 0:
                J, *_ = target.colours(None, np.ones(len(few), dtype=bool))
                targets.append((target, float(np.median(plain)), target.drift(J)))
        if not targets:
            return None
        return Court(halves, [*map(dive.half, halves), dive], targets, on_itself)

    def fits(self, model: Model) -> list[Fitted]:
        """Return the fits of a model to the parts: to the halves from where the fit to all views ended."""
        *halves, dive = self.parts
        key = model.light, model.is_robust
        if model.light != EVEN_LIGHT and key not in self.lights:
            of_all = light_of(model, dive)
            self.lights[key] = [*(light_of(model, half, of_all) for half in halves), of_all]
        lights = self.lights.get(key, [None] * len(self.parts))
        whole = fit_model(model, dive, lights[-1])
        of_halves = [
            fit_model(model, half, light, whole)
            for half, light in zip(halves, lights[:-1], strict=True)
        ]
        self.fitted[model] = [*of_halves, whole]
        return self.fitted[model]

    def held_out(self, fits: list[Fitted]) -> float:
        """Return the error of fits to the halves in the views that they have not seen, over that of no water."""
        over = []
        for target, plain, _ in self.targets:
            errors = [
                target.errors(fit, half, self.on_itself).ravel()
                for fit, half in zip(fits, self.halves, strict=True)
            ]
            over.append(float(np.median(np.concatenate(errors))) / plain)
        return float(np.median(over))

    def in_water(
        self, model: Model, water: Callable[[WaterParameters], WaterParameters]
    ) -> float:
        """Return the error of a fitted model with other waters than its own, over that of no water in even light."""
        *of_halves, _ = self.fitted[model]
        return self.held_out([replace(fit, water=water(fit.water)) for fit in of_halves])

    def moves(self, judged: Judged, steps: Model) -> bool:
        """Decide whether the paper's steps predict better than the water they start from."""
        return judged.held_out <= BETTER * self.in_water(steps, lambda _: INITIAL_WATER)

    def tells_water(self, judged: Judged, model: Model) -> bool:
        """Decide whether a model predicts better than none, than its light alone, and than a lamp's falloff."""
        light_alone = 1.0 if model.light == EVEN_LIGHT else self.in_water(model, lambda _: NONE)
        is_coloured = judged.held_out < self.in_water(model, _grey)
        return judged.held_out <= BETTER * min(1, light_alone) and is_coloured

    def judged(self, model: Model) -> Judged | None:
        """Return the measures of a model; None if it cannot be fitted."""
        try:
            fits = self.fits(model)
        except (SolveError, NotApplicableError):
            return None
        negative, drift = [], []
        for target, *_ in self.targets:
            every = np.ones(len(target.observations), dtype=bool)
            J, *_ = target.colours(fits[-1], every)
            negative.append((J < 0).mean(axis=1))
            drift.append(target.drift(J))
        return Judged(
            model=model.words,
            held_out=self.held_out(fits[:-1]),
            negative=np.median(negative, axis=0).tolist(),
            drift=float(np.median(drift)),
            drift_of_photograph=float(
                np.median([of_photograph for *_, of_photograph in self.targets])
            ),
        )

    def verdict(self, allowed: list[Model], early: list[Model]) -> Verdict | None:
        """Return the choice among the allowed models and the paper's first steps; None if no half can be fitted."""
        known: dict[Model, Judged] = {}

        def judge(models: list[Model]) -> None:
            for model in models:
                one = None if model in known else self.judged(model)
                if one is not None:
                    known[model] = one

        def best(models: list[Model], most_drift: float = np.inf) -> list[Model]:
            admissible = [
                model
                for model in models
                if model in known and is_admissible(known[model], most_drift)
            ]
            least = min((known[model].held_out for model in admissible), default=np.inf)
            return [model for model in admissible if known[model].held_out <= _TIE * least]

        if self.parts[-1].matched is None:
            allowed = [model for model in allowed if model.fit is Fit.PIXELS] or allowed
        first = [
            m
            for m in allowed
            if (m.is_physical, m.is_robust) == (allowed[-1].is_physical, allowed[-1].is_robust)
        ]
        simplest = first[0].light
        judge([model for model in first if model.light == simplest])
        judge(
            [model for model in first if model.fit == first[0].fit and model.light in _TELLING]
        )
        of_simplest = min(
            (known[model].held_out for model in known if model.light == simplest),
            default=np.inf,
        )
        if min((one.held_out for one in known.values()), default=np.inf) < BETTER * of_simplest:
            # light differs
            judge(first)
        least_error = sorted(known, key=lambda model: known[model].held_out)[:1]
        judge(early)
        if not known:
            return None
        telling = [
            model
            for model in early
            if model in known
            and self.moves(known[model], model)
            and self.tells_water(known[model], model)
        ]
        steps = best(telling)[:1]
        drifts = [
            known[model].drift for model in telling if is_admissible(known[model], np.inf)
        ]
        most_drift = _DRIFT * max([next(iter(known.values())).drift_of_photograph, *drifts])
        if leading := best(allowed, most_drift) or least_error:
            judge(
                [
                    model
                    for model in allowed
                    if (model.fit, model.light) == (leading[0].fit, leading[0].light)
                ]
            )
        # `min` takes the first of equals: the paper's steps.
        leaders = [*steps, *best(allowed, most_drift)[:1]]
        chosen = min(leaders, key=lambda model: known[model].held_out, default=NO_WATER)
        if chosen not in (NO_WATER, *telling) and not self.tells_water(known[chosen], chosen):
            chosen = NO_WATER
        even = next((model for model in known if model.light == EVEN_LIGHT), None)
        is_clear = (
            chosen == NO_WATER
            and even is not None
            and is_in_air(self.parts[-1].observations, self.fitted[even][-1])
        )
        others = sorted(known.values(), key=lambda one: one.held_out)
        in_order = tuple(sorted(others, key=lambda one: one.model != chosen.words))
        disagreement = None if chosen == NO_WATER else self.disagreement(chosen, known)
        return Verdict(chosen, in_order, is_in_air=is_clear, disagreement=disagreement)

    def disagreement(
        self, chosen: Model, known: Mapping[Model, Judged]
    ) -> list[list[list[float]]]:
        """Return the covariance of B, beta and gamma (3 channels, 3, 3) among waters as good as the chosen model's.

        They are those of its fits to the halves, and of other models that predict as well.
        """
        *halves, whole = (fit.water.by_channel() for fit in self.fitted[chosen])
        as_good = _TIE * known[chosen].held_out
        equals = [
            self.fitted[model][-1].water.by_channel() - whole
            for model, one in known.items()
            if is_admissible(one, np.inf) and one.held_out <= as_good
        ]
        apart = [each / math.sqrt(len(equals)) for each in equals]
        # the jackknife that leaves out half of the views, or a third
        kept = np.mean([len(half) for half in self.halves])
        left_out = len(self.parts[-1].observations.views) - kept
        scale = math.sqrt(kept / left_out / len(halves))
        apart += [scale * (half - np.mean(halves, axis=0)) for half in halves]
        each = np.reshape(apart, (-1, 3, 3))
        return np.einsum("kci,kcj->cij", each, each).tolist()


def is_admissible(judged: Judged, most_drift: float) -> bool:
    """Return whether colours are above zero, and those of far ground turned no more than is allowed."""
    return max(judged.negative) <= MOST_NEGATIVE and judged.drift <= most_drift
