"""Variants of SUCRe on grounds of white noise in five waters: the rows "white noise" of docs/sucre-measured.md.

Run: python benchmarks/white_noise.py [--views 3,5]

Each ground (tests/support/made_ground.py) has texture at every scale, and each pixel averages its whole area. View 5 is
the farthest, at 5.8 m: its pixels average the most ground. Printed are means over the waters: absolute errors of B,
beta and gamma in %, red, green and blue; PSNR of J as computed and of the picture, in dB; shares of saturated red and
of negative colours; seconds a view.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

import sucre_bench as sb

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from support.made_ground import WATERS, make_ground

VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "sucre_paper": ("sucre_paper", {}),
    "sucre_exact": ("sucre", {"footprint": False, "light": "even"}),
    "sucre": ("sucre", {}),
    "sucre_plus": ("sucre_plus", {}),
}
METRICS = ["psnr:raw", "psnr:masked", "saturated_red", "negative"]
SHOWN = [("psnr", "raw"), ("psnr", "masked"), ("saturated_red", "hsv"), ("negative", "any")]


def measured(name: str, options: dict[str, Any], scene: sb.Scene, truth: sb.Water, view: str) -> list[float]:
    """Return what is printed of one restoration."""
    result = sb.restore(name, scene, scene[view], **options)
    assert result.water is not None
    fitted, true = (
        np.stack([water.veiling_light, water.attenuation, water.backscatter]) for water in (result.water, truth)
    )
    values = sb.score(result, scene[view], METRICS).set_index(["metric", "variant"])["value"]
    scores = [float(values[metric]) for metric in SHOWN]
    errors = 100 * np.abs(fitted / true - 1)
    return [*errors.ravel(), *scores[:3], 100 * scores[3], result.info["seconds"]]


def main() -> None:
    """Measure and print one line a variant and view."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", default="3,5", help="views of each ground, 0 (nearest) to 5 (default 3,5)")
    views = [f"{k}.png" for k in parser.parse_args().views.split(",")]
    scenes = [(make_ground(water), water) for water in WATERS.values()]
    print("| view | variant | B | beta | gamma | as fitted | shown | saturated red | negative | s/view |")
    for view in views:
        for label, (name, options) in VARIANTS.items():
            mean = np.mean([measured(name, options, scene, water, view) for scene, water in scenes], axis=0)
            triples = [" ".join(f"{error:.1f}" for error in mean[3 * k : 3 * k + 3]) for k in range(3)]
            psnr = [f"{value:.1f}" for value in mean[9:11]]
            print("|", " | ".join([view, label, *triples, *psnr, f"{mean[11]:.3f}", f"{mean[12]:.1f} %"]), end="")
            print(f" | {mean[13]:.1f} |", flush=True)


if __name__ == "__main__":
    main()
