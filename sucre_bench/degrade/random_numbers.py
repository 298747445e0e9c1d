"""Random numbers of a view: they depend on names and seed, not on other views or their order."""

import hashlib

import numpy as np

from sucre_bench.arrays import Array


def generator(seed: int, *names: str) -> np.random.Generator:
    """Return the generator of a seed and names: of the scene, the view and the quantity."""
    digest = hashlib.blake2b(repr((seed, names)).encode(), digest_size=16).digest()
    return np.random.default_rng(np.random.SeedSequence(int.from_bytes(digest, "big")))


def random_field(rng: np.random.Generator, shape: tuple[int, int], grain_px: float) -> Array:
    """Return a Gaussian random field (H, W) float32 whose root mean square is 1.

    grain_px: standard deviation in pixels of the Gaussian that white noise is smoothed by, 0 for none. The smoothing
    goes round the borders, so that the field is as strong there as elsewhere.
    """
    import scipy.fft
    from scipy.ndimage import fourier_gaussian

    field = rng.standard_normal(shape, dtype=np.float32)
    if grain_px > 0:
        spectrum = fourier_gaussian(scipy.fft.rfft2(field), grain_px, n=shape[1])
        field = scipy.fft.irfft2(spectrum, s=shape).astype(np.float32)
    return np.asarray(field / np.sqrt(np.mean(field**2, dtype=np.float64)), dtype=np.float32)
