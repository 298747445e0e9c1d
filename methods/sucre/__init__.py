"""SUCRe: colour restoration from several views of a scene (Boittiaux et al., 3DV 2024).

Pairing finds every pixel of the target in the other views, at other distances. The fit explains all observations by
one water and one colour a pixel.

| file | subject |
|---|---|
| `sucre.py`, `paper.py` | the methods: `sucre` and `sucre_plus`; `sucre_paper` |
| `adam.py`, `adam_loops.py` | the steps of `sucre_paper`, on a GPU and as compiled loops |
| `model.py` | the image formation model, its parameters, and their least-squares problem |
| `minimise.py` | Newton's method for a few bounded parameters |
| `passes.py`, `numba_loops.py` | the passes that sum it up, for array libraries and as compiled loops |
| `exact.py` | the minimum: starts, choice between minima, weak priors |
| `observed.py`, `residuals.py` | a view or a dive with its observations; how far these are from a fit |
| `solution.py`, `uncertainty.py` | what every fit returns, and how uncertain its water is |
| `known_water.py` | water from elsewhere, or shared by a scene |
| `models.py` | what can be fitted to a view or a dive, and the fit of it |
| `judge.py` | which of these a dive gets, by views that a fit has not seen |
| `policy.py` | what becomes of a view: its water, or the photograph, and what is said |
| `robust.py` | weights of observations that do not fit |
| `light.py` | light that differs between observations, fitted with the water |
| `refine_noise.py`, `refine_views.py` | noise after the fit; gaps of views, edges, and pixels without depth |
| `record.py` | the restoration and its record |
"""

from sucre_bench.methods.sucre.paper import SucrePaper
from sucre_bench.methods.sucre.sucre import Sucre, SucrePlus

__all__ = ["Sucre", "SucrePaper", "SucrePlus"]
