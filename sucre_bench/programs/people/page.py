"""The page of a people's study: one file that opens from disk, needs no network and names no method."""

import base64
import io
import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from sucre_bench.arrays import Mask
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import decode
from sucre_bench.machine import progress
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.text_formats import filled_in, policy_hash, source
from sucre_bench.programs.people.design import Key, page_order, picture_path

QUESTION = "Which picture shows the scene better?"
_QUALITY = 95  # of JPEG, without loss of colour resolution: about 0.3 MB a picture of 1200 pixels


def write_page(
    path: Path,
    folder: Path,
    key: Key,
    question: str,
    pairs: int,
    width: int,
    masks: Mapping[tuple[str, str], Mask] = MappingProxyType({}),
) -> None:
    """Write the page. pairs: of a sitting; width: most pixels of a picture's width.

    masks: by scene and view, the pixels (H, W) that are shown, of all methods alike; the others are black.
    Raises InputError if the pictures of a view differ in size, OutputError if the page cannot be written.
    """
    from markupsafe import Markup

    style, script = (source(__package__, f"page.{kind}") for kind in ("css", "js"))
    page = filled_in(
        __package__,
        "page.html.j2",
        question=question,
        style=Markup(style),
        script=Markup(script),
        style_hash=policy_hash(style),
        script_hash=policy_hash(script),
        content=Markup(json.dumps(page_order(key, pairs))),
        pictures=_pictures(folder, key, width, masks),
    )
    write_atomically(path, page)


def _pictures(folder: Path, key: Key, width: int, masks: Mapping[tuple[str, str], Mask]) -> list[tuple[str, str]]:
    """The pictures by their names in the page, in the order of these names, as JPEG in base64."""
    import cv2
    from PIL import Image

    sizes: dict[tuple[str, str], tuple[int, ...]] = {}
    made = []
    for name, shown in progress.track(sorted(key.pictures.items()), "pictures"):
        path = picture_path(folder, key, shown)
        image = decode(path, cv2.IMREAD_COLOR)[..., ::-1]
        if sizes.setdefault((shown.scene, shown.view), image.shape) != image.shape:
            raise InputError(f"{path}: is not of the size of the other methods' pictures; run this method again")
        if (mask := masks.get((shown.scene, shown.view))) is not None:
            image = np.where(mask[..., None], image, np.uint8(0))
        picture, jpeg = Image.fromarray(np.ascontiguousarray(image)), io.BytesIO()
        picture.thumbnail((width, 10 * width), Image.Resampling.LANCZOS)
        picture.save(jpeg, "JPEG", quality=_QUALITY, subsampling=0)
        made.append((name, base64.b64encode(jpeg.getvalue()).decode()))
    return made
