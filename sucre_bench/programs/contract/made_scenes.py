"""Made scenes for trying plugins: a flat wall before two cameras, and difficult images."""

from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.camera import centred_camera
from sucre_bench.degrade import Degradation, degraded_whole
from sucre_bench.imaging.chart_kinds import chart_kind
from sucre_bench.scene import HAS, Arrays, Chart, Scene, View, Water

TARGET = "far.png"  # the view to restore; the other view is nearer to the wall
WATER = Water(
    np.array([0.1, 0.3, 0.4]), np.array([0.4, 0.15, 0.1]), np.array([0.3, 0.17, 0.13])
)
_IN_WATER = Degradation(add_water=WATER)

NOISE = np.random.default_rng(0).random((64, 96, 3), dtype=np.float32)
NOISE.setflags(write=False)

# Every dive has these: open water, glare, no red channel, thumbnails.
HARD: Mapping[str, Array] = MappingProxyType(
    {
        "noise": NOISE,
        "black": np.zeros_like(NOISE),
        "white": np.ones_like(NOISE),
        "no red": NOISE * np.array([0, 1, 1], dtype=np.float32),
        "tiny": NOISE[:4, :6],
        "gray": np.full_like(NOISE, 0.5),
    }
)


def wall(
    rgb: Array = NOISE,
    holes: Mask | None = None,
    reference: Array | None = None,
    water: Water = WATER,
    charts: Iterable[Chart] = (),
) -> Scene:
    """Two views of a flat wall, 3 m and 2 m away, with the same picture rgb (H, W, 3).

    holes: (H, W), where depth is unknown in both; reference: (H, W, 3), default the picture.
    """
    height, width = rgb.shape[:2]
    camera = centred_camera(width, width, height)
    views = []
    charts = tuple(charts)
    for name, distance in ((TARGET, 3.0), ("near.png", 2.0)):
        pose = np.eye(4)
        pose[2, 3] = distance - 3
        depth = np.full((height, width), distance, np.float32)
        if holes is not None:
            depth[holes] = 0
        views.append(
            View(
                name,
                Arrays(rgb, depth, rgb if reference is None else reference),
                camera,
                pose,
                charts,
            )
        )
    has = {"depth", "poses", "reference", "truth"} | ({"charts"} if charts else set())
    return Scene("wall", views, frozenset(has), water)


def submerged() -> Scene:
    """The wall of noise through WATER at each view's distance: a fit of the water has a solution."""
    return degraded_whole(wall(), _IN_WATER)


def charted() -> Scene:
    """The wall with two painted charts and noise around them: dry in `reference`, in water in `rgb`."""
    image = 0.2 + 0.6 * np.random.default_rng(0).random((96, 128, 3), dtype=np.float32)
    charts = (
        Chart("left", "dgk", np.array([[4.0, 4], [64, 4], [64, 44], [4, 44]])),
        Chart(
            "right", "colorchecker24", np.array([[66.0, 50], [126, 50], [126, 90], [66, 90]])
        ),
    )
    for chart in charts:
        corner = chart.corners[0]
        size = chart.corners[2] - chart.corners[0]
        for patch in chart_kind(chart.kind).patches:
            (x0, y0), (x1, y1) = (
                np.round(corner + size * at).astype(int)
                for at in (patch.box[:2], patch.box[2:])
            )
            image[y0:y1, x0:x1] = patch.srgb
    return degraded_whole(wall(image, charts=charts), _IN_WATER)


def least(scene: Scene, needs: frozenset[str], cameras: bool = False) -> Scene:
    """The scene with only what is needed; cameras: keep these too, for which there is no name in `needs`."""
    views = []
    for view in scene:
        depth, reference = (
            getattr(view, name) if name in needs else None for name in ("depth", "reference")
        )
        camera = view.camera if cameras or "poses" in needs else None
        pose = view.cam_from_world if "poses" in needs else None
        charts = view.charts if "charts" in needs else ()
        views.append(
            View(
                view.name,
                Arrays(view.rgb, depth, reference),
                camera,
                pose,
                charts,
                view.encoding,
            )
        )
    return Scene("least", views, needs & HAS, scene.water if "truth" in needs else None)
