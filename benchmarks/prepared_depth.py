"""Depth that `prepare` gives made photographs, against their true depth, by the origin of the depth.

    python benchmarks/prepared_depth.py FOLDER

The photographs have no poses. Relative errors are after one scale for a scene.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import cv2
import numpy as np

import sucre_bench as sb
from sucre_bench.imaging.image_files import decode
from sucre_bench.programs.prepare.pipeline import prepare

CASES = (
    {"path": "approach", "condition": "plain", "water": "coastal"},
    {"path": "survey_varying", "condition": "all_mild", "water": "green"},
    {"path": "orbit", "relief": "rough", "condition": "jpeg_95", "water": "clear"},
)
ORIGINS = {0: "all", 1: "measured", 2: "in others", 3: "between"}


def main(folder: Path) -> None:
    print("photographs     placed  seconds  origin     share  median error    90 %   over 5 %")
    for case in CASES:
        size = {"width": 640, "height": 480, "seed": 1}
        made = sb.load_scene("nature", errors="none", root=folder / "made", **size, **case)
        geometry = "-".join([case["path"], *([case["relief"]] if "relief" in case else [])])
        photos, out = folder / geometry / "photos", folder / geometry / "out"
        photos.mkdir(parents=True, exist_ok=True)
        for view in made:
            rgb = np.rint(view.rgb * 255).astype(np.uint8)
            cv2.imwrite(str(photos / Path(view.name).with_suffix(".png")), rgb[..., ::-1])
        truth = {Path(view.name).stem: view.depth for view in made}
        start = time.process_time()
        prepare(photos, out)
        seconds = time.process_time() - start
        placed = list(next(iter(sb.load_scenes("colmap", root=out))))
        found = np.stack([view.depth for view in placed])
        origin = np.stack(
            [decode(out / "depth_origin" / view.name, cv2.IMREAD_UNCHANGED) for view in placed]
        )
        true = np.stack([truth[Path(view.name).stem] for view in placed])
        known = (found > 0) & (true > 0)
        scale = np.median(true[known] / found[known])
        for number, name in ORIGINS.items():
            chosen = known & (origin == number) if number else known
            off = np.abs(found[chosen] * scale / true[chosen] - 1)
            median, most = np.quantile(off, [0.5, 0.9]) if len(off) else (np.nan, np.nan)
            row = f"{chosen.mean():9.1%} {median:13.2%} {most:7.2%} {(off > 0.05).mean():10.2%}"
            print(f"{geometry:15} {len(placed):6} {seconds:8.0f}  {name:10}{row}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
