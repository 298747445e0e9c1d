"""AQUALOC: a robot close to the seabed, in a harbour and at two archaeological sites, with poses; in shades of gray.

    Harbor_sites_sequences/.../raw_data/harbor_images_sequence_07/frame000123.png
                           harbor_calibration_files/harbor_camera_calib.yaml
                           harbor_groundtruth_files/new_harbor_colmap_traj_sequence_07.txt
    Archaeological_site_sequences/ likewise: images_sequence_7/, archaeo_camera_calib.yaml, new_archaeo_colmap_traj_...

Conventions. A line of a trajectory is frame, tx ty tz, qx qy qz qw. These are the camera's centre in the world and the
rotation that takes its axes there. Metres in the files new_..., which corrected the scale, and so are preferred.
Calibrations are Kalibr's, fisheye ("equidistant"); images are undistorted on the way. Frames that were not registered
have no pose.
Source: Ferrera et al., AQUALOC: an underwater dataset for visual-inertial-pressure localization, IJRR 2019.
"""

import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sucre_bench import InputError, dataset
from sucre_bench.arrays import Array
from sucre_bench.camera import pose_of
from sucre_bench.imaging.image_files import PICTURE_READERS, first_size
from sucre_bench.loading.find_folders import existing, folders_below, only, walk
from sucre_bench.loading.image_folder import image_names
from sucre_bench.loading.lens import read_kalibr
from sucre_bench.loading.view_files import ImageScaleOption, Photograph, scene_of
from sucre_bench.machine.files import reading, regular
from sucre_bench.scene import Scene

_SEQUENCE = re.compile(r"(harbor_|archaeo_)?images_sequence_0*(\d+)")
_SIZES = {"harbor": (640, 512), "archaeo": (968, 608)}


@dataset(
    requires=(*PICTURE_READERS, "yaml", "scipy"),
    has=("poses",),
    cites="Ferrera, Creuze, Moras & Trouvé-Peloux 2019, IJRR (AQUALOC)",
    licence="as its download page says",
    source="https://www.lirmm.fr/aqualoc (17 sequences; harbour 7 has 0.36 GB, archaeological 2 has 2.2 GB)",
    proven="has read no released file yet: written from the authors' descriptions, tried on miniatures of them",
    signs=("*images_sequence_*", "*/*images_sequence_*", "*/*/*images_sequence_*"),
)
@dataclass(frozen=True)
class Aqualoc(ImageScaleOption):
    """The AQUALOC sequences: one scene for each, gray views in order of frame, undistorted on the way."""

    root: Path
    """The download with its calibration and ground truth files, or a part of it that holds these and sequences."""

    def scenes(self) -> Iterator[Scene]:
        """Yield a scene for each sequence below root, "harbor_07". Decodes nothing, reads texts, headers and samples.

        A sequence without a trajectory has no poses. Raises InputError when there is no sequence, one is there twice,
        or its calibration or trajectory is missing or wrong.
        """
        root, texts, found = existing(self.root), dict[str, Path](), dict[str, Path]()
        for place, below, names in walk(root):  # folders of frames are not looked into
            below[:] = [name for name in below if not _SEQUENCE.fullmatch(name)]
            texts.update(
                {
                    name.lower(): place / name
                    for name in names
                    if name.lower().endswith((".txt", ".yaml"))
                }
            )
        lack = "holds no folder of frames; expected folders named like harbor_images_sequence_07 or images_sequence_7"
        for folder in folders_below(
            root, lambda place, _: _SEQUENCE.fullmatch(place.name) is not None, lack
        ):
            match = _SEQUENCE.fullmatch(folder.name)
            assert match is not None
            site = "harbor" if match[1] == "harbor_" else "archaeo"
            number = int(match[2])
            name = f"{site}_{number:02d}"
            if name in found:
                raise InputError(
                    f"{folder}: sequence {name} is also {found[name]}; keep one of them"
                )
            found[name] = folder
            frames = _frames(folder)
            calibration = texts.get(f"{site}_camera_calib.yaml")
            if calibration is None:
                expected = f"{site}_calibration_files/{site}_camera_calib.yaml"
                raise InputError(
                    f"{folder}: no {site}_camera_calib.yaml is below dataset.root; copy {expected} there"
                )
            lens = read_kalibr(
                calibration,
                first_size(frames[frame][0] for frame in sorted(frames)) or _SIZES[site],
            )
            endings = [
                f"{site}_colmap_traj_sequence_{digits}.txt"
                for digits in (f"{number:02d}", str(number))
            ]
            trajectory = next(
                (texts[x + end] for x in ("new_", "") for end in endings if x + end in texts),
                None,
            )
            poses = _poses(trajectory) if trajectory else {}

            if poses and not set(poses) & set(frames):
                here = f"{folder}, {min(frames)} to {max(frames)}"
                fault = f"its frames, {min(poses)} to {max(poses)}, are none of {here}"
                raise InputError(f"{trajectory}: {fault}; use the sequence's own file")
            photographs = [
                Photograph(
                    files[0].name,
                    files[0],
                    lens,
                    poses.get(frame),
                    fault=str(only(files)) if files[1:] else "",
                )
                for frame, files in sorted(frames.items())
            ]
            yield scene_of(name, photographs, self.image_scale)


def _frames(folder: Path) -> dict[int, list[Path]]:
    """The images of a sequence by their number. Raises InputError if there are none."""
    frames: dict[int, list[Path]] = defaultdict(list)
    for file in image_names(folder):
        digits = re.findall(r"\d+", file)
        if digits:
            frames[int(digits[-1])].append(folder / file)
    if not frames:
        raise InputError(
            f"{folder}: holds no image named like frame000001.png; unpack the sequence there"
        )
    return frames


def _poses(path: Path) -> dict[int, Array]:
    """Return cam_from_world (4, 4) by frame."""
    from scipy.spatial.transform import Rotation

    poses = {}
    with reading(path, "copy the file again, of lines frame tx ty tz qx qy qz qw"):
        lines = regular(path).read_text(encoding="utf-8").splitlines()
        for number, line in enumerate(lines, 1):
            cells = line.replace(",", " ").split()
            if (
                not cells
                or cells[0].startswith("#")
                or (number == 1 and not cells[0][0].isdigit())
            ):
                # a header
                continue
            try:
                frame, *values = (float(cell) for cell in cells)
            except ValueError:
                values = []
            is_whole = len(values) == 7 and np.isfinite(values).all()
            if not is_whole or abs(np.linalg.norm(values[3:]) - 1) > 1e-2:
                raise ValueError(f"line {number} is no pose")
            rotation = Rotation.from_quat(values[3:]).as_matrix()
            poses[round(frame)] = np.linalg.inv(pose_of(rotation, np.array(values[:3])))
        if not poses:
            raise ValueError("it holds no pose")
    return poses
