"""Opens the data of a bundle's scores in the folders that the user names."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from sucre_bench import plugins, results
from sucre_bench.arrays import DataFrame
from sucre_bench.degrade import Degradation, degraded_whole
from sucre_bench.engine.select_views import open_scenes
from sucre_bench.errors import ANY_FAULT, InputError, SucreBenchError, one_line
from sucre_bench.plugins.options import Choice, options_of, seed_of, typed
from sucre_bench.scene import Scene

Scenes = dict[tuple[str, str], Scene]  # by dataset label, and name in rows


def open_data(rows: DataFrame, places: Mapping[str, Path]) -> tuple[Scenes, list[str]]:
    """Open the data of rows. places: folder of the data, by dataset label.

    Return the scenes, and a line for each that differs or does not open. A dataset's other options are those of the
    bundle, but none may lead out of the folder. Data that are made, since their dataset needs no folder, are made in
    the user's cache. Nothing is written into `places`.
    """
    scenes: Scenes = {}
    faults: list[str] = []
    known = rows[(rows["view"] != "") & rows["dataset"].isin(places)]
    # A scene of a dataset is the same for all methods, unless the bundle mixes data: then each is checked.
    for row in known.drop_duplicates(["dataset", "scene", "data_id"]).itertuples():
        where, root = f"{row.dataset} / {row.scene}", places[row.dataset]
        try:
            scene, data_id = _scene(row, root)
        except SucreBenchError as fault:
            faults.append(f"{where}: {one_line(fault)}")
        except ANY_FAULT as fault:  # whatever a stranger's options make fail is a fault of that bundle
            faults.append(f"{where}: its options cannot be used ({one_line(fault)}); ask who made the bundle")
        else:
            if data_id == row.data_id:
                scenes[row.dataset, row.scene] = scene
            else:
                faults.append(f"{where}: the data in {root} are {data_id}, the scores of {row.data_id}")
    return scenes, list(dict.fromkeys(faults))


def _scene(row: Any, root: Path) -> tuple[Scene, str]:
    """Return the scene of a row as it was restored, and its data_id. Raises InputError if it does not open here."""
    told = json.loads(row.options)
    given, degrade, replicate = dict(told["dataset"]), dict(told.get("degrade", {})), int(told.get("replicate", 0))
    plugin = plugins.find("dataset", str(given.pop("name")))
    known = {option.name: option for option in options_of(plugin.cls)}
    if "root" not in known:
        raise InputError(f"dataset '{plugin.name}' has no option root; leave --data out")
    given.pop("root", None)
    for name, value in {**given, **degrade}.items():
        for text in value if isinstance(value, list) else [value]:
            if isinstance(text, str) and _leads_out(text):  # to any file of this user
                raise InputError(f"option {name}={text} leads out of the data's folder; ask who made the bundle")
    if known["root"].default is not None:  # without a folder the data are made, in the user's cache: not in `root`
        given["root"] = str(root)
    options = {name: typed(known[name].type, value) if name in known else value for name, value in given.items()}
    seed = seed_of(Degradation.of(degrade).seed, "degrade", replicate)
    drawn = Degradation.of({**degrade, "seed": seed})
    scenes = open_scenes(Choice(plugin, row.dataset, options, replicate=replicate))
    # The scene of the same data, or else of the same name. One that is called after a moved folder is renamed.
    name, _ = results.unreplicated(row.scene)
    alike = [scene for scene in scenes if row.data_id and drawn.data_id(scene.data_id) == row.data_id]
    named = [scene for scene in scenes if scene.name == name]
    if not (found := alike or named or (scenes if len(scenes) == 1 else [])):
        raise InputError(f"{root}: has no scene '{name}'; give the folder of the same data")
    return degraded_whole(replace(found[0], name=name), drawn), drawn.data_id(found[0].data_id)


def _leads_out(text: str) -> bool:
    is_absolute = PurePosixPath(text).is_absolute() or PureWindowsPath(text).drive
    return bool(is_absolute or text.startswith("~") or ".." in text.replace("\\", "/").split("/"))
