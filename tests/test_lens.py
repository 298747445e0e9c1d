"""Undistortion, against points projected by the formulas of the lens models."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from colmap_folder import FORWARD, write_image, write_model

from sucre_bench import Camera
from sucre_bench.datasets.colmap import Colmap
from sucre_bench.loading.lens import Lens

CAMERA = Camera(np.array([[420.0, 0, 330], [0, 400, 236], [0, 0, 1]]), 640, 480)
BROWN = (-0.21, 0.08, 0.002, -0.003, 0.01)
FISHEYE = (-0.03, 0.02, -0.01, 0.004)


def project(points: np.ndarray, model: str, k: tuple[float, ...]) -> np.ndarray:
    """Where the lens images points at unit depth (P, 2), in pixels with centres at +0.5: the published formulas."""
    x, y = points.T
    r2 = x**2 + y**2
    if model == "fisheye":  # Kannala & Brandt: the angle from the axis is bent
        r = np.sqrt(r2)
        angle = np.arctan(r)
        bent = angle * (1 + k[0] * angle**2 + k[1] * angle**4 + k[2] * angle**6 + k[3] * angle**8)
        x, y = x * bent / r, y * bent / r
    else:
        radial = 1 + k[0] * r2 + k[1] * r2**2 + k[4] * r2**3
        x, y = (
            x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x**2),
            y * radial + k[2] * (r2 + 2 * y**2) + 2 * k[3] * x * y,
        )
    K = CAMERA.K
    return np.stack([K[0, 0] * x + K[0, 2], K[1, 1] * y + K[1, 2]], -1)


def spot_image(at: np.ndarray) -> np.ndarray:
    """A soft spot of two pixels' width, centred at a pixel position."""
    u, v = np.meshgrid(np.arange(CAMERA.width) + 0.5, np.arange(CAMERA.height) + 0.5)
    spot = np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * 2.0**2))
    return np.repeat(spot[..., None], 3, axis=-1).astype(np.float32)


def centre(image: np.ndarray) -> np.ndarray:
    """The spot's centre of mass, in pixels with centres at +0.5."""
    weight = image[..., 0].astype(np.float64)
    v, u = np.indices(weight.shape) + 0.5
    return np.array([(u * weight).sum(), (v * weight).sum()]) / weight.sum()


@pytest.mark.parametrize(("model", "k"), [("perspective", BROWN), ("fisheye", FISHEYE)])
@pytest.mark.parametrize("point", [(0.0, 0.01), (-0.5, 0.3), (0.55, -0.4)])
def test_a_point_lies_where_the_pinhole_sees_it(model, k: tuple[float, ...], point: tuple[float, float]):
    lens = Lens(CAMERA, model, k)
    photographed = spot_image(project(np.array([point]), model, k)[0])
    straight = lens.undistorted(photographed, (640, 480))
    expected = lens.pinhole.K @ [*point, 1]
    np.testing.assert_allclose(centre(straight), expected[:2], atol=0.05)
    half = lens.undistorted(photographed, (320, 240))
    np.testing.assert_allclose(centre(half), expected[:2] / 2, atol=0.05)


@pytest.mark.parametrize(("model", "k"), [("perspective", BROWN), ("fisheye", FISHEYE), ("perspective", (0.2,))])
def test_no_pixel_of_the_pinhole_looks_past_the_photograph_and_little_is_lost(model, k: tuple[float, ...]):
    pinhole = Lens(CAMERA, model, k).pinhole
    u, v = np.meshgrid(np.linspace(0, 640, 65), np.linspace(0, 480, 49))
    rays = np.stack([u, v, np.ones_like(u)], -1).reshape(-1, 3) @ np.linalg.inv(pinhole.K).T
    seen = project(rays[:, :2], model, (*k, 0, 0, 0, 0, 0))
    assert (seen > -0.5).all()
    assert (seen < [640.5, 480.5]).all()
    for side in (seen[:, 0].min(), seen[:, 1].min(), 640 - seen[:, 0].max(), 480 - seen[:, 1].max()):
        assert side < 60


def test_without_distortion_nothing_changes():
    image = np.random.default_rng(0).random((480, 640, 3)).astype(np.float32)
    lens = Lens(CAMERA, "perspective", ())
    np.testing.assert_allclose(lens.pinhole.K, CAMERA.K, atol=1e-6)
    np.testing.assert_allclose(lens.undistorted(image, (640, 480)), image, atol=1e-4)


@pytest.mark.parametrize(
    ("camera", "model", "k"),
    [
        ("1 SIMPLE_RADIAL 640 480 420 330 236 -0.2", "perspective", (-0.2,)),
        ("1 OPENCV 640 480 420 400 330 236 -0.21 0.08 0.002 -0.003", "perspective", BROWN[:4]),
        ("1 OPENCV_FISHEYE 640 480 420 400 330 236 -0.03 0.02 -0.01 0.004", "fisheye", FISHEYE),
    ],
)
def test_a_colmap_folder_with_a_distorted_camera_is_undistorted_on_the_way(
    tmp_path: Path, camera: str, model: str, k: tuple[float, ...]
):
    write_model(tmp_path / "sparse", [("a.png", FORWARD, 1)], cameras=[camera])
    picture = np.random.default_rng(0).integers(0, 255, (480, 640, 3), dtype=np.uint8)
    write_image(tmp_path / "images" / "a.png", picture)
    view = next(iter(Colmap(root=tmp_path, undistort=True).scenes()))["a.png"]
    focal_y = 420 if "SIMPLE" in camera else 400
    K = np.array([[420.0, 0, 330], [0, focal_y, 236], [0, 0, 1]])
    lens = Lens(Camera(K, 640, 480), model, k)  # type: ignore[arg-type]
    assert view.camera is not None
    np.testing.assert_allclose(view.camera.K, lens.pinhole.K, atol=1e-9)
    np.testing.assert_allclose(view.rgb, lens.undistorted(picture / np.float32(255), (640, 480)), atol=1e-6)
