"""What a user waits for: whole commands and single steps, beside their targets, and beside an earlier checkout.

Run: python benchmarks/end_to_end.py [CHECKOUT] [--views 2000] [--root DIVE --view NAME]. CHECKOUT is the folder of an
earlier version, whose commands run in the same environment, in turn with ours. DIVE is a folder in the layout of the
colmap dataset; without one, the demo scene is restored. NAME is the view that is restored and, enlarged, scored. CPU
seconds and the largest process of a command are what the operating system counted; a command's first run, which may
compile, is not counted where it says "again".
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from pairing import landings

import sucre_bench as sb
from metrics import CHARTS, DEFAULT, EVERY, of, picture, scored
from sucre_bench.camera import Camera
from sucre_bench.loading.view_files import Files, with_shared_pixels
from sucre_bench.machine.cache import ArrayStore, storing
from sucre_bench.multiview.observe import observe
from sucre_bench.results.rows import Row
from sucre_bench.results.table import Part
from sucre_bench.scene import Chart, Scene, View

HERE = Path(__file__).resolve().parent.parent
WIDTH = 4000
HEIGHT = 3000
# of 100: what more neighbours take tells what 100 do
FEW = 2
NEIGHBOURS = 8
PLAIN = ("tracking.uri=off", "report=false")


@dataclass(frozen=True)
class Taken:
    """CPU and wall seconds, and MB of the largest process."""

    cpu_s: float
    wall_s: float
    mb: float

    def __str__(self) -> str:
        return f"{self.cpu_s:8.2f} {self.wall_s:8.2f} {'' if np.isnan(self.mb) else round(self.mb):>7}"


def command(checkout: Path, *words: str) -> Taken:
    """Run a command of a checkout's sucre-bench as a process of its own."""
    code = "import sys; sys.argv[0] = 'sucre-bench'; from sucre_bench.cli import main; main()"
    environment = {**os.environ, "PYTHONPATH": str(checkout), "PYTHONSAFEPATH": "1"}
    started = time.perf_counter()
    with subprocess.Popen(
        [sys.executable, "-c", code, *words],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stderr is not None
        said = process.stderr.read().decode()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(
            f"{checkout}: sucre-bench {' '.join(words)} ended with {process.returncode}\n{said}"
        )
    return Taken(
        usage.ru_utime + usage.ru_stime, time.perf_counter() - started, usage.ru_maxrss / 1024
    )


def step(work: Callable[[], object]) -> Taken:
    """Run a step in this process, whose memory is not of the step alone."""
    cpu, wall = time.process_time(), time.perf_counter()
    work()
    return Taken(time.process_time() - cpu, time.perf_counter() - wall, np.nan)


def show(
    what: str, target: str, ours: Taken, before: Taken | None = None, note: str = ""
) -> None:
    ratio = f"{before} {before.cpu_s / max(ours.cpu_s, 1e-9):6.1f}" if before else " " * 32
    print(f"{what:46} {target:>12} {ours} {ratio}  {note}", flush=True)


def commands(folder: Path, checkouts: Sequence[Path], n: int, dive: Sequence[str]) -> None:
    """Whole commands, by each checkout in turn."""
    photos = made_photos(folder / "photos", n)

    def one_view(checkout: Path, *words: str) -> Taken:
        return command(
            checkout, "run", *dive, "method=sucre", f"out={folder / fresh()}", *words
        )

    for checkout in checkouts:
        one_view(checkout, *PLAIN)  # compiles
    show("one view, sucre, again", "6 s wall", *(one_view(c) for c in checkouts))
    show("  without mlflow and page", "4 s wall", *(one_view(c, *PLAIN) for c in checkouts))
    outs = {c: f"out={folder / fresh()}" for c in checkouts}
    many = (
        "run",
        "-m",
        "dataset=photos",
        f"dataset.root={photos}",
        "method=underwater,gray_world",
        *PLAIN,
    )
    first = [command(c, *many, outs[c]) for c in checkouts]
    show(f"{n} tiny views x 2 methods", f"{2 * n * 0.03:.0f} s, 500 MB", *first)
    show("  all stored", "5 s", *(command(c, *many, outs[c]) for c in checkouts))
    show(
        "  compare",
        "2 s",
        *(command(c, "compare", outs[c].removeprefix("out=")) for c in checkouts),
    )
    show(
        "  report",
        "5 s",
        *(command(c, "report", outs[c].removeprefix("out=")) for c in checkouts),
    )


_counter: Iterator[int] = iter(range(1000))


def fresh() -> str:
    return f"out{next(_counter)}"


def made_photos(folder: Path, n: int) -> Path:
    folder.mkdir()
    rng = np.random.default_rng(0)
    for k in range(n):
        coarse = rng.integers(0, 256, (6, 8, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / f"{k:05}.png"), cv2.resize(coarse, (64, 48)))
    return folder


def texture(k: int, width: int, height: int) -> np.ndarray:
    coarse = np.random.default_rng(k).integers(
        0, 256, (height // 20, width // 20, 3), dtype=np.uint8
    )
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)


def scoring(photograph: Path | None) -> None:
    """Metrics of a picture of 12 megapixels, and scikit-image's SSIM of the same."""
    from skimage.metrics import structural_similarity

    shot = picture(WIDTH, HEIGHT, photograph)
    restoration, view = of(shot)
    scored(*of(shot[:600, :800]), DEFAULT + EVERY)  # compiles
    shown = np.clip(restoration.image, 0, 1)
    skimage = step(lambda: structural_similarity(shown, shot, data_range=1, channel_axis=-1))
    ours = step(lambda: scored(restoration, view, DEFAULT))
    show(
        "six default metrics and display, 12 MP",
        "1.5 s",
        ours,
        note=f"{ours.cpu_s / skimage.cpu_s:.2f} x skimage's SSIM",
    )
    show("uciqe:all and uiqm:all, 12 MP", "4 s", step(lambda: scored(*of(shot), EVERY)))
    frame = np.array([[0, 0], [30, 0], [30, 20], [0, 20]])
    places = [np.array([n % 100 * 38 + 4, n // 100 * 290 + 4]) for n in range(1000)]
    charts = [Chart(f"c{n}", "dgk", np.add(frame, place)) for n, place in enumerate(places)]
    scored(*of(shot, charts[:2]), CHARTS)
    show("psi and de00 of 1,000 charts", "2 s", step(lambda: scored(*of(shot, charts), CHARTS)))


def writing(folder: Path) -> None:
    """Rows of views with 767 scores each, a flush every second view."""
    rows = [
        replace(
            Row(options="{}", time="2026-01-01T00:00:00.000000+00:00"),
            view=f"{n // 767}.png",
            region=f"c/{n % 767}",
        )
        for n in range(200 * 767)
    ]
    Part(folder / "warm", "job", 0).add(rows[:10])
    part = Part(folder / "rows", "job", np.inf)

    def write() -> None:
        for start in range(0, len(rows), 2 * 767):
            part.add(rows[start : start + 2 * 767])
        part.flush()

    taken = step(write)
    show(
        f"writing {len(rows):,} rows",
        "2 us a row",
        taken,
        note=f"{1e6 * taken.cpu_s / len(rows):.2f} us a row",
    )


def pairing(folder: Path) -> None:
    """One target of 12 megapixels with its neighbours, decoded once, and the paper's rule in plain PyTorch."""
    views, camera = (
        [],
        Camera(np.array([[3600.0, 0, 2000], [0, 3600, 1500], [0, 0, 1]]), WIDTH, HEIGHT),
    )
    ground = texture(1, WIDTH + 40 * NEIGHBOURS, HEIGHT)
    (folder / "dive").mkdir()
    for k in range(NEIGHBOURS + 1):
        image, depth, pose = (
            folder / "dive" / f"{k}.png",
            folder / "dive" / f"depth_{k}.png",
            np.eye(4),
        )
        cv2.imwrite(
            str(image), ground[:, 40 * k : 40 * k + WIDTH], [cv2.IMWRITE_PNG_COMPRESSION, 1]
        )
        cv2.imwrite(str(depth), np.full((HEIGHT, WIDTH), 3600, np.uint16))
        pose[0, 3] = -0.04 * k  # nearly all pixels are seen again
        views.append(View(image.name, Files(image, (WIDTH, HEIGHT), depth), camera, pose))
    scene = with_shared_pixels(
        Scene("dive", views, frozenset({"depth", "poses"}), data_id="benchmark")
    )
    observe(*_small())  # compiles
    with storing(ArrayStore(folder / "store", 1e11)):
        decoding = step(
            lambda: [(view.pixels.load("rgb"), view.pixels.load("depth")) for view in scene]
        )
        observe(scene[0], scene.views[:2])  # the first one also maps files
        few = step(lambda: observe(scene[0], scene.views[: FEW + 1]))
        ours = step(lambda: observe(scene[0], scene.views))
        depths = {view.name: torch.from_numpy(view.depth.copy()) for view in scene.views[:2]}
    two_maps = step(
        lambda: (landings(*scene.views[:2], depths), landings(*scene.views[1::-1], depths))
    )
    show(
        "decoding 100 views of 12 MP, once a run",
        "",
        _extrapolated(Taken(0, 0, np.nan), 0, decoding, NEIGHBOURS + 1),
    )
    whole = _extrapolated(few, FEW, ours, NEIGHBOURS)
    note = f"{whole.cpu_s / 100 / two_maps.cpu_s:.2f} x two maps in PyTorch"
    show(f"pairing 12 MP with 100 views, from {FEW} and {NEIGHBOURS}", "20 s", whole, note=note)


def _small() -> tuple[View, Sequence[View]]:
    small = next(sb.load_scenes("demo", views=2, width=160, height=120))
    return small[0], small.views


def _extrapolated(few: Taken, n_few: int, many: Taken, n_many: int) -> Taken:
    """What 100 views take, along the line through two numbers of views: part of the work is done once a target."""
    further = (100 - n_many) / (n_many - n_few)
    cpu_s = many.cpu_s + further * (many.cpu_s - few.cpu_s)
    return Taken(cpu_s, many.wall_s + further * (many.wall_s - few.wall_s), many.mb)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkout", nargs="?", type=Path)
    parser.add_argument("--views", type=int, default=2000)
    parser.add_argument("--root", type=Path)
    parser.add_argument("--view", default="")
    given = parser.parse_args()
    dive = ["dataset=demo", "first=1"]
    if given.root:
        dive = [
            "dataset=colmap",
            f"dataset.root={given.root}",
            f"views=['{given.view}']" if given.view else "first=1",
        ]
    heading = "   CPU s   wall s      MB"
    before = f"{heading}  ratio  (ours, then {given.checkout})" if given.checkout else ""
    print(f"{'':46} {'target':>12} {heading} {before}")
    with tempfile.TemporaryDirectory() as folder:
        commands(
            Path(folder),
            [HERE, *([given.checkout.resolve()] if given.checkout else [])],
            given.views,
            dive,
        )
        writing(Path(folder))
        scoring(next(given.root.rglob(given.view)) if given.root and given.view else None)
        pairing(Path(folder))


if __name__ == "__main__":
    main()
