"""Finds a lamp that is fixed to the camera and is the only light, as in the deep sea, and removes its light.

    I = l (J a + b),    l = exp(-|M p|^2 / 2),    z = |X| + |Y|,    Y = R (X - position),    p = (Y_x, Y_y) / Y_z

X: a point in the observing camera's frame; Y: the same in the lamp's, whose axis is where it is brightest; a and b as
in model.py, over the way from the lamp to the point and on to the camera. The lobe is a Gaussian in the lamp's image
plane. Its peak is 1, which separates the lamp's power from the colours. M is upper triangular and M^T M is the inverse
of the lobe's covariance, so M = 0 is even light. R turns about y, then about x; M holds the roll, as a lamp turned
about its axis with its lobe turned back is the same lamp. Model: SUCRe's authors, for the same deep-sea images.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.errors import SolveError
from sucre_bench.machine.progress import track
from sucre_bench.methods.sucre.levenberg import Bounds, Minimum, minimise
from sucre_bench.methods.sucre.light_and_water import ByPixel
from sucre_bench.methods.sucre.model import ReducedSystem, WaterParameters, transmission, veil
from sucre_bench.multiview.observations import Observations

# Pixels that the starts are tried on, and that the best is refined on.
_SCREEN, _SAMPLE = 400, 10_000

# Starts: the lamp at the camera and beside it, metres; lobes of about 80, 57 and 37 degrees to a side (two standard
# deviations).
_POSITIONS = ((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (-0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (0.0, -0.3, 0.0))
_LOBES = (0.4, 1.3, 2.7)

# Priors on the lamp, as standard deviations about 0 of yaw and pitch, position in metres, and M: it points ahead within
# 30 degrees, sits within half a metre, and its lobe is no narrower than about 20 degrees. Each prior weighs as much as
# one observation with this noise.
_PRIORS = np.array([0.5, 0.5, 0.5, 0.5, 0.5, 5.0, 5.0, 5.0])
_NOISE = 0.01

# Most evaluations and least relative gain of a descent: from each start, and of the last one. Without a lamp the valley
# is long, and any end on it will do.
_ROUGHLY, _FINELY = (25, 1e-4), (40, 1e-6)

# Less light than this says nothing about a colour: an 8-bit level would be a twentieth of the whole scale.
DARK = 0.05

# Channels at the ends of the scale were cut off.
_ENDS = (0.5 / 255, 254.5 / 255)


_PART = 1 << 16  # observations at a time


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """lamp_from_cam: (4, 4) rigid transform, metres; precision: (2, 2) inverse of the lobe's covariance, unitless."""

    lamp_from_cam: Array
    precision: Array

    def light(self, X: Array) -> tuple[Array, Array]:
        """Return the light (...,) in [0, 1] at points X (3, ...) of the camera's frame, and its way there, metres."""
        Y = np.tensordot(self.lamp_from_cam[:3, :3], X, axes=1)
        Y += self.lamp_from_cam[:3, 3].reshape(3, *(1,) * (X.ndim - 1))
        x, y = Y[:2] / np.where(Y[2] > 0, Y[2], 1)
        (xx, xy), (_, yy) = self.precision
        lobe = np.exp(-0.5 * (xx * x * x + 2 * xy * x * y + yy * y * y))
        return np.where(Y[2] > 0, lobe, 0), np.sqrt((Y * Y).sum(axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class LampFit:
    """A lamp and the water in its light.

    noise: rms of the residuals on the sample, in intensity; noise_without: the same for the water that the fit started
    from and no lamp.
    """

    lamp: Lamp
    water: WaterParameters
    noise: float
    noise_without: float

    @property
    def is_worth_it(self) -> bool:
        """Whether a lamp explains the observations better.

        On made scenes a lamp halved `noise`; without one, `noise` changed by .2 %.
        """
        return self.noise < 0.98 * self.noise_without

    def tested(self) -> dict[str, float | bool]:
        """Return the test of the lamp, for the record."""
        return {"noise": self.noise, "noise_without": self.noise_without, "found": self.is_worth_it}


def estimate(observations: Observations, water_start: WaterParameters, *, seed: int = 0) -> LampFit:
    """Fit a lamp and the water together to random pixels seen more than once; colours are eliminated.

    water_start: fitted without a lamp. Position and direction trade against each other where the scene is far and
    flat. Weak priors, worth an observation each, decide what the data leave open. If there is no lamp the lobe becomes
    wide, and the light's way halves the rates.
    Raises SolveError when no pixel is seen twice, or when the observations have no rays.
    """
    if observations.ray is None or not observations.n_repeated:
        raise SolveError(
            "a lamp needs pixels that several views show; give views of the same places, or method.lamp=false"
        )
    rng = np.random.default_rng(seed)
    screen, sample = (PointsByPixel.of(observations, n, rng) for n in (_SCREEN, _SAMPLE))
    bounds = _bounds(observations)
    starts = [starting_point(position, lobe, water_start) for position in _POSITIONS for lobe in _LOBES]
    tried = [_descend(screen, start, bounds, *_ROUGHLY) for start in track(starts, "lamp")]
    best = _descend(sample, min(tried, key=lambda end: float(end.system.cost[0])).at[0], bounds, *_FINELY).at[0]
    noise, noise_without = (
        _rms(residuals(sample, best), sample),
        _rms(_misfit(sample, 1.0, sample.z, water_start), sample),
    )
    return LampFit(_lamp(best), _water(best), noise, noise_without)


def _descend(sample: PointsByPixel, start: Array, bounds: Bounds, steps: int, tolerance: float) -> Minimum:
    def evaluate(unknowns: Array) -> ReducedSystem:
        return reduced_system(sample, unknowns[0])

    return minimise(evaluate, start[None], bounds, tolerance=tolerance, max_steps=steps)


def starting_point(position: tuple[float, ...], lobe: float, water: WaterParameters) -> Array:
    """Return all 17 unknowns: yaw, pitch; position; the three of M; B, beta, gamma of each channel.

    position: of the lamp, metres in the camera's frame; lobe: M is `lobe` times the identity; water: without a lamp.
    The rates are halved, as the light's way is twice as long.
    """
    return np.concatenate([(0, 0), position, (lobe, 0, lobe), (water.by_channel() * (1, 0.5, 0.5)).ravel()])


def _water(unknowns: Array) -> WaterParameters:
    return WaterParameters.of_channels(unknowns[8:].reshape(3, 3))


def _bounds(observations: Observations) -> Bounds:
    fastest = 30 / float(np.median(observations.distance))  # no light arrives from the typical distance
    lower = np.array([-1.2, -1.2, -3, -3, -3, 0, -20, 0, *[0, 0, 0] * 3])
    upper = np.array([1.2, 1.2, 3, 3, 3, 20, 20, 20, *[1, fastest, fastest] * 3])
    return Bounds(lower, upper, np.array([True] * 8 + [False, True, True] * 3))  # B enters linearly


@dataclass(frozen=True, slots=True, eq=False)
class PointsByPixel:
    """Observations in the order of `pixels`: X (3, N); z (N,) from the camera; I, s (3, N), s the root of the weight, 0
    where a channel was cut off."""

    X: Array
    z: Array
    I: Array  # noqa: E741
    s: Array
    pixels: ByPixel

    @staticmethod
    def of(observations: Observations, n: int, rng: np.random.Generator) -> PointsByPixel:
        """Return all observations of at most n random pixels that several views show; they need rays."""
        places = rng.choice(observations.n_repeated, min(n, observations.n_repeated), replace=False)
        few = observations.take(np.sort(places))
        pixels = ByPixel.of(few)
        X, z, w = _points(few)[:, pixels.order], few.distance[pixels.order], few.weight
        I = few.intensity(slice(None))[:, pixels.order].astype(np.float64)  # noqa: E741
        s = np.sqrt(np.ones(len(few)) if w is None else w[pixels.order].astype(np.float64)) * _within(I)
        return PointsByPixel(X, z.astype(np.float64), I, s, pixels)


def _points(observations: Observations, part: slice = slice(None)) -> Array:
    """X (3, n) float64 of observations."""
    assert observations.ray is not None
    x, y = observations.ray[:, part].astype(np.float64)
    return np.asarray(np.stack([x, y, np.ones_like(x)]) * (observations.distance[part] / np.sqrt(x * x + y * y + 1)))


def _within(I: Array) -> Mask:  # noqa: E741
    return np.asarray((_ENDS[0] < I) & (_ENDS[1] > I))


def _rotations(yaw: float, pitch: float) -> tuple[Array, Array, Array]:
    """R, dR/dyaw, dR/dpitch."""
    (cy, sy), (cp, sp) = ((np.cos(angle), np.sin(angle)) for angle in (yaw, pitch))
    turn, dturn = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]), np.array([[-sy, 0, -cy], [0, 0, 0], [cy, 0, -sy]])
    tilt, dtilt = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]]), np.array([[0, 0, 0], [0, -sp, -cp], [0, cp, -sp]])
    return tilt @ turn, tilt @ dturn, dtilt @ turn


