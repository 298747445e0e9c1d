"""A view with its observations, `Observed`; the result of every solver, `Solution`, and how uncertain its water is.

With H and the residual cost of the reduced problem, sigma^2 = cost / (N - P - 3) over the pixels seen more than once,
and sigma^2 H^-1 is the covariance of B, beta and gamma for independent noise. If distances are similar, the data hardly
separate the parameters. The condition of H, scaled to unit diagonal, measures this: on made scenes 60 at distances of 2
to 10 m, 1.5e3 at 3 to 4 m, 5.9e4 at 3 to 3.3 m.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sucre_bench import Arrays
from sucre_bench.arrays import Array, Indices, Mask, evenly
from sucre_bench.camera import pixel_rays
from sucre_bench.errors import InputError, SolveError
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.machine.compute import Device
from sucre_bench.machine.progress import say, track
from sucre_bench.methods.sucre.model import TIED, ReducedSystem, WaterParameters, transmission, veil
from sucre_bench.methods.sucre.passes import Backend, Eliminated, Kernel, blocks, fill, opened
from sucre_bench.multiview.observations import Observations, pooled
from sucre_bench.scene import Encoding, Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.light import Light
    from sucre_bench.methods.sucre.sucre import Sucre

CHANNELS = ("red", "green", "blue")
_PARAMETERS = ("veiling light", "attenuation", "backscatter")

_TOO_FEW = "too few points lie in two views to tell the noise; nothing is known about errors"
_TYPICAL = (
    "at these distances, veil and attenuation cannot be told apart; typical water was assumed"
)
_NO_VEIL = "no veil can be seen, and none was removed"

# Tiles along each side of a target, whose errors count as independent; places in a block.
_TILES, _PLACES = 6, 1 << 16

# A parameter whose standard error is more than this share of its value is called undetermined.
_LOOSE = 0.5

# From this error on, as a share, colours of far ground get a word.
_WRONG = 0.1
FAR_COLOURS = "colours of far ground may be wrong by"

# The rounding of float32 sums of intensities, as a cost: 1e-6 rms of each observation.
ROUNDING = 1e-12

# The least transmission: less light says nothing about a colour, and its square would be no number in float32.
_DARKEST = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class WaterUncertainty:
    """What is known about the errors of a water.

    noise: (3,) standard deviation of an observation in each channel, in intensity; covariance: (3, 3, 3) of B, beta,
    gamma in each channel; standard_error: of each parameter, NaN where it is held at a bound; condition: (3,) of the
    scaled H; limits: in words, the parameters that the observations do not determine; is_weak: channels that a weak
    prior decides; alike: like covariance, where it is larger if residuals of neighbours and of a view are alike.
    """

    noise: Array
    covariance: Array
    standard_error: WaterParameters
    condition: Array
    limits: tuple[str, ...]
    is_weak: tuple[bool, bool, bool] = (False, False, False)
    alike: Array | None = None

    def with_limits(self, limits: Iterable[str]) -> WaterUncertainty:
        """Return the uncertainty with more limits."""
        return replace(self, limits=(*self.limits, *limits))


def is_determined(uncertainty: WaterUncertainty) -> bool:
    """Return whether the observations determine all three parameters of most channels, without a weak prior."""
    return sum(uncertainty.is_weak) < 2


def rescaled_to_noise(uncertainty: WaterUncertainty, noise: Array) -> WaterUncertainty:
    """Rescale covariance and errors to a given noise (3,): with robust weights the cost underestimates it."""
    ratio = np.divide(noise, uncertainty.noise, out=np.ones(3), where=uncertainty.noise > 0)
    covariance = uncertainty.covariance * ratio[:, None, None] ** 2
    error = WaterParameters.of_channels(uncertainty.standard_error.by_channel() * ratio[:, None])
    return replace(uncertainty, noise=noise, covariance=covariance, standard_error=error)


def clustered(
    uncertainty: WaterUncertainty,
    observations: Observations,
    water: WaterParameters,
    *,
    tied: bool = False,
) -> WaterUncertainty:
    """Return the uncertainty with errors that hold if the residuals of neighbours, or of a view, are alike.

    They are: texture, light and poses differ more between places and views than within. With s the sum of D'^T r over a
    cluster, H^-1 (sum s s^T) H^-1 needs independent clusters only (Liang & Zeger 1986). Clusters are tiles of the
    target, or views; each parameter has the largest error of these, and of independent observations. The covariance
    stays, since priors weigh colours with it; `alike` has the other. observations: that the water was fitted to, with
    `view`.
    """
    H, by_cluster = _cluster_sums(observations, water)
    H = TIED @ H @ TIED.T if tied else H
    before = uncertainty.standard_error.by_channel()
    error, alike = before.copy(), uncertainty.covariance.copy()
    for sums in by_cluster:
        s = TIED @ sums if tied else sums
        n = int((s != 0).any(axis=(0, 1)).sum())
        if n <= 3:
            continue
        for c in range(3):
            k = np.flatnonzero(np.isfinite(before[c]) & (np.diag(H[c]) > 0))
            effect = np.linalg.pinv(H[c][np.ix_(k, k)], rcond=1e-14, hermitian=True) @ s[c, k]
            covariance = effect @ effect.T * n / (n - 3)
            error[c, k] = np.fmax(error[c, k], np.sqrt(np.diag(covariance)))
            whole = np.zeros((3, 3))
            whole[np.ix_(k, k)] = covariance
            whole = TIED.T @ whole @ TIED if tied else whole
            alike[c] = whole if whole.trace() > alike[c].trace() else alike[c]
    error = error[:, [0, 1, 1]] if tied else error
    rows = water.by_channel()
    loose = [
        _loose(c, rows, error)
        for c in range(3)
        if not (uncertainty.is_weak[c] or _loose(c, rows, before))
    ]
    far = float(np.quantile(observations.distance, 0.95))
    limits = (*uncertainty.limits, *filter(None, loose), *far_colours(error[:, 1] * far))
    return replace(
        uncertainty, standard_error=WaterParameters.of_channels(error), limits=limits, alike=alike
    )


def far_colours(wrong: Array) -> list[str]:
    """Say by how much (3,) colours of far ground may be wrong, as a share, if that is much."""
    many = [
        f"{colour} {share:.0%}"
        for colour, share in zip(CHANNELS, wrong, strict=True)
        if share > _WRONG
    ]
    return (
        [f"light or water differs between places or views, so {FAR_COLOURS} {', '.join(many)}"]
        if many
        else []
    )


def _cluster_sums(observations: Observations, water: WaterParameters) -> tuple[Array, list[Array]]:
    """Return H (3, 3, 3), and the sums of D'^T r over tiles (3, 3, T) and over views (3, 3, V)."""
    (height, width), view, down = (
        observations.shape,
        observations.view,
        _TILES * observations.stacked,
    )
    y, x = np.divmod(observations.pixels, width)
    tile = y * down // height * _TILES + x * _TILES // width
    H, sums = (
        np.zeros((3, 3, 3)),
        [np.zeros((9, down * _TILES)), np.zeros((9, len(observations.views)))],
    )
    rows = tuple(column[..., None] for column in water.columns())
    for block in blocks(observations, _PLACES, stop=observations.n_repeated):
        columns = Eliminated.of(*fill(observations, block, np.float64), rows).columns
        D, scores = columns[:, :3], (columns[:, :3] * columns[:, 3:]).reshape(9, block.slots, -1)
        H += np.einsum("cikn,cjkn->cij", D, D)
        sums[0] += _summed(
            scores.sum(axis=1), tile[block.start : block.start + block.n], sums[0].shape[1]
        )
        for k, (n, part) in enumerate(observations.slots(block.start, block.start + block.n)):
            if view is not None:
                sums[1] += _summed(scores[:, k, :n], view[part], sums[1].shape[1])
    return H, [total.reshape(3, 3, -1) for total in sums]


