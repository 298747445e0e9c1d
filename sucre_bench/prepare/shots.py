"""What the stages after mapping know of a photo: its pinhole camera, its pose, and the sparse points it sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sucre_bench.multiview.geometry import project
from sucre_bench.prepare.colmap import load_pycolmap
from sucre_bench.scene import Array, Camera

__all__ = ["Shot", "neighbours", "read_shots"]

_TELLING_ANGLE = np.deg2rad(
    5.0
)  # from here on a point's depth is well determined, and more angle only changes its look
_WIDEST_ANGLE = np.deg2rad(45.0)


@dataclass(frozen=True, eq=False, slots=True)
class Shot:
    """A registered photo.

    name: of the undistorted image; camera: pinhole, at the image's size; cam_from_world: (4, 4) float64;
    point_ids: (P,) of the sparse points seen, sorted; points: (P, 3) float64 in the world; xy: (P, 2) float64 pixels
    where they were found; tracks: (P,) in how many photos each was found. Lengths are in the model's unit.
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
        """Where the points project to (P, 2), and their planar depth (P,)."""
        in_camera = self.points @ self.cam_from_world[:3, :3].T + self.cam_from_world[:3, 3]
        return project(self.camera, in_camera)


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
    """Return, for each photo, the indices of those that tell its depths best, the best first.

    A common point counts by the angle it is seen under, up to 5 degrees in full, beyond 45 not at all.
    """
    return [
        [
            j
            for _, j in sorted(((-_common(shot, other), j) for j, other in enumerate(shots) if other is not shot))[
                :most
            ]
            if _common(shot, shots[j]) > 0
        ]
        for shot in shots
    ]


def _common(one: Shot, other: Shot) -> float:
    _, own, _ = np.intersect1d(one.point_ids, other.point_ids, assume_unique=False, return_indices=True)
    if not len(own):
        return 0.0
    rays = [shot.centre - one.points[own] for shot in (one, other)]
    lengths = [np.linalg.norm(ray, axis=1) for ray in rays]
    angles = np.arccos(np.clip((rays[0] * rays[1]).sum(axis=1) / (lengths[0] * lengths[1]), -1, 1))
    weight = np.minimum(angles / _TELLING_ANGLE, 1) * (angles < _WIDEST_ANGLE)
    # A photo from half or twice as far shows the same ground with other detail.
    nearness = np.exp(-(np.log(lengths[0] / lengths[1]) ** 2) / (2 * np.log(2) ** 2))
    return float((weight * nearness).sum())
