"""Water that is known already: from a file, an earlier run, another method, or the truth of a made scene."""

from __future__ import annotations

import json
from pathlib import Path, PurePosixPath
from typing import Literal
from zipfile import BadZipFile

import numpy as np

from sucre_bench import plugins
from sucre_bench.errors import InputError
from sucre_bench.layout import file_name
from sucre_bench.options import create
from sucre_bench.scene import Array, Scene, View

__all__ = ["water_by", "water_of"]

# What is still taken for water; Adam, which knows no bounds, may end a little below zero.
_MOST_B, _MOST_RATE = 2.0, 100.0

_NAMES = ("B", "beta", "gamma")


def water_of(source: str, scene: Scene, view: View, encoding: Literal["view", "linear"]) -> Array:
    """Return B, beta, gamma (rows) of RGB (columns), (3, 3) float64.

    source: "truth"; a .json or .npz file that holds B, beta and gamma, three numbers each; or a folder with such a
    file for each view, as a run leaves them in restored/<dataset>/<method>; encoding: of the intensities that the
    water is to explain. Raises InputError, naming the file.
    """
    if source == "truth":
        if scene.water is None:
            raise InputError(
                f"water=truth: the scene '{scene.name}' does not know its water; give a file, or water=own"
            )
        if encoding == "linear" and view.encoding == "gamma":
            raise InputError("water=truth: the true water is of intensities as stored; leave out encoding=linear")
        water = scene.water
        return np.array([water.veiling_light, water.attenuation, water.backscatter], dtype=np.float64)
    path = Path(source).expanduser()
    if path.is_dir():
        path = _of_view(path, scene, view)
    try:
        if path.suffix == ".npz":
            with path.open("rb") as file, np.load(file, allow_pickle=False) as values:
                water_values = np.array([values[name] for name in _NAMES], dtype=np.float64)
        else:
            content = json.loads(path.read_text(encoding="utf-8"))
            water_values = np.array([content[name] for name in _NAMES], dtype=np.float64)
            if content.get("encoding", encoding) != encoding:
                fault = f"is the water of intensities with encoding={content['encoding']}"
                raise InputError(f"{path}: {fault}; give method.encoding={content['encoding']}")
    except FileNotFoundError:
        raise InputError(
            f"{path}: no such file; water= takes own, shared, truth, a .json or .npz file, or a folder of them"
        ) from None
    except (OSError, ValueError, KeyError, TypeError, IndexError, EOFError, BadZipFile) as fault:
        raise InputError(f"{path}: does not hold B, beta and gamma ({fault}); give three numbers of each") from fault
    return _checked(str(path), water_values)


def water_by(name: str, scene: Scene, view: View, encoding: Literal["view", "linear"]) -> Array:
    """Return B, beta, gamma (rows) of RGB (columns), (3, 3) float64, as another method estimates them on this view.

    Raises InputError where the method lacks something, estimates no such water, or that of another encoding; and what
    the method itself raises.
    """
    plugin = plugins.find("method", name)
    if absent := plugins.missing_needs(plugin, scene.has):
        raise InputError(f"water_from={name}: {absent}; name another method")
    found = create(plugin, {}).restore(scene, view)
    if found.water is None:
        raise InputError(f"water_from={name}: it estimates no water; name one that does, such as gaussian_seathru")
    if (own := found.info.get("encoding", "view")) != encoding:
        raise InputError(f"water_from={name}: its water is of intensities with encoding={own}; give that encoding")
    parameters = [found.water.veiling_light, found.water.attenuation, found.water.backscatter]
    return _checked(f"{view.name}: water_from={name}", np.array(parameters, dtype=np.float64))


def _checked(place: str, water_values: Array) -> Array:
    """A water that can be one. InputError naming where it is from."""
    if water_values.shape != (3, 3) or not np.isfinite(water_values).all():
        raise InputError(f"{place}: B, beta and gamma must be three finite numbers each, red, green and blue")
    if np.abs(water_values[0]).max() > _MOST_B or np.abs(water_values[1:]).max() > _MOST_RATE:
        limits = f"B is an intensity, at most {_MOST_B:g}, beta and gamma are rates in 1/m, at most {_MOST_RATE:g}"
        raise InputError(f"{place}: no water is like this; {limits}")
    return water_values


def _of_view(folder: Path, scene: Scene, view: View) -> Path:
    """The file of a view in a folder that a run made: restored/<dataset>/<method>[/<scene>]/<view's name>.json."""
    name = PurePosixPath(view.name)
    for within in (PurePosixPath(file_name(scene.name)), PurePosixPath()):
        for stem in (name.with_suffix(""), name):
            for suffix in (".json", ".npz"):
                found = folder / within / f"{stem}{suffix}"
                if found.is_file() and found.resolve().is_relative_to(folder.resolve()):
                    return found
    return folder / f"{name.with_suffix('')}.json"
