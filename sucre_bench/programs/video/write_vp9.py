"""Writes a video: VP9 in .mp4 or .webm, by OpenCV.

Browsers play H.264, VP8, VP9 and AV1. OpenCV's wheels write VP9, but neither H.264 nor AV1. Their other format, MPEG-4
part 2 ("mp4v"), does not play in browsers. Chromium plays VP9 from .mp4 and from .webm.
"""

import contextlib
import itertools
import os
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import Picture
from sucre_bench.errors import OutputError
from sucre_bench.machine.files import write_atomically


def write_video(path: Path, pictures: Iterable[Picture], fps: float) -> int:
    """Write pictures (H, W, 3) uint8 RGB, all of one size with even sides, and return their number.

    The file is written atomically. Raises OutputError if it cannot be written, or if this OpenCV has no VP9 encoder.
    """
    with tempfile.TemporaryDirectory(prefix="sucre-bench-") as folder:
        file = Path(folder) / f"video{path.suffix.lower()}"
        pictures = iter(pictures)
        first = next(pictures)
        writer = _writer(file, (first.shape[1], first.shape[0]), fps)
        count = 0
        try:
            if not writer.isOpened():
                raise OutputError(f"{path}: this OpenCV cannot write VP9; install opencv-python-headless from PyPI")
            for picture in itertools.chain([first], pictures):
                writer.write(np.ascontiguousarray(picture[..., ::-1]))
                count += 1
        finally:
            writer.release()
        write_atomically(path, file.read_bytes())
    return count


def _writer(file: Path, size: tuple[int, int], fps: float) -> Any:
    import cv2

    with _quiet():
        return cv2.VideoWriter(str(file), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"vp09"), fps, size)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Hide a harmless message of OpenCV's C code about a tag in .webm."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
