"""Light that differs between observations, fitted together with the water.

    I = l (J a + b)

a and b as in model.py. All that multiplies light is one family: log l is a sum of known terms with unknown
coefficients.

| part | what it adds | what it stands for |
|---|---|---|
| exposure | to log l one number for each view but the target | a camera that exposes automatically |
| white_balance | the same for each channel | a camera that also balances white automatically |
| lens | to log l six terms of the place in the image, the same in all views | vignetting |

Colours are eliminated as in model.py. Newton's method then fits the water and the coefficients together. l is 1 in
the middle of the target.

Distances separate light from water only in part, and what a simple model leaves out looks like light. So the
coefficients of exposure, of white balance and of the lens each have a normal prior. The observations tell its spread s:
with prior precision C / s^2 and posterior covariance V, s^2 = u^T C u / (rank C - tr(C V) / s^2) is iterated (MacKay
1992, "Bayesian Interpolation"). A part with less spread than .01 is left out. The noise counts what neighbours share
(`_shared`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask
from sucre_bench.errors import InputError
from sucre_bench.machine.compute import compiled
from sucre_bench.methods.sucre.minimise import Bounds, minimise
from sucre_bench.methods.sucre.model import (
    LEAST,
    ReducedSystem,
    WaterParameters,
    eliminated,
    transmission,
    veil,
)
from sucre_bench.multiview.observations import Observations

# Terms of the lens.
TERMS = 6


def terms(at: Array) -> Array:
    """Return the six terms (6, ...) of places or directions (2, ...)."""
    x, y = at
    r = x * x + y * y
    return np.stack([x, y, x * x, x * y, y * y, r * r])


# Standard deviation of coefficients beforehand, logarithms of light, the most.
_WEAK = 0.7
# The noise of the one observation that a weak prior is worth.
_NOISE = 0.01

# The least spread of coefficients, the least whose changes matter, rounds that find the spreads, the change of their
# squares that ends them, and the fewest coefficients that tell one.
_LEAST = 1e-3
_SMALL = 3e-3
_ROUNDS = 15
_SETTLED = 0.1
_TOLD = 0.01

# Tiles along each side of the target, and of all images, in which errors are alike.
TILES = 6

# Starts of beta and gamma, as optical depths over the median distance, besides the water fitted without light.
_STARTS = ((0.1, 0.3), (0.7, 0.7))

# Pixels that the starts are tried on.
_SCREEN = 300

# Tolerance of the starts and of the last descent.
_ROUGHLY = 1e-4
_TOLERANCE = 1e-6

# Largest logarithm of a coefficient, and optical depth over the median distance.
_MOST = 3.0
_DEEPEST = 30.0

_PART = 1 << 16  # observations at a time


@dataclass(frozen=True, slots=True)
class Parts:
    """Which parts the light has."""

    gains: int = 0
    """Numbers a view: 0, 1 (exposure) or 3 (white_balance)."""

    lens: bool = False

    @property
    def words(self) -> list[str]:
        has = (self.gains == 1, self.gains == 3, self.lens)
        return [word for word, one in zip(_WORDS, has, strict=True) if one]


EVEN_LIGHT = Parts()

AUTO = "auto"
EVEN = "even"
_WORDS = {"exposure": Parts(1), "white_balance": Parts(3), "lens": Parts(lens=True)}


def parts_of(words: str) -> Parts | None:
    """Return the parts that a user chose, "exposure+lens"; None for auto. InputError for others."""
    if words == AUTO:
        return None
    parts = EVEN_LIGHT
    for word in words.split("+") if words != EVEN else []:
        if word not in _WORDS:
            known = (AUTO, EVEN, *_WORDS)
            raise InputError(
                f"method.light: '{word}' is not a choice; use one of {', '.join(known)}, or parts joined by +"
            )
        one = _WORDS[word]
        parts = Parts(max(parts.gains, one.gains), parts.lens or one.lens)
    return parts


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """P pixels that several views show, in V views: a table with a gap where a view does not show a pixel."""

    z: Array
    """Shape (P, V), metres."""

    I: Array
    """Shape (3, P, V)."""

    weight: Array
    """Of squared residuals, (3, P, V), 0 in gaps."""

    ray: Array
    """The x / z and y / z in the view's camera, (2, P, V)."""

    views: tuple[str, ...]
    """V names."""

    target: int
    """Index of the view whose gain is 1."""

    tile: Indices
    """Row and column of the tile of the target that has the pixel, (2, P)."""

    @staticmethod
    def of(few: Observations, target: str) -> Sample:
        """Return the sample of observations with `view` and `ray`; target: a name; if no view has it, the fullest."""
        assert few.view is not None
        assert few.ray is not None
        size = (len(few.pixels), len(few.views))
        z, I, weight, ray = (
            np.ones(size),
            np.zeros((3, *size)),
            np.zeros((3, *size)),
            np.zeros((2, *size)),
        )
        for n, part in few.slots():
            at = np.arange(n), few.view[part]
            z[at], ray[:, *at] = few.distance[part], few.ray[:, part]
            I[:, *at] = few.intensity(part)
            weight[:, *at] = 1 if few.weight is None else few.weight[..., part]
        fullest = few.views[int((weight[0] > 0).sum(axis=0).argmax())]
        y, x = np.divmod(few.pixels, few.shape[1])
        tile = np.stack([y * TILES // few.shape[0], x * TILES // few.shape[1]])
        return Sample(
            z,
            I,
            weight,
            ray,
            few.views,
            few.views.index(target if target in few.views else fullest),
            tile,
        )

    def take(self, which: Mask | slice) -> Sample:
        """Return the sample of some pixels."""
        I, weight, ray = self.I[:, which], self.weight[:, which], self.ray[:, which]
        return Sample(
            self.z[which], I, weight, ray, self.views, self.target, self.tile[:, which]
        )

    @property
    def shown(self) -> Mask:
        """(P, V) bool: whether a view shows a pixel."""
        return np.asarray((self.weight > 0).any(axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """Light, and the water it was fitted with."""

    parts: Parts
    water: WaterParameters
    views: tuple[str, ...]

    gains: Array
    """Logarithms, (V, 3): 0 for the target, NaN for a view that the fit did not see."""

    lens: Array
    """Coefficients of `terms`, (6,)."""

    extent: float
    """Largest |x / z| or |y / z| of the sample."""

    @staticmethod
    def even(water: WaterParameters, views: tuple[str, ...]) -> Light:
        return Light(EVEN_LIGHT, water, views, np.zeros((len(views), 3)), np.zeros(TERMS), 1.0)

    @staticmethod
    def of_gains(gains: Mapping[str, Any], water: WaterParameters) -> Light:
        """Return the light of gains by name, each a number or three; water: in the exposure of gain 1."""
        known = np.stack(
            [np.broadcast_to(np.asarray(gain, dtype=np.float64), 3) for gain in gains.values()]
        )
        return Light(Parts(3), water, tuple(gains), np.log(known), np.zeros(TERMS), 1.0)

    def is_known_of(self, view: str) -> bool:
        """Whether the light of a view is known: all have the same, or its gains were fitted."""
        known = [
            name
            for name, gains in zip(self.views, self.gains, strict=True)
            if np.isfinite(gains).all()
        ]
        return not self.parts.gains or view in known

    def over(self, views: tuple[str, ...]) -> Light:
        """Return the light of some views, NaN for gains of those that the fit did not see."""
        unknown = np.full((1, 3), np.nan if self.parts.gains else 0)
        place = [self.views.index(name) if name in self.views else -1 for name in views]
        return replace(self, views=views, gains=np.concatenate([self.gains, unknown])[place])

    def with_typical(self, view: str) -> Light:
        """Return the light with gains of a view that are the median of those of the others."""
        others = [k for k, name in enumerate(self.views) if name != view]
        gains = self.gains[others]
        views = [self.views[k] for k in others]
        return replace(
            self, views=(*views, view), gains=np.vstack([gains, np.nanmedian(gains, axis=0)])
        )

    def least_on(self, observations: Observations) -> float:
        """Return the least light of the lens on observations with `ray`, over the largest: percentiles 1 and 99."""
        assert observations.ray is not None
        log = np.tensordot(
            self.lens, terms(observations.ray.astype(np.float64) / self.extent), 1
        )
        low, high = np.quantile(log, (0.01, 0.99))
        return float(np.exp(low - high))

    def falling(self, ray: Array, view: Indices | int) -> Array:
        """Return l (3, ...) of rays (2, ...); view: index into `views` of each, or of all."""
        log = np.tensordot(self.lens, terms(ray / self.extent), 1)
        gains = np.moveaxis(self.gains[np.broadcast_to(view, log.shape)], -1, 0)
        return np.asarray(np.exp(log + gains))

    def eq_6(self, z: Array) -> tuple[Array, Array]:
        """Return a and b (3, ...) of I = l (J a + b); z: (...) metres."""
        B, beta, gamma = (column.reshape(3, *(1,) * z.ndim) for column in self.water.columns())
        return transmission(z, beta), veil(z, B, gamma)

    def on(self, observations: Observations, part: slice = slice(None)) -> Array:
        """Return l (3, n) of observations with `view` and `ray`; NaN where the gain of a view is not known."""
        assert observations.view is not None
        assert observations.ray is not None
        light = self.over(observations.views)
        return light.falling(
            observations.ray[:, part].astype(np.float64), observations.view[part]
        )

    def removed(self, observations: Observations) -> Observations:
        """Return the observations as they would be in even light (float32), weights multiplied by l^2.

        observations: with `view` and `ray`. The least squares of I / l = J a + b with these weights are those of
        I = l (J a + b). Those of views that the fit did not see have weight 0. Pixels without any weight are left out.
        """
        colour, weight = np.empty((2, 3, len(observations)), dtype=np.float32)
        for start in range(0, len(observations), _PART):
            part = slice(start, min(start + _PART, len(observations)))
            weight[:, part] = self.on(observations, part)
            colour[:, part] = observations.intensity(part) / weight[:, part]
        weight = np.nan_to_num(weight) ** 2 * (
            1 if observations.weight is None else observations.weight
        )
        even = replace(observations, colour=np.nan_to_num(colour), weight=weight)
        known = np.zeros(len(even.pixels), dtype=bool)
        for n, part in even.slots():
            known[:n] |= (weight[:, part] > 0).all(axis=0)
        return even if known.all() else even.take(np.flatnonzero(known))


@dataclass(frozen=True, eq=False)
class Problem:
    """Water and light over a sample.

    Unknowns: nine of the water (B, beta, gamma of each channel); terms of the lens; logarithms of the gains of all
    views, or of each channel and view.
    """

    sample: Sample
    parts: Parts

    precision: Array | None = None
    """Of the unknowns beforehand, (n, n), times the variance of the noise; None for weak priors."""

    @cached_property
    def extent(self) -> float:
        return max(float(np.abs(self.sample.ray).max()), 1e-9)

    @cached_property
    def distance(self) -> float:
        """The median distance, metres."""
        return float(np.median(self.sample.z[self.sample.shown]))

    @cached_property
    def summed(self) -> tuple[Array, ...]:
        """What is summed: z, I, roots of the weights, and terms of the lens, (6, P, V) or none.

        They are contiguous, since numba compiles each layout by itself.
        """
        sample = self.sample
        of_lens = terms(sample.ray / self.extent)[: self.sizes[1]]
        parts = (sample.z, sample.I, np.sqrt(sample.weight), of_lens)
        return tuple(map(np.ascontiguousarray, parts))

    @cached_property
    def sizes(self) -> list[int]:
        """Numbers of unknowns: water, lens, gains."""
        return [9, TERMS * self.parts.lens, self.parts.gains * len(self.sample.views)]

    @property
    def size(self) -> int:
        return sum(self.sizes)

    @cached_property
    def own(self) -> Indices:
        """Which unknown the gain of each channel and view is, (3, V); -1 without gains."""
        own = np.full((3, len(self.sample.views)), -1)
        if self.parts.gains:
            own[:] = np.arange(self.size - self.sizes[2], self.size).reshape(
                self.parts.gains, -1
            )
        return own

    @cached_property
    def prior(self) -> Array:
        """The precision (n, n) of the unknowns beforehand, times the variance of the noise."""
        if self.precision is not None:
            return self.precision
        prior = np.full(self.size, (_NOISE / _WEAK) ** 2)
        prior[:9] = 0
        return np.diag(prior)

    @cached_property
    def families(self) -> tuple[Array, Array]:
        """Coefficients with a spread of their own, as forms (F, n, n) of their squares, and ranks (F,) of these.

        They are the lens, the mean gain of a view over the channels, and what channels differ from it. Gains count from
        the mean of all views, so that the target is one of them.
        """
        views = len(self.sample.views)
        gains = self.parts.gains
        seen = self.sample.shown.any(axis=0).astype(np.float64)
        centred, free = np.diag(seen) - np.outer(seen, seen) / seen.sum(), seen.sum() - 1
        mean = np.full((gains, gains), 1 / max(gains, 1) ** 2)
        kinds = (
            [(mean, free), (np.eye(3) - 3 * mean, 2 * free)]
            if gains == 3
            else [(mean, free)] * gains
        )
        found = [
            (self.size - gains * views, np.kron(channels, centred), rank)
            for channels, rank in kinds
            if rank > 0
        ]
        if self.parts.lens:
            found.insert(0, (9, np.eye(TERMS), TERMS))
        forms = [
            np.pad(form, (start, self.size - start - len(form))) for start, form, _ in found
        ]
        return np.reshape(forms, (-1, self.size, self.size)), np.array(
            [rank for *_, rank in found]
        )

    @property
    def bounds(self) -> Bounds:
        most = np.full(self.size, _MOST)
        least = -most
        least[:9] = 0
        most[:9] = np.tile([1.0, _DEEPEST / self.distance, _DEEPEST / self.distance], 3)
        linear = np.zeros(len(most), dtype=bool)
        linear[[0, 3, 6]] = True
        return Bounds(least, most, linear)

    def unknowns(self, light: Light) -> Array:
        """Return the unknowns of a light with fewer parts; the others are 0."""
        gains = np.nan_to_num(light.gains).T[: self.parts.gains]
        kinds = zip(
            (light.water.by_channel().ravel(), light.lens, gains.ravel()),
            self.sizes,
            strict=True,
        )
        return np.concatenate([kind[:n] for kind, n in kinds])

    def light(self, u: Array) -> Light:
        """Return the light of unknowns."""
        water, lens, gains = np.split(u, np.cumsum(self.sizes)[:-1])
        views = len(self.sample.views)
        return Light(
            self.parts,
            WaterParameters.of_channels(water.reshape(3, 3)),
            self.sample.views,
            np.broadcast_to(gains.reshape(-1, views).T, (views, 3))
            if self.parts.gains
            else np.zeros((views, 3)),
            lens if self.parts.lens else np.zeros(TERMS),
            self.extent,
        )

    def system(self, u: Array) -> ReducedSystem:
        """Return the system (1, n) around unknowns, colours eliminated, with the priors (model.py).

        x is the column of the colour, A = sum_v x^2. The column of a gain is 0 in all other views, so products of two
        views need sums over pixels only: with M = sum_v x D,

            H = sum D^T D - M^T M / A,    K = sum D^T D - r D_u - N^T N / A,    N = M - sum_v r x_u,

        D_u and x_u being the derivatives of D and x by the unknowns.
        """
        light = self.light(u)
        H, K, g = (np.zeros((self.size,) * n) for n in (2, 2, 1))
        cost = compiled(_add_sums)(
            *self.summed,
            light.water.by_channel(),
            light.lens,
            np.array(light.gains.T, order="C"),
            self.own,
            H,
            K,
            g,
        )
        for each in (H, K):
            each += np.tril(each, -1).T + self.prior
        g -= self.prior @ u
        cost += float(u @ self.prior @ u)
        if self.parts.gains:
            held = self.own[:, self.sample.target]
            H[held], H[:, held], K[held], K[:, held], g[held] = 0, 0, 0, 0, 0
        return ReducedSystem(H[None], g[None], np.array([cost]), K[None])

    def descend(self, start: Array, tolerance: float) -> tuple[Array, ReducedSystem]:
        end = minimise(
            lambda u: self.system(u[0]), start[None], self.bounds, tolerance=tolerance
        )
        return end.at[0], end.system


def _add_sums(
    z: Any,
    I: Any,
    root: Any,
    terms: Any,
    water: Any,
    lens: Any,
    gains: Any,
    own: Any,
    H: Any,
    K: Any,
    g: Any,
) -> Any:
    """Add the sums over a sample to the lower triangles of H and K (n, n) and to g (n,), and return the cost.

    root: (3, P, V) of the weights, 0 in gaps; water: (3 channels, 3); lens: (6,) and gains: (3, V), logarithms of
    light; own: (3, V), which unknown the gain is, -1 if none. numba compiles it; `Problem.system` has the formulas.
    """
    views = z.shape[1]
    n_terms = len(terms)
    n_common = 3 + n_terms
    D = np.zeros((views, n_common))
    M = np.zeros(n_common)
    N = np.zeros(n_common)
    x = np.zeros(views)
    y = np.zeros(views)
    r = np.zeros(views)
    by_both = np.zeros(views)
    seen = np.zeros(views)
    which = np.zeros(n_common, dtype=np.int64)
    cost = 0.0
    for c in range(3):
        B = water[c, 0]
        beta = water[c, 1]
        gamma = water[c, 2]
        of_H = np.zeros((n_common, n_common))
        of_K = np.zeros((n_common, n_common))
        slope = np.zeros(n_common)
        for k in range(n_common):
            which[k] = 3 * c + k if k < 3 else 6 + k
        for p in range(len(z)):
            A = LEAST
            xy = 0.0
            for v in range(views):
                if root[c, p, v] > 0:
                    log = gains[c, v]
                    for k in range(n_terms):
                        log += lens[k] * terms[k, p, v]
                    l = root[c, p, v] * math.exp(log)
                    x[v] = l * math.exp(-beta * z[p, v])
                    D[v, 0] = -l * math.expm1(-gamma * z[p, v])
                    D[v, 1] = -z[p, v] * x[v]
                    by_both[v] = z[p, v] * (l - D[v, 0])
                    D[v, 2] = B * by_both[v]
                    y[v] = root[c, p, v] * I[c, p, v] - B * D[v, 0]
                    A += x[v] * x[v]
                    xy += x[v] * y[v]
            for k in range(n_common):
                M[k] = 0.0
                N[k] = 0.0
            for v in range(views):
                if root[c, p, v] > 0:
                    r[v] = y[v] - x[v] * xy / A
                    seen[v] = root[c, p, v] * I[c, p, v] - r[v]
                    cost += r[v] * r[v]
                    N[1] -= D[v, 1] * r[v]
                    D[v, 1] *= xy / A
                    of_K[1, 1] += z[p, v] * D[v, 1] * r[v]
                    of_K[2, 2] += z[p, v] * D[v, 2] * r[v]
                    of_K[2, 0] -= by_both[v] * r[v]
                    for k in range(n_terms):
                        D[v, 3 + k] = terms[k, p, v] * seen[v]
                        N[3 + k] -= terms[k, p, v] * x[v] * r[v]
                        for m in range(4 + k):
                            of_K[3 + k, m] -= terms[k, p, v] * D[v, m] * r[v]
                    for k in range(n_common):
                        M[k] += D[v, k] * x[v]
                        slope[k] += D[v, k] * r[v]
                        for m in range(k + 1):
                            of_H[k, m] += D[v, k] * D[v, m]
            for k in range(n_common):
                N[k] += M[k]
                for m in range(k + 1):
                    of_H[k, m] -= M[k] * M[m] / A
                    of_K[k, m] += (M[k] * M[m] - N[k] * N[m]) / A
            for v in range(views):
                u = own[c, v]
                if u >= 0 and root[c, p, v] > 0:
                    more = seen[v] - r[v]
                    g[u] += seen[v] * r[v]
                    H[u, u] += seen[v] * seen[v]
                    K[u, u] += seen[v] * more
                    for k in range(n_common):
                        H[u, which[k]] += (D[v, k] - M[k] * x[v] / A) * seen[v]
                        K[u, which[k]] += (D[v, k] - N[k] * x[v] / A) * more
                    for w in range(v + 1):
                        if root[c, p, w] > 0:
                            both = x[v] * x[w] / A
                            H[u, own[c, w]] -= both * seen[v] * seen[w]
                            K[u, own[c, w]] -= both * more * (seen[w] - r[w])
        for k in range(n_common):
            g[which[k]] += slope[k]
            for m in range(k + 1):
                H[which[k], which[m]] += of_H[k, m]
                K[which[k], which[m]] += of_H[k, m] + of_K[k, m]
    return cost


@dataclass(frozen=True, slots=True, eq=False)
class LightFit:
    """A fitted light."""

    light: Light

    error: Array
    """Standard errors of B, beta and gamma, (3 channels, 3), the light being unknown too."""


def fit_light(sample: Sample, parts: Parts, light: Light) -> LightFit:
    """Fit water and light to a sample; light: even, or with the same parts: the only start then."""
    problem = Problem(sample.take(slice(None, None, max(1, len(sample.z) // _SCREEN))), parts)
    start = light.water.by_channel()
    far = problem.distance
    others = _STARTS if light.parts == EVEN_LIGHT else ()
    rows = [
        start,
        *(
            np.c_[start[:, 0], np.full(3, beta / far), np.full(3, gamma / far)]
            for beta, gamma in others
        ),
    ]
    other = problem.unknowns(light)[9:]
    ends = [problem.descend(np.r_[row.ravel(), other], _ROUGHLY) for row in rows]
    problem = Problem(sample, parts)
    at, system = problem.descend(
        min(ends, key=lambda end: float(end[1].cost[0]))[0], _TOLERANCE
    )
    n_excess = 3 * (np.count_nonzero(sample.shown) - len(sample.z)) - len(at)
    noise = system.cost[0] / max(n_excess, 1) * _shared(sample, problem.light(at))
    at, covariance = _with_spreads(problem, at, noise)
    light, error = problem.light(at), np.sqrt(np.diag(covariance)[:9].clip(min=0)).reshape(3, 3)
    light = replace(
        light, gains=np.where(sample.shown.any(0, keepdims=True).T, light.gains, np.nan)
    )
    return LightFit(light, error)


def _with_spreads(problem: Problem, at: Array, noise: float) -> tuple[Array, Array]:
    """Return the unknowns with the spreads that the sample tells, and their covariance.

    at: the unknowns with weak priors; noise: variance of an observation.
    """
    forms, ranks = problem.families
    weak = problem.prior.copy()
    weak[9:] = 0
    squares = (np.einsum("i,fij,j->f", at, forms, at) / ranks).clip(_LEAST**2, _WEAK**2)
    for _ in range(_ROUNDS):
        before = squares
        problem = replace(problem, precision=np.tensordot(noise / squares, forms, 1) + weak)
        at, system = problem.descend(at, _ROUGHLY)
        H = system.H[0]
        covariance = np.zeros_like(weak)
        free = np.flatnonzero(np.diag(H) > 0)
        scale = 1 / np.sqrt(np.diag(H)[free])
        inverse = np.linalg.pinv(
            H[np.ix_(free, free)] * scale[:, None] * scale, rcond=1e-14, hermitian=True
        )
        covariance[np.ix_(free, free)] = noise * inverse * scale[:, None] * scale
        told = ranks - np.einsum("fij,ij->f", forms, covariance) / squares
        squares = (np.einsum("i,fij,j->f", at, forms, at) / told.clip(min=_TOLD)).clip(
            _LEAST**2, _WEAK**2
        )
        if (np.abs(np.log(squares.clip(_SMALL**2) / before.clip(_SMALL**2))) < _SETTLED).all():
            break
    return at, covariance


def _shared(sample: Sample, light: Light) -> float:
    """Return how many times larger the variance of gains is than that of independent observations, at least 1.

    Texture, caustics and poses differ more between tiles of the target than within. What the lens does not explain is
    alike at a place of the image in all views: along a straight path it looks like gains that drift.
    """
    r, shown = residuals_in(sample, light)
    r = np.moveaxis(r * shown, 0, -1)
    side = ((sample.ray / light.extent + 1) * (TILES / 2)).astype(np.int64)
    of_target = (*sample.tile[..., None], np.arange(len(sample.views)))
    of_image = (*side.clip(max=TILES - 1), 0)  # one view for all
    shares = []
    for tile in (of_target, of_image):
        of_tiles = np.zeros((TILES, TILES, len(sample.views), 3))
        np.add.at(of_tiles, tile, r)
        shares.append(float((of_tiles**2).sum() / max((r**2).sum(), 1e-30)))
    return max(1.0, *shares)


def residuals_in(sample: Sample, light: Light) -> tuple[Array, Array]:
    """Return residuals (3, P, V) and what the fit shows, both times square roots of weights."""
    l = light.falling(sample.ray, np.arange(len(sample.views)))
    a, b = light.eq_6(sample.z)
    s = np.sqrt(sample.weight)
    _, _, r = eliminated(s * l * a, s * (sample.I - l * b), 2)
    return r, s * sample.I - r
