"""What a strobe beside the camera adds to SUCRe's model.

    I = J S exp(-beta (z + d))  +  B gamma int_0^z S exp(-gamma t - beta d) dt

S = (r / d)^2 exp(lobe): the strobe's light on a point, d its distance from the strobe and r a distance that only sets
the scale. The inverse square has no coefficient. The strobe has a position, its lobe six terms of the direction. The
strobe is the only light. The integral is over the points along the ray, at distances t from the camera: light that is
scattered once. Most of it is scattered near the camera, so this veil does not grow with the distance as daylight's
does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array

# Unknowns: position and lobe.
TERMS = 6
UNKNOWNS = 3 + TERMS

# Points along a ray: at z s^2 with Gauss-Legendre's s, since light changes fastest near the camera. With ten points
# beta of the demo's deep sea was 13 to 57 % off, with sixteen 1 to 6 %.
_ALONG = 16

# Size of a strobe, metres: nearer than this its light does not grow.
_SIZE = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Strobe:
    """position: (3,) metres in the camera's frame; lobe: (6,) of the terms; r: metres."""

    position: Array
    lobe: Array
    r: float

    def on(self, ray: Array, z: Array, *, slopes: bool = False) -> tuple[Array, Array, Array, Array]:
        """Return log S, d, and their derivatives by position and lobe, (9, ...) each if asked for.

        ray: (2, ...) x / z and y / z in the camera's frame; z: (...) metres.
        """
        Y = points(ray, z) - self.position.reshape(3, *[1] * z.ndim)
        square = (Y * Y).sum(axis=0)
        d = np.sqrt(square).clip(1e-6)
        at = Y[:2] / d
        known = terms(at)
        log_S = np.tensordot(self.lobe, known, 1) - np.log((square + _SIZE**2) / self.r**2)
        if not slopes:
            return log_S, d, log_S, d
        (x, y), zero, one = at, np.zeros_like(d), np.ones_like(d)
        of_r = 4 * (x * x + y * y)
        by_place = np.stack([[one, zero, 2 * x, y, zero, of_r * x], [zero, one, zero, x, 2 * y, of_r * y]])
        slope = np.tensordot(by_place, self.lobe, ((1,), (0,)))
        turned = np.concatenate([slope, 0 * slope[:1]]) - (slope * at).sum(axis=0) * Y / d
        by_position = 2 * Y / (square + _SIZE**2) - turned / d
        ways = np.concatenate([-Y / d, np.zeros((TERMS, *d.shape))])
        return log_S, d, np.concatenate([by_position, known]), ways


@dataclass(frozen=True, slots=True, eq=False)
class Lit:
    """What the strobe does to observations: at their points, and at points t along their rays with weights dt."""

    z: Array
    on_ground: tuple[Array, Array, Array, Array]
    t: Array
    dt: Array
    along: tuple[Array, Array, Array, Array]

    @staticmethod
    def of(strobe: Strobe, ray: Array, z: Array, *, slopes: bool = False) -> Lit:
        s, weight = (
            (one + shift) / 2 for one, shift in zip(np.polynomial.legendre.leggauss(_ALONG), (1, 0), strict=True)
        )
        s, weight = s.reshape(-1, *[1] * z.ndim), weight.reshape(-1, *[1] * z.ndim)
        t = z * s**2
        ground, along = strobe.on(ray, z, slopes=slopes), strobe.on(ray[:, None], t, slopes=slopes)
        return Lit(z, ground, t, 2 * z * s * weight, along)

    def light(self, beta: float) -> Array:
        """Return the light (...) on the ground of a channel, S exp(-beta d)."""
        log_S, d, _, _ = self.on_ground
        return np.asarray(np.exp(log_S - beta * d))

    def veil(self, water: tuple[float, float, float]) -> Array:
        """Return the veil (...) of a channel; water: its B, beta, gamma."""
        B, beta, gamma = water
        log_S, d, _, _ = self.along
        return np.asarray(B * gamma * (self.dt * np.exp(log_S - beta * d - gamma * self.t)).sum(axis=0))

    def derivatives(self, water: tuple[float, float, float]) -> tuple[Array, Array, Array, Array]:
        """Return a and b (...) of I = J a + b, and their derivatives by B, beta, gamma and the unknowns, (12, ...)."""
        B, beta, gamma = water
        log_S, d, by_log_S, by_d = self.on_ground
        a = np.exp(log_S - beta * (self.z + d))
        none = np.zeros((1, *a.shape))
        of_a = np.concatenate([none, -a[None] * (self.z + d), none, a * (by_log_S - beta * by_d)])
        log_S, d, by_log_S, by_d = self.along
        e = self.dt * np.exp(log_S - beta * d - gamma * self.t)
        sums = e.sum(axis=0)
        by_water = [gamma * sums, -B * gamma * (d * e).sum(axis=0), B * (sums - gamma * (self.t * e).sum(axis=0))]
        of_b = np.concatenate([by_water, B * gamma * ((by_log_S - beta * by_d) * e).sum(axis=1)])
        return a, B * gamma * sums, of_a, of_b


def points(ray: Array, z: Array) -> Array:
    """Return the points (3, ...) that are seen along rays (2, ...) at distances z, metres in the camera's frame."""
    x, y = ray
    along = z / np.sqrt(x * x + y * y + 1)
    return np.asarray(np.stack([x * along, y * along, along]))


def terms(at: Array) -> Array:
    """Return the six terms (6, ...) of places or directions (2, ...)."""
    x, y = at
    r = x * x + y * y
    return np.stack([x, y, x * x, x * y, y * y, r * r])
