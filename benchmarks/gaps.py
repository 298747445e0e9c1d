"""Dots where a view misses pixels, with refine=false and refine=true: for "Refinement" in docs/supplement.md.

Run: python benchmarks/gaps.py [--size 640x480]

The views are those of `dataset=demo`. "Uneven" multiplies the light of each view by a smooth error of 8 %. Printed are
the PSNR of J in dB, as fitted and with prior; and dots, the root mean square of the error of J less its mean over
3 x 3 pixels, times 1000, away from edges of depth.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter, uniform_filter

import sucre_bench as sb
from sucre_bench.arrays import Array

ROWS = (
    ("coastal", 3, False),
    ("coastal", 8, False),
    ("clear", 8, False),
    ("turbid", 8, False),
    ("coastal", 8, True),
)
ERROR = 0.08  # of the light, uneven
EDGE = 1.05  # ratio of depths within 5 x 5 pixels


def uneven(scene: sb.Scene) -> sb.Scene:
    """Return the scene with a smooth error of its own in the light of each view."""
    rng = np.random.default_rng(0)

    def lit(view: sb.View) -> sb.View:
        height, width = view.rgb.shape[:2]
        smooth = gaussian_filter(rng.normal(size=(height, width)), width / 8)
        light = 1 + ERROR * smooth / smooth.std()
        seen = np.rint(255 * (view.rgb * light[..., None]).clip(0, 1)) / 255
        return sb.View(
            view.name,
            sb.Arrays(seen, view.depth, view.reference),
            view.camera,
            view.cam_from_world,
        )

    return replace(scene, views=[lit(view) for view in scene.views])


def dots(image: Array, view: sb.View) -> float:
    """Return the dots of an image (H, W, 3), times 1000."""
    assert view.depth is not None
    assert view.reference is not None
    far, near = (extreme(view.depth, 5) for extreme in (maximum_filter, minimum_filter))
    smooth = np.isfinite(image).all(axis=2) & (near > 0) & (far < EDGE * near)
    error = np.where(np.isfinite(image), image - view.reference, 0)
    fine = error - uniform_filter(error, (3, 3, 1))
    return float(1000 * np.sqrt((fine[smooth] ** 2).mean()))


def measured(scene: sb.Scene, view: sb.View, **options: bool) -> tuple[float, float]:
    """Return the PSNR of J of `sucre_plus` and its dots."""
    result = sb.restore("sucre_plus", scene, view, **options)
    rows = sb.score(result, view, ["psnr:raw"])
    return float(rows[rows["metric"] == "psnr"]["value"].iloc[0]), dots(result.image, view)


def main() -> None:
    """Measure and print one line a view."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", default="640x480", help="of the images (default 640x480)")
    width, height = (int(side) for side in parser.parse_args().size.split("x"))
    print("| | refine=false | refine=true | dots, refine=false | refine=true |")
    for water, k, is_uneven in ROWS:
        made = next(iter(sb.load_scenes("demo", water=water, width=width, height=height)))
        scene = uneven(made) if is_uneven else made
        view = scene.views[k]
        both = [measured(scene, view, refine=refine) for refine in (False, True)]
        numbers = [*(psnr for psnr, _ in both), *(found for _, found in both)]
        name = f"{water}, view {k}" + (", uneven" if is_uneven else "")
        print(
            "|", " | ".join([name, *(f"{number:.2f}" for number in numbers)]), "|", flush=True
        )


if __name__ == "__main__":
    main()