def _summed(rows: Array, cluster: Indices, n: int) -> Array:
    """Return the sums (R, n) of rows (R, N) over the elements of each cluster (N,)."""
    return np.stack([np.bincount(cluster, row, n) for row in rows])


def for_known_water(uncertainty: WaterUncertainty) -> WaterUncertainty:
    """Return the uncertainty when the water is known from elsewhere: colours have noise, the water has no error."""
    kept = (_TOO_FEW,) if np.isnan(uncertainty.noise).any() else ()
    error = WaterParameters.of_channels(np.full((3, 3), np.nan))
    return replace(uncertainty, covariance=np.zeros((3, 3, 3)), standard_error=error, limits=kept)


def uncertainty_of(
    water: WaterParameters,
    system: ReducedSystem,
    free: Mask | None,
    n_excess: int,
    dead: Mask | None = None,
    weak: Mask | None = None,
    *,
    tied: bool = False,
) -> WaterUncertainty:
    """Return the uncertainty of a water from the system around it.

    free: (3 channels, 3) bool, parameters that no bound holds, None for all; n_excess: how many more observations than
    pixels there are, over pixels seen repeatedly; dead, weak: (3,) bool, channels without signal, and those that a weak
    prior decides; tied: gamma is beta.
    """
    dead, weak = (np.zeros(3, dtype=bool) if which is None else which for which in (dead, weak))
    free = np.ones((3, 3), dtype=bool) if free is None else free
    system = system.tied() if tied else system
    informed = (np.einsum("cii->ci", system.H) > 0) & ~dead[:, None]
    noise = np.sqrt(system.cost / (n_excess - 3)) if n_excess > 3 else np.full(3, np.nan)
    covariance, condition = np.zeros((3, 3, 3)), np.full(3, np.inf)
    error = np.full((3, 3), np.nan)
    for c, H in enumerate(system.H):
        k = np.flatnonzero(free[c] & informed[c])
        if not len(k):
            continue
        scale = 1 / np.sqrt(np.diag(H)[k])
        scaled = H[np.ix_(k, k)] * scale[:, None] * scale
        eigenvalues = np.linalg.eigvalsh(scaled)
        condition[c] = eigenvalues[-1] / max(eigenvalues[0], 1e-16)
        inverse = np.linalg.pinv(scaled, rcond=1e-14, hermitian=True) * scale[:, None] * scale
        covariance[c][np.ix_(k, k)] = noise[c] ** 2 * inverse
        error[c, k] = np.sqrt(np.diag(covariance[c])[k].clip(min=0))
    if tied:
        covariance, error, informed = (
            TIED.T @ covariance @ TIED,
            error[:, [0, 1, 1]],
            informed[:, [0, 1, 1]],
        )
    limits = _limits(water.by_channel(), error, free, informed, dead, weak)
    if n_excess <= 3:
        limits.append(_TOO_FEW)
    is_weak = bool(weak[0]), bool(weak[1]), bool(weak[2])
    return WaterUncertainty(
        noise, covariance, WaterParameters.of_channels(error), condition, tuple(limits), is_weak
    )


