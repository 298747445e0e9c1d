"""Opens the data of a bundle's scores in the folders that the user names."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from sucre_bench import plugins, results
from sucre_bench.arrays import DataFrame
from sucre_bench.degrade import Degradation, degraded_whole
from sucre_bench.engine.select_views import open_scenes
from sucre_bench.errors import ANY_FAULT, InputError, SucreBenchError, one_line
from sucre_bench.plugins.options import Choice, options_of, seed_of, typed
from sucre_bench.scene import Scene

_ROOT = "root"  # the option of datasets that names their folder


@dataclass(frozen=True, eq=False)
class Opened:
    """scenes: by dataset label and name in rows; faults: a line each, where data differ or do not open."""

    scenes: Mapping[tuple[str, str], Scene]
    faults: tuple[str, ...]


@dataclass(frozen=True)
class _Origin:
    """Of which data rows are: the dataset's label, the scene's name in rows, its data_id and all options as JSON."""

    dataset: str
    scene: str
    data_id: str
    options: str


def open_data(rows: DataFrame, places: Mapping[str, Path]) -> Opened:
    """Open the data of rows. places: folder of the data, by dataset label.

    A dataset's other options are those of the bundle, but none may lead out of the folder. Data that are made, since
    their dataset needs no folder, are made in the user's cache. Nothing is written into `places`.
    """
    scenes: dict[tuple[str, str], Scene] = {}
    faults: list[str] = []
    for origin in _origins(rows, places):
        where = f"{origin.dataset} / {origin.scene}"
        try:
            scene, data_id = _scene(origin, places[origin.dataset])
        except ANY_FAULT as fault:  # whatever a stranger's options make fail is a fault of that bundle
            faults.append(f"{where}: {one_line(fault)}")
            continue
        if data_id != origin.data_id:
            faults.append(
                f"{where}: the data in {places[origin.dataset]} are {data_id}, the scores of {origin.data_id}"
            )
        else:
            scenes[origin.dataset, origin.scene] = scene
    return Opened(scenes, tuple(dict.fromkeys(faults)))


def _origins(rows: DataFrame, places: Mapping[str, Path]) -> Iterator[_Origin]:
    """A scene of a dataset is the same for all methods, unless the bundle mixes data: then each is checked."""
    known = rows[(rows["view"] != "") & rows["dataset"].isin(places)]
    once = known.drop_duplicates(["dataset", "scene", "data_id"])
    yield from (_Origin(r.dataset, r.scene, r.data_id, r.options) for r in once.itertuples())


def _scene(origin: _Origin, root: Path) -> tuple[Scene, str]:
    """Return a scene as it was restored, and its data_id. Raises InputError if it does not open here."""
    try:
        told = json.loads(origin.options)
        given, degrade, replicate = dict(told["dataset"]), dict(told.get("degrade", {})), int(told.get("replicate", 0))
        plugin = plugins.find("dataset", str(given.pop("name")))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as fault:
        raise InputError(f"its options cannot be read ({one_line(fault)}); ask who made the bundle") from fault
    known = {option.name: option for option in options_of(plugin.cls)}
    types = {name: option.type for name, option in known.items()}
    if _ROOT not in types:
        raise InputError(f"dataset '{plugin.name}' has no option {_ROOT}; leave --data out")
    given.pop(_ROOT, None)
    _refuse_paths({**given, **degrade})
    if known[_ROOT].default is not None:  # without a folder the data are made, in the user's cache: not in `root`
        given[_ROOT] = str(root)
    options = {name: typed(types[name], value) if name in types else value for name, value in given.items()}
    choice = Choice(plugin, origin.dataset, options, replicate=replicate)
    drawn = _drawn(degrade, replicate)
    scene = _same(open_scenes(choice), origin, drawn, root)
    return degraded_whole(scene, drawn), drawn.data_id(scene.data_id)


def _same(scenes: Sequence[Scene], origin: _Origin, drawn: Degradation, root: Path) -> Scene:
    """The scene of the same data, or else of the same name; a scene that is called after a moved folder is renamed."""
    name, _ = results.unreplicated(origin.scene)
    alike = [scene for scene in scenes if origin.data_id and drawn.data_id(scene.data_id) == origin.data_id]
    named = [scene for scene in scenes if scene.name == name]
    if not (found := alike or named or (scenes if len(scenes) == 1 else [])):
        raise InputError(f"{root}: has no scene '{name}'; give the folder of the same data")
    return replace(found[0], name=name)


def _drawn(degrade: Mapping[str, Any], replicate: int) -> Degradation:
    try:
        degradation = Degradation.of(degrade)
        return Degradation.of({**degrade, "seed": seed_of(degradation.seed, "degrade", replicate)})
    except SucreBenchError:
        raise
    except ANY_FAULT as fault:
        raise InputError(f"degrade: {one_line(fault)}; ask who made the bundle") from fault


def _refuse_paths(options: Mapping[str, Any]) -> None:
    """Raise InputError for an option that leads out of the data's folder: it may name any file of this user."""
    for name, value in options.items():
        for text in value if isinstance(value, list) else [value]:
            if isinstance(text, str) and _leads_out(text):
                raise InputError(f"option {name}={text} leads out of the data's folder; ask who made the bundle")


def _leads_out(text: str) -> bool:
    is_absolute = PurePosixPath(text).is_absolute() or PureWindowsPath(text).drive
    return bool(is_absolute or text.startswith("~") or ".." in text.replace("\\", "/").split("/"))
