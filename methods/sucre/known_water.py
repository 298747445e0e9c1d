"""Finds a water outside the image: from a file, an earlier run, another method, or the truth.

A water that was fitted with one gain for each view is in the exposure of its own target, where that has gain 1. For
another target with gain g it has g B, and gains divided by g.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.machine.files import expanded
from sucre_bench.machine.provenance import require
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.plugins.call_method import checked_restore
from sucre_bench.plugins.options import create
from sucre_bench.results.layout import stems_of
from sucre_bench.results.water_file import Lighting, lighting_of, read_lighting, read_water
from sucre_bench.scene import Encoding, Scene, View, Water

# Values that are accepted. Adam has no bounds: in air the paper's ended at beta = -0.23 1/m.
_LEAST = -0.5
_MOST_B = 2.0
_MOST_RATE = 100.0

_SUFFIXES = (".json", ".npz")


@dataclass(frozen=True, slots=True)
class SourceOption:
    """An option that names a water."""

    name: str

    words: tuple[str, ...]
    """Words that name no file and no method, the default first."""

    @property
    def typed(self) -> str:
        """The option as its user types it."""
        return f"method.{self.name}"


WATER = SourceOption("water", ("own", "shared", "truth"))
START = SourceOption("start", ("paper", "truth"))


@dataclass(frozen=True, eq=False)
class KnownWater:
    """A water in the exposure of the restored view, and the gains of views by name, if it was fitted with some."""

    water: WaterParameters
    gains: Mapping[str, Array]


def water_of(
    source: str, scene: Scene, view: View, encoding: Encoding, option: SourceOption = WATER
) -> KnownWater:
    """Return the water of a source; option: that names it.

    source: "truth"; the name of a method, which estimates it on this view; a .json or .npz file that holds B, beta and
    gamma, three numbers each; or a folder with such a file for each view, as a run writes them to
    restored/<dataset>/<method>. A folder with the name of a method is given as ./NAME. encoding: of the intensities
    that the water has to explain.
    Raises InputError, naming the source; and what the method itself raises.
    """
    place = f"{option.typed}={source}"
    if source == "truth":
        if scene.water is None:
            raise InputError(
                f"{place}: the scene '{scene.name}' knows no water; give a file, or leave it out"
            )
        return _known(place, scene.water, Lighting(), view, encoding, option)
    if source in plugins.discover("method"):
        plugin = plugins.find("method", source)
        if absent := plugins.missing_needs(plugin, scene.has):
            raise InputError(f"{place}: {absent}; name another method")
        found = checked_restore(create(plugin, {}), scene, view)
        names = {"B": "veiling_light", "beta": "attenuation", "gamma": "backscatter"}
        unknown = [
            name
            for name, long in names.items()
            if np.isnan(getattr(found.water, long, np.nan)).all()
        ]
        if found.water is None or unknown:
            fault = f"it estimates no {', '.join(unknown)}"
            raise InputError(f"{place}: {fault}; name one that does, such as gaussian_seathru")
        return _known(
            place,
            found.water,
            lighting_of(found.info, place, view.name),
            view,
            encoding,
            option,
        )
    path = expanded(source)
    if path.is_dir():
        path = _of_view(path, scene, view)
    try:
        water = _of_file(path)
    except MissingFileError:
        remedy = f"{option.typed} takes {', '.join(option.words)}, a method, a .json or .npz file, or a folder of them"
        raise MissingFileError("no such file", path, remedy) from None
    return _known(str(path), water, read_lighting(path), view, encoding, option)


def check_source(source: str, option: SourceOption = WATER) -> None:
    """Raise InputError for a source, as for `water_of`, that can have no water.

    These are an empty text, a method that is not installed or needs options, a file without a water, and a folder
    without files. A path to nothing passes, unless it is a bare word: `create` refuses it.
    """
    if source in option.words:
        return
    name = option.typed
    if not source:
        raise InputError(
            f"{name}: is empty; use {', '.join(option.words)}, a method, a file or a folder"
        )
    path = expanded(source)
    if source in plugins.discover("method") or (source.isidentifier() and not path.exists()):
        try:
            plugin = plugins.find("method", source)
        except InputError as fault:
            raise InputError(f"{name}={source}: {fault}") from fault
        require(f"{name}={source}", *plugin.requires)
        try:
            create(plugin, {})
        except InputError as fault:
            raise InputError(
                f"{name}={source}: takes options ({fault}); run it first, and give {name}=FOLDER"
            ) from fault
    elif not path.is_dir():
        with contextlib.suppress(MissingFileError):
            _of_file(path)
    elif not any(file.suffix in _SUFFIXES for file in path.rglob("*")):
        remedy = "give the folder restored/<dataset>/<method> of an earlier run"
        raise InputError(f"{path}: holds no .json or .npz; {remedy}")


def _of_file(path: Path) -> Water:
    water = read_water(path)
    if water is None:
        raise InputError(f"{path}: does not hold B, beta and gamma; give three numbers of each")
    return water


def _known(
    place: str,
    water: Water,
    lighting: Lighting,
    view: View,
    encoding: Encoding,
    option: SourceOption,
) -> KnownWater:
    """Return the checked water in the view's exposure.

    InputError when it is no water, belongs to intensities of another encoding, or to light that is not the view's.
    """
    if lighting.falls_off:
        fault = "was fitted together with light that falls off, and explains no other"
        raise InputError(f"{place}: {fault}; use {option.typed}={option.words[0]}")
    values = np.array(
        [water.veiling_light, water.attenuation, water.backscatter], dtype=np.float64
    )
    if values.shape != (3, 3) or not np.isfinite(values).all():
        raise InputError(
            f"{place}: B, beta and gamma must be three finite numbers each, red, green and blue"
        )
    if values.min() < _LEAST or values[0].max() > _MOST_B or values[1:].max() > _MOST_RATE:
        limits = f"B is an intensity of 0 to {_MOST_B:g}, beta and gamma are rates of 0 to {_MOST_RATE:g} 1/m"
        raise InputError(f"{place}: no water is like this; {limits}")
    if (explained := water.encoding or view.encoding) != encoding:
        remedy = f"give one of {encoding} intensities"
        if option is WATER and view.encoding != "linear":
            remedy = (
                f"{'give' if explained == 'linear' else 'leave out'} method.encoding=linear"
            )
        raise InputError(
            f"{place}: is of {explained} intensities, and {encoding} ones are to be explained; {remedy}"
        )
    if not lighting.gains:
        return KnownWater(WaterParameters(*values), {})
    if view.name not in lighting.gains:
        fault = f"was fitted with gains of views, and has none of {view.name}"
        raise InputError(
            f"{place}: {fault}; give a folder with the water of each view, or one fitted in even light"
        )
    gains = {
        name: np.asarray(gain) / np.asarray(lighting.gains[view.name])
        for name, gain in lighting.gains.items()
    }
    return KnownWater(
        WaterParameters(values[0] * np.asarray(lighting.gains[view.name]), *values[1:]), gains
    )


def _of_view(folder: Path, scene: Scene, view: View) -> Path:
    """Return the file of a view in a folder that a run made, restored/<dataset>/<method>."""
    files = [
        folder / f"{stem}{suffix}"
        for stem in reversed(stems_of(scene.name, view.name))
        for suffix in _SUFFIXES
    ]
    inside = [file for file in files if file.resolve().is_relative_to(folder.resolve())]
    usual = folder / f"{PurePosixPath(view.name).with_suffix('')}.json"
    return next(filter(Path.is_file, inside), usual)
