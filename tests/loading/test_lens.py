"""Undistortion, against points projected by the formulas of the lens models."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.bent_rays import bent
from support.colmap_folder import FORWARD, to_binary, write_image, write_model
from support.miniatures import centre, write_spot

from sucre_bench import Camera, InputError
from sucre_bench.datasets.colmap import Colmap
from sucre_bench.loading.lens import Lens
from sucre_bench.loading.view_files import Photograph, view_of

CAMERA = Camera(np.array([[420.0, 0, 330], [0, 400, 236], [0, 0, 1]]), 640, 480)
BROWN = (-0.21, 0.08, 0.002, -0.003, 0.01)
FISHEYE = (-0.03, 0.02, -0.01, 0.004)


def project(points: np.ndarray, model: str, k: tuple[float, ...]) -> np.ndarray:
    """Where the lens images points at unit depth (P, 2), in pixels with centres at +0.5."""
    is_fisheye = model == "fisheye"
    radial, p = (k, ()) if is_fisheye else ((k[0], k[1], k[4], 0.0), k[2:4])
    x, y = bent(*points.T, is_fisheye, radial, p)
    K = CAMERA.K
    return np.stack([K[0, 0] * x + K[0, 2], K[1, 1] * y + K[1, 2]], -1)


@pytest.mark.parametrize(
    ("model", "k"), [("perspective", BROWN), ("fisheye", FISHEYE), ("perspective", (0.2,))]
)
def test_no_pixel_of_the_pinhole_looks_past_the_photograph_and_little_is_lost(
    model, k: tuple[float, ...]
):
    pinhole = Lens(CAMERA, model, k).pinhole
    u, v = np.meshgrid(np.linspace(0, 640, 65), np.linspace(0, 480, 49))
    rays = np.stack([u, v, np.ones_like(u)], -1).reshape(-1, 3) @ np.linalg.inv(pinhole.K).T
    seen = project(rays[:, :2], model, (*k, 0, 0, 0, 0, 0))
    assert (seen > -0.5).all()
    assert (seen < [640.5, 480.5]).all()
    assert (seen.min(axis=0) < 60).all()
    assert (seen.max(axis=0) > [580, 420]).all()


def test_strips_of_rows_join_where_the_picture_is_large():
    """3,000 pixels of width are brought over in strips: each row lies where the whole image's map says."""
    wide = Lens(
        Camera(np.array([[2000.0, 0, 1510], [0, 2000, 90], [0, 0, 1]]), 3000, 200),
        "perspective",
        (-0.1,),
    )
    v = np.broadcast_to(np.arange(200, dtype=np.float32)[:, None] + 0.5, (200, 3000))
    K = wide.pinhole.K
    x, y = (
        (n + 0.5 - K[i, 2]) / K[i, i]
        for i, n in ((0, np.arange(3000)), (1, np.arange(200)[:, None]))
    )
    expected = 2000 * y * (1 - 0.1 * (x**2 + y**2)) + 90
    np.testing.assert_allclose(
        wide.undistorted(v, (3000, 200)), expected.clip(0.5, 199.5), atol=0.02
    )


# -- lenses that cannot be undone -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("focal", "model", "k", "says"),
    [
        (300.0, "fisheye", (0.0,), "borders"),  # its sides look back, at 95 degrees
        (500 / np.radians(88), "fisheye", (0.0,), "angle"),  # 176 degrees
        (700.0, "perspective", (-0.35,), "borders"),  # r (1 - .35 r^2) never reaches 500 / 700
        (700.0, "perspective", (float("nan"),), "borders"),
        (700.0, "perspective", (float("inf"),), "borders"),
        (700.0, "perspective", (1e300,), "borders"),
    ],
)
def test_a_lens_without_a_pinhole_image_says_so(focal: float, model: Any, k: Any, says: str):
    camera = Camera(np.array([[focal, 0, 500], [0, focal, 375], [0, 0, 1]]), 1000, 750)
    lens = Lens(camera, model, k)
    assert says in lens.fault
    with pytest.raises(InputError, match=rf"{says}.*; "):
        _ = lens.pinhole
    with pytest.raises(InputError, match=rf"dive.png: .*{says}.*; "):
        view_of(Photograph("dive.png", Path("dive.png"), lens, None))


