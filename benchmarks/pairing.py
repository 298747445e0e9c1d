"""How long pairing takes here, beside the paper's rule written plainly in PyTorch, and how much memory it needs.

Run: python benchmarks/pairing.py. Both pair one view of the demo scene with all others, images and depth maps being in
memory already, on the same machine in the same run, in turns; the ratio of their fastest turns at equal threads is what
to compare between machines.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import torch

import sucre_bench as sb
from sucre_bench.multiview.observations import Observations
from sucre_bench.multiview.observe import observe
from sucre_bench.multiview.pairing import lift, match
from sucre_bench.scene import View

TURNS = 5
COPIES = 100  # of a view, to have observations enough to tell their memory from the rest

Pairs = list[np.ndarray]  # a view each: (2, M) flat pixels of the target and of the view


def ours(target: View, others: Sequence[View], n_threads: int) -> Pairs:
    """A view a thread, as `observe` does it."""
    surface = lift(target)
    with ThreadPoolExecutor(n_threads) as pool:
        matches = list(pool.map(partial(match, surface), others))
    return [np.stack([found.pixels, found.others]) for found in matches if found is not None]


def plain(
    target: View, others: Sequence[View], depths: dict[str, torch.Tensor], n_threads: int
) -> Pairs:
    """Eq. 4 and 5 as they are written: where all pixels of each view land in the other, then who finds whom."""
    torch.set_num_threads(n_threads)
    pairs = []
    for view in others:
        there = landings(target, view, depths)
        back = landings(view, target, depths)
        pixels = torch.nonzero(there >= 0)[:, 0]
        pixels = pixels[back[there[pixels]] == pixels]
        pairs.append(torch.stack([pixels, there[pixels]]).numpy())
    return pairs


def landings(one: View, two: View, depths: dict[str, torch.Tensor]) -> torch.Tensor:
    """The flat pixel of view 2 on which each pixel of view 1 lands, -1 for none."""
    depth = depths[one.name]
    height, width = depths[two.name].shape
    v, u = torch.meshgrid(*(torch.arange(n) + 0.5 for n in depth.shape), indexing="ij")
    xy1 = torch.stack([u, v, torch.ones_like(u)]).reshape(3, -1)
    to_two = two.cam_from_world @ np.linalg.inv(one.cam_from_world)
    K_inv, K, pose = (
        torch.from_numpy(m).float() for m in (np.linalg.inv(one.camera.K), two.camera.K, to_two)
    )
    x, y, w = K @ (pose[:3, :3] @ (K_inv @ xy1 * depth.reshape(-1)) + pose[:3, 3:])
    u, v = torch.floor(x / w), torch.floor(y / w)
    lands = (depth.reshape(-1) > 0) & (w > 0) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
    return torch.where(lands, v * width + u, -1).long()


def share_that_differs(some: Pairs, others: Pairs) -> float:
    """The symmetric difference of all pairs, as a share of them."""
    n_both = sum(
        len(set(zip(*a, strict=True)) & set(zip(*b, strict=True)))
        for a, b in zip(some, others, strict=True)
    )
    n, m = (sum(pairs.shape[1] for pairs in both) for both in (some, others))
    return (n + m - 2 * n_both) / n


def timed(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def peak_bytes() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def bytes_an_observation(view: View) -> tuple[Observations, float]:
    """What a view shows in many copies of itself, and by how much the memory rose for each observation."""
    views = [replace(view, name=f"copy {k}") for k in range(COPIES)]
    observe(views[0], views[:4])
    before = peak_bytes()
    observations = observe(views[0], views)
    return observations, (peak_bytes() - before) / len(observations)


def main() -> None:
    n_cores = torch.get_num_threads()
    scene = next(sb.load_scenes("demo"))
    target = scene.views[len(scene) // 2]
    others = [view for view in scene if view is not target]

    observations, n_bytes = bytes_an_observation(target)
    print(
        f"memory: {len(observations):,} observations, peak {n_bytes:.1f} bytes each, 7 of them kept"
    )
    del observations

    depths = {view.name: torch.from_numpy(view.depth.copy()) for view in scene}
    pairs = ours(target, others, 1)
    differs = share_that_differs(pairs, plain(target, others, depths, 1))
    assert differs < 1e-3, "the two must find the same pairs to be compared"
    print(
        f"pairs: {sum(p.shape[1] for p in pairs):,} in {len(others)} views, {differs:.1e} of them differ\n"
    )
    n_pixels = len(others) * target.depth.size
    print("pairing                          s   ns a pixel and view   ratio")
    for n_threads in sorted({1, n_cores}):
        turns = [
            (
                timed(lambda n=n_threads: ours(target, others, n)),
                timed(lambda n=n_threads: plain(target, others, depths, n)),
            )
            for _ in range(TURNS)
        ]
        seconds = [min(column) for column in zip(*turns, strict=True)]
        for name, its in zip(("ours", "plain, PyTorch"), seconds, strict=True):
            label = f"{name}, {n_threads} thread{'s'[: n_threads > 1]}"
            print(f"{label:27} {its:7.3f} {its / n_pixels * 1e9:21.0f} {its / seconds[0]:7.1f}")
    for view in scene:
        _ = view.rgb
    print("\nall observations                 s      million")
    for options in (
        {},
        {"encoding": "linear"},
    ):
        observe(target, scene.views, **options)
        seconds = min(
            timed(lambda options=options: observe(target, scene.views, **options))
            for _ in range(TURNS)
        )
        name = ", ".join(options.values()) or "as the paper"
        print(
            f"{name:27} {seconds:7.3f} {len(observe(target, scene.views, **options)) / 1e6:12.2f}"
        )


if __name__ == "__main__":
    main()
