"""Identifies data: fingerprints of files, and the data_id of views."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from sucre_bench.errors import InputError
from sucre_bench.imaging.chart_kinds import kind_id
from sucre_bench.loading.view_files import Files
from sucre_bench.machine.files import regular
from sucre_bench.machine.progress import track
from sucre_bench.scene import View

_WHOLE = 1 << 20  # bytes; larger files are hashed in blocks


_BLOCKS, _BLOCK = 16, 4096


def data_id_of(views: Sequence[View], *more: object) -> str:
    """Return a hash of cameras, poses, charts, options and files of views, and of `more`.

    Files are hashed by `fingerprint`, with its limits.
    """
    digest = hashlib.blake2b(repr(more).encode() if more else b"", digest_size=6)
    for view in track(views, "hashing"):
        assert isinstance(view.pixels, Files)
        charts = [(chart.name, kind_id(chart.kind), chart.corners.tolist()) for chart in view.charts]
        K = None if view.camera is None else view.camera.K.tolist()
        pose = None if view.cam_from_world is None else view.cam_from_world.tolist()
        lenses: list[object] = [] if view.pixels.lens is None else [view.pixels.lens.identity]
        lenses += [] if view.pixels.depth_lens is None else [("depth", view.pixels.depth_lens.identity)]
        digest.update(repr((view.name, view.encoding, (K, view.pixels.size, pose, *lenses), charts)).encode())
        for path in (view.pixels.image, view.pixels.depth, view.pixels.reference):
            digest.update(b"none" if path is None else fingerprint(path))
    return digest.hexdigest()


def fingerprint(path: Path) -> bytes:
    """Return a hash of a file's size and content; its date does not count.

    Files up to 1 MiB are hashed whole. Larger files are hashed in 16 blocks of 4 KiB at equal distances, first and last
    included: whole files would be 90 GB of a large dataset at every start. A change between the blocks that keeps the
    size goes unnoticed. PNG and JPEG files count by their first and last block: both are compressed, and PNG ends on a
    checksum, so a change shows in the size or at the end.
    """
    try:
        with regular(path).open("rb") as file:
            size = file.seek(0, 2)
            compressed = path.suffix.lower() in (".png", ".jpg", ".jpeg")
            blocks = 2 if compressed else _BLOCKS
            if size <= (blocks * _BLOCK if compressed else _WHOLE):
                file.seek(0)
                return hashlib.blake2b(b"%d" % size + file.read()).digest()
            digest = hashlib.blake2b(b"%d" % size)
            for i in range(blocks):
                file.seek((size - _BLOCK) * i // (blocks - 1))
                digest.update(file.read(_BLOCK))
            return digest.digest()
    except (OSError, InputError):
        return b"unreadable"