@pytest.mark.parametrize(
    ("focal", "model", "k", "expected"),
    [
        # 150 degrees across are not too many
        (
            500 / np.radians(75),
            "fisheye",
            0.0,
            500 / np.tan(np.radians(75)),
        ),
        # The sides, at 500 / 700, are seen at the root of r (1 - .25 r^2) = 5 / 7; the corners have none, and are left.
        (700.0, "perspective", -0.25, 500 / np.roots([-0.25, 0, 1, -5 / 7])[2].real),
    ],
)
def test_a_wide_lens_with_corners_that_nothing_images_still_has_a_pinhole(
    focal: float, model: Any, k: float, expected: float
):
    lens = Lens(
        Camera(np.array([[focal, 0, 500], [0, focal, 375], [0, 0, 1]]), 1000, 750), model, (k,)
    )
    assert lens.fault == ""
    assert lens.pinhole.K[0, 0] == pytest.approx(expected, rel=1e-9)


def test_there_is_no_ray_where_the_lens_images_nothing():
    no_further = Lens(CAMERA, "perspective", (-0.35,)).rays(
        np.array([[330.0, 236.0], [330.0 + 420 * 0.8, 236.0]])
    )
    np.testing.assert_allclose(no_further[0], 0, atol=1e-9)
    assert np.isnan(no_further[1]).all()
    # a (1 + .1 a^2 + .3 a^4 + .1 a^6 - .5 a^8) turns back at a = .95: angles of 1.01 and .87 have the same place.
    ray = Lens(CAMERA, "fisheye", (0.1, 0.3, 0.1, -0.5)).rays(np.array([[0.0, 0.0]]))
    assert not np.linalg.norm(ray) > np.tan(0.95)


@pytest.mark.parametrize("k", [(0, 0, 0, 0, -0.3), (-0.6, -0.1, 0, 0, 0.1)])
def test_a_lens_whose_pinhole_would_show_a_place_twice_has_none(k: tuple[float, ...]):
    assert Lens(CAMERA, "perspective", k).fault


# -- COLMAP's camera models, each against a pixel worked out by hand ---------------------------------------

# Where a camera of 640x480 with its principal point at (320, 240) images a ray at unit depth.
# (.4, -.3): r^2 = .25, r^4 = .0625, r^6 = .015625. (.6, .8): the angle from the axis is pi / 4.
PIXELS: dict[str, tuple[str, tuple[float, float], tuple[float, float]]] = {
    # 1 - .2 r^2 = .95
    "SIMPLE_RADIAL": ("400 320 240 -.2", (0.4, -0.3), (320 + 400 * 0.38, 240 - 400 * 0.285)),
    # 1 - .2 r^2 + .16 r^4 = .96
    "RADIAL": ("400 320 240 -.2 .16", (0.4, -0.3), (320 + 400 * 0.384, 240 - 400 * 0.288)),
    # and 2 p1 x y + p2 (r^2 + 2 x^2) = -.0024 - .0114, 2 p2 x y + p1 (r^2 + 2 y^2) = .0048 + .0043
    "OPENCV": (
        "400 500 320 240 -.2 .16 .01 -.02",
        (0.4, -0.3),
        (320 + 400 * 0.3702, 240 - 500 * 0.2789),
    ),
    # (.96 + .64 r^6) / (1 + .4 r^2 + .16 r^4 + .064 r^6) = .97 / 1.111
    "FULL_OPENCV": (
        "400 500 320 240 -.2 .16 .01 -.02 .64 .4 .16 .064",
        (0.4, -0.3),
        (454.173969, 113.586904),
    ),
    # a + .1 a^3 = .833845
    "SIMPLE_RADIAL_FISHEYE": ("300 320 240 .1", (0.6, 0.8), (470.092185, 440.122913)),
    # a + .1 a^3 - .05 a^5 = .818903
    "RADIAL_FISHEYE": ("300 320 240 .1 -.05", (0.6, 0.8), (467.402559, 436.536745)),
    # a + .1 a^3 - .05 a^5 + .02 a^7 - .01 a^9 = .821453
    "OPENCV_FISHEYE": (
        "300 330 320 240 .1 -.05 .02 -.01",
        (0.6, 0.8),
        (467.861514, 456.863554),
    ),
}


