"""Datasets in miniature: folders of images, Eiffel Tower, SeaThru-NeRF, Sea-thru, and a survey of Metashape."""

from pathlib import Path

import numpy as np
import tifffile

from support import spots
from support.colmap_folder import picture, to_binary, write_image
from support.spots import BOTH, disk_depth, pose_of, seen, write_photographs, write_spot


def write_images(folder: Path, *names: str, seed: int = 0) -> Path:
    for number, name in enumerate(names):
        write_image(folder / name, picture(seed + number))
    return folder


YEAR = ("20150412T093000.png", "20150412T093005.png")


def write_year(root: Path, year: str = "2015", names: tuple[str, str] = YEAR) -> Path:
    place = root / year
    write_photographs([place / "images" / name for name in names], place / "sfm", names)
    return root


REEF = ("MTN_1.png", "MTN_2.png")


def write_reef(place: Path, images: str = "images_wb", sparse: str = "sparse/0", units: float = 1.0) -> Path:
    write_photographs([place / images / name for name in REEF], place / sparse, REEF, units)
    to_binary(place / sparse)
    return place


WIDTH, HEIGHT = 60, 40


def picture16(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 65536, (HEIGHT, WIDTH, 3), dtype=np.uint16)


def write_set(place: Path, stems: tuple[str, ...] = ("T_S01", "T_S02"), folder: str = "depth") -> Path:
    """Images, and depth maps at half their size: 2 m, and 3 m + 1 m a row in the right half."""
    for seed, stem in enumerate(stems):
        write_image(place / "linearPNG" / f"{stem}.png", picture16(seed))
        depth = np.full((HEIGHT // 2, WIDTH // 2), 2, np.float32)
        depth[:, WIDTH // 4 :] = 3 + np.arange(HEIGHT // 2)[:, None]
        depth[0, 0] = 0
        (place / folder).mkdir(exist_ok=True)
        tifffile.imwrite(place / folder / f"depth{stem}.tif", depth)
    return place


SCALE = 2.5  # metres in a unit of the chunk
TURN = pose_of((0, 0, 0), (0.4, -1.1, 0.7))[:3, :3]
TRANSFORM = (
    f"<transform><rotation>{' '.join(map(repr, TURN.ravel().tolist()))}</rotation>"
    f"<translation>4.1e6 -3.2e6 2.9e6</translation><scale>{SCALE}</scale></transform>"
)
INNER = {"f": 150.0, "cx": 4.0, "cy": -2.5}
LENSES: dict[str, dict[str, float]] = {
    "pinhole": {},
    "usual": {"k1": -0.5, "k2": 0.05, "k3": -0.01, "p1": 0.012, "p2": -0.004, "b1": 6.0},
    "every term": {"k1": -0.5, "k4": 12.0, "p1": 0.02, "p2": 0.03, "p3": 3.0, "p4": 20.0, "b1": 5.0, "b2": 9.0},
    "fisheye": {"k1": 0.02, "k2": -0.03, "k4": 0.002},
    "fisheye with every term": {"k1": 0.02, "k3": 0.01, "p1": 0.008, "p2": -0.006, "b2": -4.0},
}


def photographed(point: np.ndarray, lens: str) -> np.ndarray:
    """Where the sensor images a point of the camera's frame (manual, appendix "Camera models"): centres at +0.5."""
    c = {**dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4", "b1", "b2"), 0.0), **INNER, **LENSES[lens]}
    x, y = point[:2] / point[2]
    if "fisheye" in lens:
        r = np.hypot(x, y)
        x, y = x * np.arctan(r) / r, y * np.arctan(r) / r
    r2 = x * x + y * y
    radial = 1 + c["k1"] * r2 + c["k2"] * r2**2 + c["k3"] * r2**3 + c["k4"] * r2**4
    more = 1 + c["p3"] * r2 + c["p4"] * r2**2
    xd = x * radial + (c["p1"] * (r2 + 2 * x * x) + 2 * c["p2"] * x * y) * more
    yd = y * radial + (c["p2"] * (r2 + 2 * y * y) + 2 * c["p1"] * x * y) * more
    u = spots.WIDTH / 2 + c["cx"] + xd * c["f"] + xd * c["b1"] + yd * c["b2"]
    return np.array([u, spots.HEIGHT / 2 + c["cy"] + yd * c["f"]])


def undistorted(point: np.ndarray, lens: str) -> np.ndarray:
    """Where the sensor would image it without distortion."""
    x, y = point[:2] / point[2]
    f, b1 = INNER["f"], LENSES[lens].get("b1", 0.0)
    return np.array([(f + b1) * x + spots.WIDTH / 2 + INNER["cx"], f * y + spots.HEIGHT / 2 + INNER["cy"]])


def chunk_xml(lens: str, cameras: str, transform: str = TRANSFORM, frames: str = "", sensors: str = "") -> str:
    terms = "".join(f"<{name}>{value!r}</{name}>" for name, value in {**INNER, **LENSES[lens]}.items())
    kind = "fisheye" if "fisheye" in lens else "frame"
    size = f'<resolution width="{spots.WIDTH}" height="{spots.HEIGHT}"/>'
    return (
        f'<chunk label="Dive 1" enabled="true"><sensors next_id="2"><sensor id="0" label="GoPro" type="{kind}">{size}'
        f'<calibration type="{kind}" class="initial">{size}<f>99</f></calibration>'
        f'<calibration type="{kind}" class="adjusted">{size}{terms}</calibration></sensor>{sensors}</sensors>'
        f'<components active_id="0"><component id="0" label="Component 1">{transform}</component></components>'
        f"<cameras>{cameras}</cameras>{frames}</chunk>"
    )


def camera_xml(number: int, label: str, more: str = "", posed: bool = True) -> str:
    pose = " ".join(map(repr, pose_of(*BOTH[number]).ravel().tolist()))
    inside = f"<transform>{pose}</transform>" if posed else ""
    return f'<camera id="{number}" sensor_id="0" component_id="0" label="{label}" {more}>{inside}</camera>'


CAMERAS = camera_xml(0, "DSC_0.JPG") + camera_xml(1, "DSC_1")
OTHERS = (
    '<camera id="7" sensor_id="0" label="not aligned"/><camera id="8"><property name="no camera"/></camera>'
    + camera_xml(1, "switched off", 'enabled="false"').replace('id="1"', 'id="9"')
)


def write_survey(root: Path, lens: str = "usual", unit: float = SCALE, cameras: str = CAMERAS + OTHERS) -> Path:
    """Photographs of the point and Metashape's own depth maps; unit: of theirs, in the chunk's."""
    for number in range(2):
        point = seen(pose_of(*BOTH[number]))
        write_spot(root / f"images/DSC_{number}.png", photographed(point, lens))
        (root / "depths").mkdir(exist_ok=True)
        depth = disk_depth(undistorted(point, lens) / 2, unit * point[2], (spots.WIDTH // 2, spots.HEIGHT // 2))
        tifffile.imwrite(root / f"depths/DSC_{number}.tif", depth)
    (root / "cameras.xml").write_text(f'<document version="2.0.0">{chunk_xml(lens, cameras)}</document>')
    return root
