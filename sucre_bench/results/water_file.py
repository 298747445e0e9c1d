"""Water in files: a .json, such as the record of a restoration, or an .npz, with B, beta and gamma.

    {"B": [r, g, b], "beta": [r, g, b], "gamma": [r, g, b], "encoding": "gamma"}

beta and gamma may be left out, or null, where they are not known. "encoding" is that of the intensities that the water
explains; left out, or "view", it is that of the images the water is used with. A run may also write how the water was
lit, "gains" of views by name and "light". What else such a file holds is ignored.
"""

import json
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.errors import InputError, is_number_in
from sucre_bench.imaging.image_files import read_array
from sucre_bench.machine.files import reading, regular
from sucre_bench.machine.records import record_of
from sucre_bench.scene import Encoding, Water


@dataclass(frozen=True)
class Lighting:
    """How the observations were lit that a water was fitted to."""

    gains: Mapping[str, Any] = field(default_factory=dict)
    """Of each view by name, a number or one for each channel, in the water's units; empty for one exposure."""

    falls_off: bool = False
    """Whether the light differed across the images."""


_ENCODINGS: dict[Any, Encoding | None] = {
    None: None,
    "view": None,
    "gamma": "gamma",
    "linear": "linear",
}


def read_water(path: Path) -> Water | None:
    """Return the water of a file, NaN for what it does not tell; None for a file that holds no B.

    Raises MissingFileError, and InputError for what cannot be read or is no water.
    """
    with reading(path, _REMEDY):
        if path.suffix != ".npz":
            return water_of(
                json.loads(regular(path, _REMEDY).read_text(encoding="utf-8")), path
            )
        with zipfile.ZipFile(regular(path, _REMEDY)) as archive:
            names = {name.removesuffix(".npy") for name in archive.namelist()}
        known = names & {*_NAMES, "encoding"}
        return water_of({name: read_array(path, _chooser(name)) for name in known}, path)


def read_lighting(path: Path) -> Lighting:
    """Return how the water of a .json or .npz file was lit, from its record (see `record_of`). Raises InputError."""
    return lighting_of(record_of(path), str(path.with_suffix(".json")))


def lighting_of(record: Any, place: str, view: str = "") -> Lighting:
    """Return how a water was lit, from the record of its fit.

    place: where the record is, to be named; view: one that the fit was of, if that is known. "gains" that are no gains
    of views by name, or have none of that view, are something else: they are ignored.
    """
    if not isinstance(record, Mapping):
        return Lighting()
    gains, light = record.get("gains"), record.get("light")
    if not isinstance(gains, Mapping) or (view and view not in gains):
        gains = {}
    for gain in gains.values():
        each = gain if isinstance(gain, list) and len(gain) == 3 else [gain]
        if not all(is_number_in("(0, inf)", one) for one in each):
            raise InputError(
                f"{place}: gains must be one or three positive numbers for each view; run its method again"
            )
    parts = light.get("parts", ()) if isinstance(light, Mapping) else ()
    return Lighting(dict(gains), bool({"lens", "strobe"} & set(parts)))


_NAMES = ("B", "beta", "gamma")
_REMEDY = "write B, beta and gamma, three numbers of each"


def _chooser(name: str) -> Callable[[list[str]], str]:
    return lambda _: name


def water_of(content: Any, path: Path) -> Water | None:
    """Return the water of what a file holds, as `read_water` does; path: of that file, to be named."""
    if not isinstance(content, Mapping) or content.get("B") is None:
        return None
    encoding = content.get("encoding")
    encoding = str(encoding) if isinstance(encoding, np.ndarray) else encoding
    if not isinstance(encoding, (str, type(None))) or encoding not in _ENCODINGS:
        raise InputError(f"{path}: encoding '{encoding}' is unknown; use gamma, linear or view")
    triples = []
    for name in _NAMES:
        values = content.get(name)
        triple = np.full(3, np.nan) if values is None else np.array(values, dtype=np.float64)
        if triple.shape != (3,):
            raise InputError(f"{name} is not three numbers, red, green and blue", path, _REMEDY)
        triples.append(triple)
    B, beta, gamma = triples
    return Water(B, beta, gamma, _ENCODINGS[encoding])
