"""SUCRe: colour restoration from several views of a scene (Boittiaux et al., 3DV 2024).

Pairing finds every pixel of the target in the other views, at other distances. The fit explains all observations by
one water and one colour a pixel.

| file | subject |
|---|---|
| `sucre.py`, `paper.py` | the methods: `sucre` and `sucre_plus`; `sucre_paper` |
| `model.py` | the image formation model, its parameters, and the least-squares problem in these |
| `passes.py`, `numba_loops.py`, `array_libraries.py` | the passes that sum it up, for several array libraries |
| `exact.py`, `levenberg.py` | the minimum: starts, steps, choice between minima, weak priors |
| `solution.py`, `known_water.py` | the result of every solver; water from elsewhere, or shared by a scene |
| `own_water.py`, `undetermined_water.py` | the exact fit to one image; what replaces it without a determined water |
| `robust.py` | weights of observations that do not fit |
| `light.py`, `strobe.py`, `light_parts.py` | light that differs between observations, fitted with the water |
| `choose_light.py` | which parts the observations pay for |
| `choose_encoding.py` | whether stored intensities or linear light are fitted |
| `refine_noise.py`, `refine_edges.py`, `refine_gaps.py` | colours after the fit, and of pixels without depth |
| `diagnostics.py`, `record.py` | uncertainty of the water; the restoration and its record |
"""

from sucre_bench.methods.sucre.paper import SucrePaper
from sucre_bench.methods.sucre.sucre import Sucre, SucrePlus

__all__ = ["Sucre", "SucrePaper", "SucrePlus"]