def _lamp(unknowns: Array) -> Lamp:
    R, _, _ = _rotations(*unknowns[:2])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, -R @ unknowns[2:5]
    M = np.array([[unknowns[5], unknowns[6]], [0, unknowns[7]]])
    return Lamp(pose, M.T @ M)


def _colours(
    sample: PointsByPixel,
    l: Array | float,  # noqa: E741
    z: Array,
    water: WaterParameters,
) -> tuple[Array, Array, Array, Array, Array]:
    """a, b, s l a, its sum of squares over each pixel, and the best J, each (3, N)."""
    B, beta, gamma = water.columns()
    a, b = transmission(z, beta), veil(z, B, gamma)
    x = sample.s * l * a
    A = np.maximum(sample.pixels.sums(x * x), 1e-30)
    return a, b, x, A, sample.pixels.sums(x * sample.s * (sample.I - l * b)) / A


def _misfit(sample: PointsByPixel, l: Array | float, z: Array, water: WaterParameters) -> Array:  # noqa: E741
    """Return the residuals (3, N) in light l, 1 without a lamp, after a way of z metres."""
    _, b, x, _, J = _colours(sample, l, z, water)
    return np.asarray(sample.s * (sample.I - l * b) - x * J)


def residuals(sample: PointsByPixel, unknowns: Array) -> Array:
    """Return the residuals (3, N) in a lamp's light, with the best colours; unknowns: (17,), see `starting_point`."""
    l, way = _lamp(unknowns).light(sample.X)  # noqa: E741
    return _misfit(sample, l, sample.z + way, _water(unknowns))


