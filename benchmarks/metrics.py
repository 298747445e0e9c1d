"""What scoring a picture of 12 megapixels costs: CPU seconds, their ratio to scikit-image's SSIM, memory.

Run: python benchmarks/metrics.py [WIDTH HEIGHT [PHOTOGRAPH]]. The photograph is enlarged to that size and given some
noise; without one, a view of the demo scene is taken. Compiling and imports are not counted: all is done once before,
on a small part of the picture. Memory is that of the whole process, with four images of 144 MB that are there before:
the view, its reference, the restoration, and what it is shown as.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

import sucre_bench as sb
from sucre_bench.arrays import Array
from sucre_bench.engine.score import score_rows, scorers
from sucre_bench.imaging.display import display
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.jobs.catalogue import metric_choices
from sucre_bench.results.rows import Row
from sucre_bench.scene import Chart, Plane, Restoration, View

DEFAULT = ("psnr", "ssim", "uciqe", "uiqm", "coverage", "negative")
EVERY = ("uciqe:all", "uiqm:all")
CHARTS = ("psi", "de00")
TURNS = 3


def picture(width: int, height: int, photograph: Path | None) -> Array:
    rgb = read_rgb(photograph) if photograph else next(sb.load_scenes("demo")).views[0].rgb
    enlarged = cv2.resize(rgb, (width, height), interpolation=cv2.INTER_CUBIC)
    grain = np.random.default_rng(0).normal(0, 0.01, enlarged.shape).astype(np.float32)
    return np.asarray((enlarged + grain).clip(0, 1))


@dataclass(frozen=True, eq=False)
class Held:
    """Pixels in memory, as if decoded just now: not copied again."""

    rgb: Array
    reference: Array

    def load(self, plane: Plane) -> Array | None:
        return None if plane == "depth" else self.rgb if plane == "rgb" else self.reference


def of(rgb: Array, charts: list[Chart] | None = None) -> tuple[Restoration, View]:
    """A restoration of the picture, and the view, whose reference is the picture."""
    restored = rgb * np.float32([1.4, 1.0, 0.9]) - np.float32(0.05)
    return Restoration(restored), View("a.png", Held(rgb, rgb.copy()), charts=charts or ())


def scored(restoration: Restoration, view: View, metrics: tuple[str, ...]) -> None:
    """Show the restoration, and score it as the engine does."""
    shown = display(restoration.image, "stretch-1-99")
    rows = score_rows(restoration, shown, view, scorers(metric_choices(metrics)), Row())
    assert all(row.status != "failed" for row in rows), [
        row.reason for row in rows if row.status == "failed"
    ]


def fastest(work: Callable[[], object], turns: int = TURNS) -> tuple[float, float, float]:
    """CPU and wall seconds of the fastest turn, and the highest memory of the process meanwhile, GiB."""
    taken = []
    Path("/proc/self/clear_refs").write_text("5")  # forget what was highest before
    for _ in range(turns):
        cpu, wall = time.process_time(), time.perf_counter()
        work()
        taken.append((time.process_time() - cpu, time.perf_counter() - wall))
    status = Path("/proc/self/status").read_text()
    peak_kib = next(
        int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")
    )
    return *min(taken), peak_kib / 2**20


def scikit_ssim(shown: Array, view: View) -> None:
    from skimage.metrics import structural_similarity

    structural_similarity(
        shown,
        view.rgb,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=1.0,
        channel_axis=-1,
    )


def grid_of_charts(width: int, height: int, side: int) -> list[Chart]:
    """side x side charts beside one another."""
    w, h = width / side, height / side
    frame = np.array([[0.05, 0.05], [0.95, 0.05], [0.95, 0.95], [0.05, 0.95]]) * [w, h]
    return [
        Chart(f"{i}-{j}", "dgk", frame + np.array([i * w, j * h]))
        for i in range(side)
        for j in range(side)
    ]


def main() -> None:
    width, height = (int(word) for word in (sys.argv[1:3] or ("4242", "2829")))
    rgb = picture(width, height, Path(sys.argv[3]) if len(sys.argv) > 3 else None)
    charts = grid_of_charts(width, height, 32)[:1000]
    small = of(rgb[:400, :600], grid_of_charts(600, 400, 2))
    for metrics in (DEFAULT, EVERY, CHARTS):
        scored(*small, metrics)
    scikit_ssim(small[0].image, small[1])
    whole = of(rgb)
    with_charts = whole[0], replace(whole[1], charts=charts)
    works: dict[str, tuple[Callable[[], object], int]] = {
        "display": (lambda: display(whole[0].image, "stretch-1-99"), TURNS),
        "display + six default metrics": (lambda: scored(*whole, DEFAULT), TURNS),
        "display + uciqe:all, uiqm:all": (lambda: scored(*whole, EVERY), TURNS),
        "display + psi, de00 of 1,000 charts": (lambda: scored(*with_charts, CHARTS), TURNS),
        "SSIM of scikit-image": (lambda: scikit_ssim(whole[0].image, whole[1]), 1),
    }
    taken = {name: fastest(*work) for name, work in works.items()}
    against = taken["SSIM of scikit-image"][0]
    print(f"{width}x{height}")
    print(f"{'':38}{'CPU s':>8}{'wall s':>8}{'ratio of CPU s':>16}{'peak memory, GiB':>18}")
    for name, (cpu, wall, peak) in taken.items():
        print(f"{name:38}{cpu:8.2f}{wall:8.2f}{cpu / against:16.3f}{peak:18.2f}")


if __name__ == "__main__":
    main()
