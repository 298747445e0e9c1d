"""Compiles all loops before the first image, so that the time of no image includes compiling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sucre_bench.camera import Camera
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.passes import Backend, opened
from sucre_bench.methods.sucre.refine_edges import Target, corrected_edges
from sucre_bench.methods.sucre.refine_gaps import even_deviation
from sucre_bench.multiview.footprints import matched_footprints
from sucre_bench.multiview.observe import Options, observe
from sucre_bench.scene import Arrays, View

_PX = 8


def compile_for(backend: Backend, device: Device, options: Options) -> None:
    """Pair two small views and run every pass over their observations, with colours of 8 bits and with those of matched
    footprints: seconds the first time, then no time."""
    camera = Camera(np.array([[_PX, 0, _PX / 2], [0, _PX, _PX / 2], [0, 0, 1.0]]), _PX, _PX)
    grey = np.full((_PX, _PX, 3), 128 / 255)
    one, same = (View(name, Arrays(grey, np.ones((_PX, _PX))), camera, np.eye(4)) for name in ("one", "same"))
    observations = observe(one, [one, same], **options)
    matched_footprints(one, [one, same], observations.pixels, **options)
    even_deviation(observations, np.ones((3, len(observations.pixels)), dtype=np.float32), one.distance)
    water = WaterParameters.of_channels(np.full((3, 3), 0.1))
    corrected_edges(Target(grey, grey, np.ones((_PX, _PX))), grey, np.ones_like(grey), water)
    for seen in (observations, replace(observations, colour=observations.colour.astype(np.float32))):
        with opened(seen, backend, device) as kernel:
            for margin in (None, np.full(3, 0.1)):
                kernel.system(water, margin)
            kernel.colours(water, np.ones(3), np.zeros((3, 3, 3)))