def _rms(r: Array, sample: PointsByPixel) -> float:
    return float(np.sqrt((r * r).sum() / max((sample.s > 0).sum() - 3 * len(sample.pixels.sizes), 1)))


def reduced_system(sample: PointsByPixel, unknowns: Array) -> ReducedSystem:
    """Return H (1, 17, 17), g and cost around the unknowns (17,), see `starting_point`, with the priors on the lamp.

    Colours are eliminated as in model.py.
    """
    R, R_yaw, R_pitch = _rotations(*unknowns[:2])
    m00, m01, m11 = unknowns[5:8]
    water = _water(unknowns)
    from_lamp = sample.X - unknowns[2:5, None]
    l, way = _lamp(unknowns).light(sample.X)  # noqa: E741
    Y = R @ from_lamp
    Z = np.where(Y[2] > 0, Y[2], 1)
    x, y = Y[0] / Z, Y[1] / Z
    u, v = m00 * x + m01 * y, m11 * y  # M p
    # d log l: by M, and by Y
    lobe = np.stack([-u * x, -u * y, -v * y])
    by_x, by_y = -u * m00, -u * m01 - v * m11
    by_Y = np.stack([by_x, by_y, -(by_x * x + by_y * y)]) / Z
    dY = np.stack([R_yaw @ from_lamp, R_pitch @ from_lamp, *np.broadcast_to(-R.T[:, :, None], (3, 3, len(way)))])
    d_log_l = np.concatenate([np.einsum("in,kin->kn", by_Y, dY), lobe])  # (8, N)
    d_z = np.concatenate([np.einsum("in,kin->kn", Y / way, dY), np.zeros_like(lobe)])

    z = sample.z + way
    a, b, x_J, A, J = _colours(sample, l, z, water)
    B, beta, gamma = water.columns()
    fade = np.exp(-gamma * z)
    by_z = -beta * J * a + gamma * B * fade
    columns = (
        sample.s
        * l
        * np.concatenate(
            [d_log_l[:, None] * (J * a + b) + d_z[:, None] * by_z, np.stack([1 - fade, -z * J * a, B * z * fade])]
        )
    )  # (11, 3, N)
    columns -= x_J * (sample.pixels.sums(x_J * columns) / A)
    r = sample.s * (sample.I - l * b) - x_J * J
    priors = np.append((_NOISE / _PRIORS) ** 2, np.zeros(9))
    H, g = np.diag(priors), -priors * unknowns
    for c in range(3):
        places = np.r_[:8, 8 + 3 * c : 11 + 3 * c]
        H[np.ix_(places, places)] += columns[:, c] @ columns[:, c].T
        g[places] += columns[:, c] @ r[c]
    return ReducedSystem(H[None], g[None], np.array([(r * r).sum() + priors @ unknowns**2]))


def lit(observations: Observations, lamp: Lamp) -> Observations:
    """Return the observations as they would be in even light, for the model without a lamp.

    Distance becomes the whole way of the light, colour I / l (float32, may exceed 1), and weights are multiplied by
    l^2: least squares of I / l = J a + b with these weights are those of I = l (J a + b). Observations in the dark or
    with a channel at an end of the scale get weight 0. Pixels without any weight are left out.
    """
    assert observations.ray is not None, "observe with rays"
    n = len(observations)
    distance, colour, weight = (np.empty(shape, dtype=np.float32) for shape in (n, (3, n), n))
    for start in range(0, n, _PART):
        part = slice(start, min(start + _PART, n))
        l, way = lamp.light(_points(observations, part))  # noqa: E741
        I = observations.intensity(part)  # noqa: E741
        usable = (l > DARK) & _within(I).all(axis=0)
        distance[part] = observations.distance[part] + way
        colour[:, part] = I / np.maximum(l, DARK)
        weight[part] = l * l * usable
    if observations.weight is not None:
        weight *= observations.weight
    even = replace(observations, distance=distance, colour=colour, weight=weight)
    known = np.zeros(len(even.pixels), dtype=bool)
    for m, part in even.slots():
        known[:m] |= weight[part] > 0
    return even if known.all() else even.take(np.flatnonzero(known))
