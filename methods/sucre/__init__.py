"""SUCRe: colour restoration from several views of a scene (Boittiaux et al., 3DV 2024).

Pairing finds every pixel of the target in the other views, at other distances; the fit explains all observations by
one water and one colour a pixel.
"""

from sucre_bench.methods.sucre.paper import SucrePaper
from sucre_bench.methods.sucre.plus import SucrePlus
from sucre_bench.methods.sucre.sucre import Sucre

__all__ = ["Sucre", "SucrePaper", "SucrePlus"]
