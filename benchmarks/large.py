"""Every restorer on one photograph of 24 megapixels: seconds and memory.

Run: python benchmarks/large.py [WIDTH HEIGHT] [METHOD ...]. Each runs in a process of its own on the nearest view of a
demo scene of three views, with its default options; those that must be given a file are left out.
"""

from __future__ import annotations

import multiprocessing
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import MISSING

import numpy as np

import sucre_bench as sb
from sucre_bench.plugins.options import options_of
from sucre_bench.plugins.registry import find, usable
from sucre_bench.scene import Scene


def methods() -> Iterator[str]:
    for plugin in usable("method").values():
        if all(o.default is not MISSING for o in options_of(plugin.cls)):
            yield plugin.name


def photograph(width: int, height: int) -> Scene:
    return next(sb.load_scenes("demo", width=width, height=height, views=3))


def measured(name: str, width: int, height: int) -> str:
    scene = photograph(width, height)
    view = scene.views[-1]
    method = find("method", name).cls()
    if hasattr(method, "warm_up"):
        method.warm_up()
    try:
        result = sb.restore(method, scene, view)
    except Exception as fault:
        return f"failed: {fault}"
    whole = np.isfinite(result.image[view.valid]).all()
    return f"{result.info['seconds']:8.1f} s {result.info['peak_mb']:8.0f} MB  {'' if whole else 'HOLES'}"


def main() -> None:
    width, height = (int(word) for word in (sys.argv[1:3] or ("6000", "4000")))
    photograph(width, height)  # made once, here
    spawn = multiprocessing.get_context("spawn")
    for name in sys.argv[3:] or methods():
        with ProcessPoolExecutor(1, mp_context=spawn) as alone:
            print(
                f"{name:20}", alone.submit(measured, name, width, height).result(), flush=True
            )


if __name__ == "__main__":
    main()