def _limits(
    water: Array, error: Array, free: Mask, informed: Mask, dead: Mask, weak: Mask
) -> list[str]:
    limits = []
    for c, colour in enumerate(CHANNELS):
        if dead[c]:
            limits.append(f"{colour}: black or white in all views; it was left as it is")
            continue
        if weak[c]:
            limits.append(f"{colour}: {_TYPICAL if water[c, 0] else _NO_VEIL}")
            continue
        limits += filter(None, [_loose(c, water, error)])
        for which, why in (
            (~informed[c], "cannot be told from these views"),
            (informed[c] & ~free[c], "at the end of the range"),
        ):
            if which.any():
                limits.append(f"{colour}: {' and '.join(np.array(_PARAMETERS)[which])} {why}")
    return limits


def _loose(c: int, water: Array, error: Array) -> str:
    """Name the parameters of a channel whose standard errors (3, 3) are large."""
    loose = [
        f"{name} {value:.3g} ± {spread:.2g}"
        for name, value, spread in zip(_PARAMETERS, water[c], error[c], strict=True)
        if spread > _LOOSE * abs(value)
    ]
    return f"{CHANNELS[c]}: is known only roughly: {', '.join(loose)}" * bool(loose)


# Pixels of the sample: a fit on 5,000 was within 1e-4 of the full cost; four times as many cost little. The fewest with
# equal footprints that are worth a fit of their own.
SAMPLE, _FEWEST_MATCHED = 20_000, 200