@pytest.mark.parametrize("form", ["text", "binary"])
@pytest.mark.parametrize("model", PIXELS)
def test_an_image_of_each_camera_model_of_colmap_is_undistorted_on_the_way(
    tmp_path: Path, model: str, form: str
):
    parameters, ray, pixel = PIXELS[model]
    write_model(
        tmp_path / "sparse",
        [("a.png", FORWARD, 1)],
        cameras=[f"1 {model} 640 480 {parameters}"],
    )
    if form == "binary":
        to_binary(tmp_path / "sparse")
    write_spot(tmp_path / "images" / "a.png", np.array(pixel), (640, 480))
    view = next(iter(Colmap(root=tmp_path, undistort=True).scenes()))["a.png"]
    np.testing.assert_allclose(centre(view.rgb), (view.camera.K @ [*ray, 1])[:2], atol=0.1)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_chart_corners_clicked_on_the_stored_image_follow_it_through_the_lens(
    tmp_path: Path, scale: float
):
    parameters = "420 400 330 236 -0.21 0.08 0.002 -0.003"
    write_model(
        tmp_path / "sparse", [("a.png", FORWARD, 1)], cameras=[f"1 OPENCV 640 480 {parameters}"]
    )
    write_image(tmp_path / "images" / "a.png", np.zeros((480, 640, 3), np.uint8))
    # of a chart at 1 m
    rays = np.array([[-0.5, -0.4], [-0.2, -0.42], [-0.21, -0.1], [-0.52, -0.12]])
    clicked = project(rays, "perspective", (*BROWN[:4], 0.0)).tolist()
    (tmp_path / "charts.json").write_text(json.dumps({"images": {"a.png": {"near": clicked}}}))
    view = next(iter(Colmap(root=tmp_path, undistort=True, image_scale=scale).scenes()))[
        "a.png"
    ]
    expected = rays * (view.camera.K[0, 0], view.camera.K[1, 1]) + view.camera.K[:2, 2]
    np.testing.assert_allclose(view.charts[0].corners, expected, atol=1e-6)
    # the lens does matter here
    assert np.abs(view.charts[0].corners - scale * np.array(clicked)).max() > 3


def test_a_chart_corner_that_no_ray_leads_to_is_named(tmp_path: Path):
    write_model(
        tmp_path / "sparse",
        [("a.png", FORWARD, 1)],
        cameras=["1 SIMPLE_RADIAL 1000 750 700 500 375 -.25"],
    )
    write_image(tmp_path / "images" / "a.png", np.zeros((750, 1000, 3), np.uint8))
    corners = [[1, 1], [300, 1], [300, 300], [1, 300]]
    (tmp_path / "charts.json").write_text(json.dumps({"images": {"a.png": {"near": corners}}}))
    with pytest.raises(InputError, match=r"charts\.json: a\.png, near: "):
        list(Colmap(root=tmp_path, undistort=True).scenes())


@pytest.mark.parametrize(
    ("camera", "says"),
    [
        (
            "1 OPENCV_FISHEYE 1000 750 300 300 500 375 0 0 0 0",
            "camera 1 is OPENCV_FISHEYE.*undone.*; undistort: colmap",
        ),
        (
            "1 SIMPLE_RADIAL 1000 750 700 500 375 -.35",
            "camera 1 is SIMPLE_RADIAL.*undone.*; undistort: colmap",
        ),
        (
            "1 SIMPLE_RADIAL 1000 750 700 500 375 nan",
            "camera 1 is 1000x750 with parameters .*nan.*no camera has",
        ),
    ],
)
def test_a_camera_of_a_model_that_cannot_be_undistorted_is_named(
    tmp_path: Path, camera: str, says: str
):
    write_model(tmp_path / "sparse", [("a.png", FORWARD, 1)], cameras=[camera])
    with pytest.raises(InputError, match=rf"cameras.txt: {says}") as fault:
        list(Colmap(root=tmp_path, undistort=True).scenes())
    assert "\n" not in str(fault.value)
