"""Reads a camera that Kalibr calibrated, from its camchain (YAML) or its report (TXT).

    cam0:                                       cam0
      camera_model: pinhole                     -----
      intrinsics: [fx, fy, cx, cy]                Camera model: pinhole
      distortion_model: equidistant               Focal length: [fx, fy]
      distortion_coeffs: [k1, k2, k3, k4]         Principal point: [cx, cy]
      resolution: [width, height]                 Distortion model: radtan
                                                  Distortion coefficients: [k1, k2, p1, p2]

Conventions. "radtan" is Brown's distortion with OpenCV's k1 k2 p1 p2, "equidistant" is OpenCV's fisheye. Kalibr's pixel
centres are at whole numbers: half a pixel is added to its principal point. The report does not state the image's size.
Source: https://github.com/ethz-asl/kalibr/wiki/yaml-formats
"""

import re
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sucre_bench.camera import Camera
from sucre_bench.errors import InputError
from sucre_bench.loading.lens import Lens
from sucre_bench.machine.files import regular
from sucre_bench.machine.text_formats import read_yaml

_MODELS: dict[str, Literal["perspective", "fisheye"]] = {
    "radtan": "perspective",
    "none": "perspective",
    "equidistant": "fisheye",
}
_REPORT = {
    "camera_model": r"Camera model:\s*(\S+)",
    "focal": r"Focal length:\s*\[(.*?)\]",
    "centre": r"Principal point:\s*\[(.*?)\]",
    "distortion_model": r"Distortion model:\s*(\S+)",
    "distortion_coeffs": r"Distortion coefficients:\s*\[(.*?)\]",
}


def read_kalibr(path: Path, size: tuple[int, int]) -> Lens:
    """Return the lens of the first camera in a file.

    size: (width, height) of the images in pixels, for a file without it. Raises InputError if the file cannot be read
    or holds no pinhole camera with one of the distortions above.
    """
    import yaml

    try:
        text = regular(path).read_text(encoding="utf-8")
        stored = _report(text) if path.suffix.lower() == ".txt" else read_yaml(text)
        stored = stored.get("cam0", stored)
        focal_x, focal_y, x, y = (float(value) for value in stored["intrinsics"])
        coefficients = [float(value) for value in stored.get("distortion_coeffs") or ()]
        width, height = (int(side) for side in stored.get("resolution", size))
        kind = (stored.get("camera_model", "pinhole"), stored.get("distortion_model", "none"))
        if kind[0] != "pinhole" or kind[1] not in _MODELS:
            raise ValueError(f"{kind[0]} with {kind[1]} distortion is not known here")
        if not (np.isfinite([x, y, *coefficients]).all() and min(focal_x, focal_y, width, height) > 0):
            raise ValueError(f"focal length {focal_x:g}, {focal_y:g} for {width}x{height}")
    except (OSError, yaml.YAMLError, KeyError, AttributeError, TypeError, ValueError, RecursionError) as fault:
        reason = " ".join(str(fault).split())
        expected = "a camchain, or a report on camera and IMU, as Kalibr writes them"
        raise InputError(f"is no camera ({type(fault).__name__}: {reason})", path, f"expected {expected}") from fault
    while coefficients and coefficients[-1] == 0:
        coefficients.pop()
    K = np.array([[focal_x, 0, x + 0.5], [0, focal_y, y + 0.5], [0, 0, 1]], dtype=np.float64)
    return Lens(Camera(K, width, height), _MODELS[kind[1]], tuple(coefficients))


def _report(text: str) -> dict[str, Any]:
    """Return the report's camera in the camchain's form."""
    found = {name: match[1] for name, pattern in _REPORT.items() if (match := re.search(pattern, text))}
    numbers = {name: found[name].replace(",", " ").split() for name in ("focal", "centre", "distortion_coeffs")}
    return {**found, **numbers, "intrinsics": numbers["focal"] + numbers["centre"]}