@dataclass(frozen=True, slots=True)
class LightRecord:
    """What the light was taken for: its parts, and the least light of a lens where pixels tell it."""

    parts: Sequence[str] = ()
    least: float | None = None


# The judge admits a model, and a picture counts as measured, with at most this share of a channel below zero.
MOST_NEGATIVE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A model that was fitted to half of a dive's views and judged on the others; see judge.py.

    held_out: its error in views that it has not seen, over that of no water; negative: (3,) share of colours below
    zero; drift: of colours from near to far ground, in a* b*, and that of the photograph.
    """

    model: str
    held_out: float
    negative: Sequence[float]
    drift: float
    drift_of_photograph: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """How a solution was found, in the words of its record; None where nothing was to be decided.

    solver: exact; adam; given, the water is from elsewhere; none, the photograph without a water. steps: passes over
    all observations; initial_cost: (3,) of Adam's start. footprint: whether the water was fitted to equal footprints;
    unexplained: their mean noise in it, an intensity; robust: "wrong", the share of observations that weights leave
    out; physical: whether colours were held above zero. model: what was fitted; judged: the models it was chosen from,
    the chosen one first. gains: of views by name, a number or three each; residuals: their
    statistics.
    """

    solver: Literal["exact", "adam", "given", "none"]
    device: str
    steps: int | None = None
    converged: bool | None = None
    initial_cost: Array | None = None
    footprint: bool | None = None
    unexplained: float | None = None
    robust: Mapping[str, float] | None = None
    physical: bool | None = None
    model: str | None = None
    judged: Sequence[Judged] | None = None
    light: LightRecord | None = None
    gains: Mapping[str, Any] | None = None
    residuals: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A water and the colours in it.

    J, deviation: (3, P) float32, in the order of `Observations.pixels`, intensities without water and their standard
    deviation; cost: (3,) sum of squared residuals; uncertainty: of the water; trust: (N,) robust weight of each
    observation, 0 to 1; light: that was removed from the observations; growth: (3, P), how many times larger than
    `deviation` the standard deviation is if residuals of neighbours and of a view are alike.
    """

    J: Array
    deviation: Array
    water: WaterParameters
    cost: Array
    uncertainty: WaterUncertainty
    course: Course
    trust: Array | None = None
    light: Light | None = None
    growth: Array | None = None

    @property
    def is_photograph(self) -> bool:
        return self.course.solver == "none"

    def with_limits(self, limits: Iterable[str]) -> Solution:
        """Return the solution with more limits."""
        return replace(self, uncertainty=self.uncertainty.with_limits(limits))

    def decided(self, **course: Any) -> Solution:
        """Return the solution with more in its course."""
        return replace(self, course=replace(self.course, **course))


@dataclass(frozen=True, eq=False)
class Observed:
    """A view of a scene as options see it: its image, and the observations of its pixels.

    light: of this view, that was removed from both; recorded: the view before that.
    """

    options: Sucre
    scene: Scene
    view: View
    observations: Observations
    light: Light | None = None
    recorded: View | None = None

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

        # light is a matter of views and rays
        view, is_evened = (
            self.recorded or self.view,
            self.light is not None,
        )
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
        return replace(self, view=view, observations=observations, light=alone, recorded=self.view)

    def coloured(
        self, water: WaterParameters, uncertainty: WaterUncertainty | None = None
    ) -> Solution:
        """Return the colours in a water: see `colours_for_water`."""
        options = self.options
        return colours_for_water(
            self.observations, water, uncertainty, options.backend, options.device
        )


