"""New views of a scene that a rendering method learned: its pictures with water, of views that it did not learn from.

renders/rendering.json, beside the pictures or above them, is what the pictures say of themselves:

    {"held_out": 8, "encoding": "gamma", "white_balance": "none"}

- held_out: names of the views that training did not see; or N, for every Nth view by name, from the first.
- encoding: of the pictures: "gamma" (sRGB) or "linear".
- white_balance: "none" where training saw the data set's own photographs. Other colours are compared with nothing here.
"""

import difflib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from sucre_bench import InputError
from sucre_bench.arrays import Array
from sucre_bench.imaging.references import psnr_of
from sucre_bench.machine.files import regular
from sucre_bench.scene import Encoding

_NAME = "rendering.json"
_EXAMPLE = '{"held_out": ["a.png"], "encoding": "gamma", "white_balance": "none"}'


def read_rendering(folder: Path) -> tuple[Path, list[str] | int, Encoding]:
    """Return the file that says how pictures were rendered, which views were held out, and the pictures' encoding.

    Raises InputError where there is no such file, it says too little, or the white balance is another.
    """
    path = next((place / _NAME for place in (folder, folder.parent) if (place / _NAME).is_file()), folder / _NAME)
    try:
        told: dict[str, Any] = json.loads(regular(path).read_text(encoding="utf-8"))
        held_out, encoding, balance = told["held_out"], told["encoding"], told["white_balance"]
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as fault:
        lack = f"does not say {fault}" if isinstance(fault, KeyError) else "is no file that can be read"
        remedy = f"write there how the pictures were rendered, such as {_EXAMPLE}"
        raise InputError(f"{lack}, so new views cannot be scored", path, remedy) from fault
    is_list = isinstance(held_out, list) and held_out and all(isinstance(name, str) for name in held_out)
    if not is_list and not (type(held_out) is int and held_out > 1):
        raise InputError(f"held_out is {held_out!r}", path, "give names of views, or N above 1 for every Nth view")
    if encoding not in get_args(Encoding):
        raise InputError(f"encoding is {encoding!r}", path, "give gamma or linear")
    if balance != "none":
        remedy = 'train on the photographs as the data set has them and write "none", or give those that it saw'
        raise InputError(f"white_balance is {balance!r}, the photographs have their own", path, remedy)
    return path, held_out, encoding


def held_out_views(path: Path, held_out: list[str] | int, names: Sequence[str]) -> list[str]:
    """Return which of all views of a scene were held out. InputError where one is no view of it."""
    if isinstance(held_out, int):
        return sorted(names)[::held_out]
    for name in held_out:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1, cutoff=0)
            raise InputError(f"holds out '{name}', which is no view of the scene", path, f"the nearest is {near[0]}")
    return held_out


def similarity(picture: Array, photograph: Array) -> dict[str, float]:
    """Return PSNR (dB) and SSIM (Wang et al. 2004) of two images (H, W, 3) of one encoding, over all pixels.

    The picture is clipped to [0, 1]; what is not finite counts as black.
    """
    import numpy as np
    from skimage.metrics import structural_similarity

    picture = np.nan_to_num(picture, nan=0.0).clip(0, 1)
    window = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    ssim = structural_similarity(picture, photograph, channel_axis=-1, data_range=1, **window)
    error = float(np.mean((picture - photograph) ** 2, dtype=np.float64))
    return {"psnr": psnr_of(error), "ssim": float(ssim)}
