"""A registered photo for the stages after mapping: its pinhole camera, pose, and the sparse points it sees.

pycolmap is imported here and nowhere else.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Indices
from sucre_bench.camera import Camera, moved, project
from sucre_bench.errors import InputError

_TELLING_ANGLE = np.deg2rad(5.0)  # degrees: depth is well determined; more only changes the appearance
_WIDEST_ANGLE = np.deg2rad(45.0)


@dataclass(frozen=True, eq=False, slots=True)
class Shot:
    """A registered photo.

    name: of the undistorted image; camera: pinhole, at the image's size; cam_from_world: (4, 4) float64;
    point_ids: (P,) of the sparse points seen, sorted; points: (P, 3) float64 in the world; xy: (P, 2) float64, their
    features' pixels; tracks: (P,) number of photos that see each. Lengths are in the model's unit.
    """

    name: str
    camera: Camera
    cam_from_world: Array
    point_ids: npt.NDArray[np.int64]
    points: Array
    xy: Array
    tracks: npt.NDArray[np.int64]

    @property
    def centre(self) -> Array:
        """(3,) the camera's centre in the world."""
        return np.asarray(-self.cam_from_world[:3, :3].T @ self.cam_from_world[:3, 3])

    def seen_points(self) -> tuple[Array, Array]:
        """The points' projections (P, 2) and planar depths (P,)."""
        return project(self.camera, moved(self.points, self.cam_from_world))


def load_pycolmap() -> ModuleType:
    """Return pycolmap with its log switched off. Raises InputError if it is too old."""
    # pycolmap's wheel has its own zlib, png and jpeg. If it were the first to load them, writing a PNG later
    # would abort the process.
    import zlib  # noqa: F401

    import cv2  # noqa: F401
    import pycolmap

    if not hasattr(pycolmap.Database, "num_verified_image_pairs") or not hasattr(pycolmap, "FeatureExtractionOptions"):
        fault = f"is {pycolmap.__version__}, too old to prepare photos"
        raise InputError(f"pycolmap: {fault}; run pip install 'pycolmap>=4.0'")
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    return pycolmap


def read_shots(model: Path) -> list[Shot]:
    """Return the photos of an undistorted COLMAP model, ordered by name."""
    pycolmap = load_pycolmap()
    model_ = pycolmap.Reconstruction(model)
    places = {number: (point.xyz, point.track.length()) for number, point in model_.points3D.items()}
    shots = []
    for number in model_.reg_image_ids():
        image = model_.image(number)
        camera = model_.camera(image.camera_id)
        seen = sorted((p.point3D_id, tuple(p.xy)) for p in image.get_observation_points2D())
        pose = np.eye(4)
        pose[:3] = image.cam_from_world().matrix()
        shots.append(
            Shot(
                image.name,
                Camera(np.array(camera.calibration_matrix()), camera.width, camera.height),
                pose,
                np.array([i for i, _ in seen], dtype=np.int64),
                np.array([places[i][0] for i, _ in seen], dtype=np.float64).reshape(-1, 3),
                np.array([xy for _, xy in seen], dtype=np.float64).reshape(-1, 2),
                np.array([places[i][1] for i, _ in seen], dtype=np.int64),
            )
        )
    return sorted(shots, key=lambda shot: shot.name)


def neighbours(shots: Sequence[Shot], most: int) -> list[list[int]]:
    """Return, for each photo, the indices of the photos that determine its depths best, the best first.

    A common point counts by the angle it is seen under, up to 5 degrees in full, beyond 45 not at all.
    """
    from scipy.sparse import csc_array

    if not shots:
        return []
    firsts = [np.unique(shot.point_ids, return_index=True)[1] for shot in shots]
    seen = np.concatenate([shot.point_ids[first] for shot, first in zip(shots, firsts, strict=True)])
    by = np.repeat(np.arange(len(shots)), [len(first) for first in firsts])
    known, columns = np.unique(seen, return_inverse=True)
    seers = csc_array((np.ones(len(by)), (by, columns)), shape=(len(shots), len(known)))  # a column a point
    centres = np.array([shot.centre for shot in shots])
    best = []
    for i, (shot, first) in enumerate(zip(shots, firsts, strict=True)):
        of_points = seers[:, columns[by == i]]
        points = np.repeat(shot.points[first], np.diff(of_points.indptr), axis=0)
        best.append(_best(i, points, of_points.indices, centres)[:most])
    return best


def _best(one: int, points: Array, others: Indices, centres: Array) -> list[int]:
    """The photos that determine this one's depths, the best first. points (R, 3), others (R,): who sees which point."""
    rays = [centres[one] - points, centres[others] - points]
    lengths = [np.maximum(np.linalg.norm(ray, axis=1), 1e-12) for ray in rays]
    angles = np.arccos(np.clip((rays[0] * rays[1]).sum(axis=1) / (lengths[0] * lengths[1]), -1, 1))
    weight = np.minimum(angles / _TELLING_ANGLE, 1) * (angles < _WIDEST_ANGLE) * (others != one)
    # A photo from half or twice the distance shows the same ground with other detail.
    nearness = np.exp(-(np.log(lengths[0] / lengths[1]) ** 2) / (2 * np.log(2) ** 2))
    score = np.bincount(others, weight * nearness, minlength=len(centres))
    best = np.argsort(-score, kind="stable")
    return best[score[best] > 0].tolist()