# Targets of a dive, spread evenly over the scene; fewer serve where only its model is judged; and views whose light is
# fitted together at most: that takes minutes.
_TARGETS, JUDGED_TARGETS, TOGETHER = 40, 8, 512

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
        targets, linked, last = (
            list[Observed](),
            list[set[str]](),
            "no view shares a pixel with another",
        )
        spread = evenly(len(scene), most)
        is_linked = most == _TARGETS and len(scene) <= TOGETHER
        others = sorted(set(range(len(scene))) - set(spread)) if is_linked else []
        n = (
            max(2 * SAMPLE // _TARGETS, SAMPLE // len(spread))
            if most == _TARGETS
            else _JUDGED // len(spread)
        )
        for k in track(
            [*spread, *others], "shared water" if most == _TARGETS else "judging models"
        ):
            view, names = scene.views[k], {one.name for one in scene.views[k : k + 2]}
            if k in others and any(names <= group for group in linked):
                # it links nothing to the next view
                continue
            try:
                found = options.observe(scene, view, with_view=True, with_ray=True)
            except (InputError, SolveError) as fault:
                last = str(fault)
                if most == _TARGETS:
                    say(f"shared water skips {view.name}: {fault}")
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
                f"the scene's water cannot be fitted, {last}; use method.water=FILE with a known one"
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
            return observations.in_views(np.array([name in names for name in observations.views]))

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
    """A dive as half of its views show it; footprints: those of the dive in these views."""

    footprints: Observations | None = None

    @cached_property
    def matched(self) -> Observations | None:
        enough = self.footprints is not None and self.footprints.n_repeated >= _FEWEST_MATCHED
        return self.footprints if enough else None


def _pooled(scene: Scene, parts: Sequence[Observations]) -> Observations:
    return pooled(parts, [view.name for view in scene.views])


def colours_for_water(
    observations: Observations,
    water: WaterParameters,
    uncertainty: WaterUncertainty | None,
    backend: Backend | Literal["numpy"],
    device: Device,
) -> Solution:
    """Return the colours in a water that is known, from elsewhere (uncertainty None) or from a common fit."""
    with opened(observations, backend, device) as kernel:
        known = uncertainty or for_known_water(
            uncertainty_of(water, kernel.system(water), None, observations.n_excess)
        )
        return coloured(kernel, water, known, Course(solver="given", device=kernel.device))


def coloured(
    kernel: Kernel, water: WaterParameters, uncertainty: WaterUncertainty, course: Course
) -> Solution:
    """Return the colours of a kernel's observations."""
    J, deviation = kernel.colours(water, uncertainty.noise, uncertainty.covariance)
    growth = None
    if uncertainty.alike is not None:
        _, wide = kernel.colours(water, uncertainty.noise, uncertainty.alike)
        growth = np.divide(wide, deviation, out=np.ones_like(wide), where=deviation > 0).clip(min=1)
    return Solution(
        J, deviation, water, kernel.system(water).cost, uncertainty, course, growth=growth
    )


def sampled(observations: Observations, n: int, *, singles: bool, seed: int) -> Observations:
    """Return n random pixels of those seen more than once, and with `singles` as large a share of the others."""
    rng = np.random.default_rng(seed)
    repeated, all_pixels = observations.n_repeated, len(observations.pixels)
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
            known = np.flatnonzero(np.atleast_2d(observations.weight[..., part] > 0).all(axis=0))
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


def residuals_of(
    observations: Observations, J: Array, water: WaterParameters, v: Array | float = 1.0
) -> tuple[Array, Array, Array, Array]:
    """Return of observations the residuals sqrt(w) (I - J a - b), leverages h, information w a^2, and J a + b.

    All are (3, N), of the type of J (3, P). v: (3, N), robust parts of the weights. h = v w a^2 / sum v w a^2 over the
    pixel, so that r has the variance of the noise times 1 - h.
    """
    place = observations.place
    z, everything = observations.distance.astype(J.dtype), slice(None)
    B, beta, gamma = (column.astype(J.dtype) for column in water.columns())
    a = transmission(z, beta)
    information = information_of(observations, a, everything)
    I = observations.intensity(everything)
    r = I - J[:, place] * a - veil(z, B, gamma)
    known, total = v * information, np.zeros_like(J)
    for n, part in observations.slots():
        total[:, :n] += known[:, part]
    total = total[:, place]
    h = np.divide(known, total, out=np.zeros_like(known), where=total > 0)
    root = 1.0 if observations.weight is None else np.sqrt(observations.weight)
    return root * r, h, information, I - r


def information_of(observations: Observations, a: Array, part: slice) -> Array:
    """Return w a^2 (3, n) of observations with transmission a."""
    a = a.clip(min=_DARKEST)
    return np.asarray(
        a * a if observations.weight is None else observations.weight[..., part] * a * a
    )
