"""Restores the photographs of a source by the engine: the dive together, the others one by one; writes the pictures."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path, PurePosixPath

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import evenly
from sucre_bench.camera import Camera
from sucre_bench.engine.hydra_run import run_words
from sucre_bench.engine.preflight import MOST_SHOWN_OVER, opening_once, select
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.imaging.display import is_of_scene
from sucre_bench.imaging.image_files import SUFFIXES
from sucre_bench.jobs.catalogue import method_choice, option_names, recognised
from sucre_bench.jobs.word_syntax import quoted, value_of
from sucre_bench.loading.colmap_model import lens_of_model
from sucre_bench.loading.image_folder import image_names, no_image
from sucre_bench.loading.lens import Lens
from sucre_bench.loading.passed_over import EXPORT, other_photographs
from sucre_bench.loading.view_files import source_files
from sucre_bench.machine import progress
from sucre_bench.machine.files import check_folder, read_json, reading, write_atomically
from sucre_bench.programs.restore.picture_file import bits_of
from sucre_bench.programs.restore.trust import RUINED, Assessed, assess, ruined
from sucre_bench.programs.restore.write import Restored, write_pictures
from sucre_bench.results import layout, restoration_rows, with_remedy
from sucre_bench.results.restorations import read_record
from sucre_bench.results.rows import tuples
from sucre_bench.scene import Scene

Words = tuple[str, ...]  # of `sucre-bench run`

# What a method gets that has this option: one water for the dive, so that mosaics have no steps.
FOR_A_DIVE = {"water": "shared"}

# Words of `run` that say where the work is done.
_WHERE = re.compile(r"(workers|shard\.count|hydra[./][\w.]+)=")
_LEAST = {"workers": 0, "shard.count": 1}


@dataclass(frozen=True)
class Options:
    """The options of `restore`."""

    method: str
    """Of the dive."""

    single_view: str
    """The method of photographs without a place in the dive."""

    quality: int = 95
    """Of JPEG and WebP, 1 to 100."""

    original_geometry: bool = False
    """Whether pictures are distorted back."""

    words: Words = ()
    """Of `sucre-bench run`: options of dataset and method."""

    where: Words = ()
    """Words of `sucre-bench run` that say where the work is done, in how many blocks."""


def sorted_words(words: Sequence[str], method: str) -> tuple[Words, Words]:
    """Return the options of the dataset and the method of the dive, and the words that say where the work is done.

    Raises InputError for a word that is neither, and for a number of workers or blocks that is none.
    """
    where = tuple(word for word in words if _WHERE.match(word))
    for word, (name, _, value) in ((word, word.partition("=")) for word in where):
        if name in _LEAST and not (
            re.fullmatch("0|[1-9][0-9]{0,5}", value) and int(value) >= _LEAST[name]
        ):
            raise InputError(
                f"is no whole number of {_LEAST[name]} or more",
                word,
                f"give one, for example {name}=4",
            )
    options = tuple(word.lstrip("+") for word in words if word not in where)
    for word in options:
        place = word.partition("=")[0]
        owner, dot, name = place.partition(".")
        if not dot or owner not in ("dataset", "method", method):
            remedy = f"give dataset.NAME=VALUE, {method}.NAME=VALUE, or workers=4"
            raise InputError("is no option of the dataset or the method", word, remedy)
        known = option_names("method", method)
        if owner != "dataset" and known and name not in known:
            raise unknown_name(place, name, known)
    return options, where


@dataclass(frozen=True)
class Source:
    """What is restored."""

    dataset: Words
    """Its words."""

    is_dive: bool
    """Whether its views have poses or depth."""

    prepared: PreparedDive | None = None
    """What `prepare` noted of it."""

    photographs: Mapping[str, Path] = field(default_factory=dict)
    """Files by name, none if the views are the photographs."""

    folder: Path = Path()
    """Of the photographs."""

    @property
    def of_photographs(self) -> Source:
        """The photographs alone, each for itself."""
        words = ("dataset=photos", _root(self.folder), "dataset.subfolders=true")
        return Source(words, False, None, self.photographs, self.folder)


@dataclass(frozen=True)
class Done:
    """The outcome."""

    names: tuple[str, ...]
    """Of the pictures."""

    faults: Mapping[str, str]
    """Why a photograph has no picture."""

    n_instead: int
    """Number of pictures that the method of single views made, since the method of the dive could not."""

    has_failed: bool
    """Whether the method of the dive failed, at a photograph or by restoring none. Lack of depth at some is no
    failure."""

    together: Sequence[Restored]
    """Photographs that the method of the dive restored."""

    assessed: Sequence[Assessed]
    """How far each picture can be trusted."""


def source_of(folder: Path, photographs: Path | None = None) -> Source:
    """Find out what a folder is. photographs: the folder that a dive was prepared from, if it was moved.

    Raises InputError if it holds neither photographs nor a dive.
    """
    check_folder(folder, "give the folder of the photographs")
    try:
        name = recognised(folder)
    except InputError:
        if not image_names(folder, subfolders=True):
            if any(folder.iterdir()):
                raise
            fault = f"holds no photographs ({' '.join(SUFFIXES)}) and no dive"
            raise no_image(folder, fault, "name their folder") from None
        name = "photos"
    if not {"poses", "depth"} & plugins.find("dataset", name).has:
        return Source(
            (), False, photographs=photographs_in(folder), folder=folder
        ).of_photographs
    prepared = read_prepared(folder)
    if prepared and prepared.photographs.is_dir():
        photographs = photographs or prepared.photographs
    dive = Source((f"dataset={name}", _root(folder)), True, prepared)
    if photographs is None:
        return dive
    return replace(dive, photographs=photographs_in(photographs), folder=photographs)


def _root(folder: Path) -> str:
    return f"dataset.root={quoted(str(folder))}"


def restore(source: Source, out: Path, options: Options) -> Done:
    """Restore all photographs of a source and write their pictures below `out`; what is finished is not repeated.

    Raises InputError for options that do not exist, OutputError if files cannot be written, KeyboardInterrupt if it is
    stopped. What is wrong with one photograph is a fault, and the others go on.
    """
    note = noted(source, out, options)
    of_dataset = [word for word in options.words if word.startswith("dataset.")]
    of_method = [word for word in options.words if word not in of_dataset]
    named = {word.partition("=")[0].partition(".")[2] for word in of_method}
    if named and "label" not in named:  # other options are other restorations
        parts = [options.method, *(f"{name}={{{name}}}" for name in sorted(named))]
        of_method.append(f"method.label={quoted(','.join(parts))}")
    dive = alone = _Run([], {}, False)
    balanced = list[Restored]()
    with opening_once():
        if source.is_dive:
            source = replace(source, dataset=(*source.dataset, *of_dataset))
            display = method_choice(options.method, {}).display
            known = option_names("method", options.method)
            values = {name: value for name, value in FOR_A_DIVE.items() if name in known}
            if display != "none" and not is_of_scene(display):
                values["display"] = f"{display}@scene"  # over all views
            words = [
                f"method={options.method}",
                *(f"method.{k}={v}" for k, v in values.items() if k not in named),
            ]
            dive = _run(source, [*words, *of_method], options.where, out)
            if options.method != options.single_view:
                dive, balanced = _replaced(dive, source, options, out)
        done = {one.name for one in [*dive.restored, *balanced]}
        names = source.photographs or [*dive.faults, *done]
        if left := [name for name in names if name not in done]:
            rest = source.of_photographs if source.photographs else source
            if source.is_dive:
                of_dataset = [
                    word for word in of_dataset if word.startswith("dataset.encoding=")
                ]
            rest = replace(rest, dataset=(*rest.dataset, *of_dataset))
            words = [f"method={options.single_view}", f"views={value_of(left)}"]
            if options.single_view == options.method:
                words += of_method
            alone = _run(rest, words, options.where, out)
    with progress.live():
        restored = [*dive.restored, *balanced, *alone.restored]
        restored.sort(key=lambda one: one.name)
        faults = write_pictures(
            restored, out, options.quality, options.original_geometry, note.stat().st_mtime_ns
        )
        instead = {name: f"not by {options.method}: {why}" for name, why in dive.faults.items()}
        written = [one for one in restored if one.name not in faults]
        assessed = assess(written, out, options.original_geometry, instead)
    if source.photographs:
        others = (
            path.relative_to(source.folder).as_posix()
            for path in other_photographs(source.folder)
        )
        faults |= dict.fromkeys(others, f"its format is not read; {EXPORT}")
    made = tuple(one.name for one in written)
    faults |= {
        name: alone.faults.get(name, "") for name in names if name not in {*made, *faults}
    }
    n_instead = len(instead.keys() & made)
    return Done(made, faults, n_instead, dive.has_failed, dive.restored, assessed)


def noted(source: Source, out: Path, options: Options, again: bool = True) -> Path:
    """Return the note of source and options below `out`: pictures older than it were written with other options.

    again: also note options that differ. Raises InputError if `out` has the pictures of another source.
    """
    note = out / "work" / "restore.json"
    name = str(source.folder.resolve()) if source.photographs else " ".join(source.dataset)
    now = json.loads(
        json.dumps({"source": name, "options": asdict(replace(options, where=()))})
    )
    before = read_json(note, "name a new folder for the pictures")
    of = before.get("source") if isinstance(before, dict) else before
    if before is not None and of != now["source"]:
        raise InputError(f"holds the pictures of {of}", out, "name a new folder")
    if before is None or (again and before != now):
        write_atomically(note, json.dumps(now, indent=1).encode())
    return note


@dataclass(frozen=True, eq=False)
class _Run:
    """What a run restored."""

    restored: list[Restored]

    faults: dict[str, str]
    """By photograph."""

    has_failed: bool
    """See `Done`."""


def _parts(
    words: Sequence[str], where: Sequence[str], scenes: Sequence[Scene]
) -> list[Sequence[str]]:
    """The words of each run of a source: all at once, or blocks of its views.

    In blocks, the views that decide how all are shown come first, so that no block restores them again.
    """
    given = dict(word.split("=", 1) for word in where)
    count = given.get("shard.count", given.get("workers", "1"))
    if count in ("0", "1"):
        return [where]
    blocks = [*where, f"shard.count={count}", f"shard.index=range({count})"]
    if not any(word.endswith("@scene") for word in words):
        return [blocks]
    deciding = {
        scene.views[k].name for scene in scenes for k in evenly(len(scene), MOST_SHOWN_OVER)
    }
    whole = [word for word in where if not word.startswith("shard")]
    return [[*whole, f"views={value_of(sorted(deciding))}"], blocks]


def _run(source: Source, words: Sequence[str], where: Sequence[str], out: Path) -> _Run:
    """Restore a source by the engine. Raises what `engine.run` does, and KeyboardInterrupt if it is stopped."""
    folder = out / "work" / "results"
    bits = 16 if any(bits_of(path) == 16 for path in source.photographs.values()) else 8
    settings = [f"out={quoted(str(folder))}", f"bits={bits}", "colours=stored"]
    settings += ["metrics=[coverage]", "report=false", "tracking.uri=off"]
    with progress.live():
        scenes = [selection.scene for selection in select(source.dataset)]
    for part in _parts(words, where, scenes):
        outcome = run_words([*source.dataset, *words, *settings, *part], bool(where))
        if outcome.interrupted:
            raise KeyboardInterrupt("stopped; the same command continues from here")
    views = {(scene.name, view.name): view for scene in scenes for view in scene.views}
    named = view_of_each(source.photographs, {view for _, view in views})
    restored = []
    rows = restoration_rows(outcome.requested_rows)
    for row in tuples(rows[rows["status"] == "ok"]):
        view = views[row.scene, row.view]
        name = named.get(row.view, row.view if len(scenes) == 1 else f"{row.scene}/{row.view}")
        place = layout.find(row.dataset, row.scene, row.view, folder)
        if place is None:
            continue
        photograph = source.photographs.get(name) or next(source_files(view))
        lens = getattr(view.pixels, "lens", None)
        origin = None
        if source.prepared:
            lens = source.prepared.lens_of(view.camera)
            origin = source.prepared.origins / PurePosixPath(view.name).with_suffix(".png")
        record = read_record(row, folder)
        said = record.get("limits")
        restored.append(
            Restored(
                name,
                photograph,
                view,
                place.restored(folder, row.method),
                lens,
                origin,
                row.method,
                row.coverage,
                [str(limit) for limit in said] if isinstance(said, list) else [],
                record,
                source.is_dive,
            )
        )
    missing = (*outcome.failed, *outcome.skipped)
    faults = {named.get(fault.view, fault.view): with_remedy(fault.reason) for fault in missing}
    return _Run(restored, faults, bool(outcome.failed) or not restored)


def _replaced(
    dive: _Run, source: Source, options: Options, out: Path
) -> tuple[_Run, list[Restored]]:
    """Restore the views of ruined pictures by the method of single views; return the dive without them, and them.

    They come from the dive's own images, so that they have the geometry of its pictures.
    """
    whys = ruined(dive.restored)
    if not whys:
        return dive, []
    views = sorted({one.view.name for one in dive.restored if one.name in whys})
    words = [f"method={options.single_view}", f"views={value_of(views)}"]
    again = _run(source, words, options.where, out).restored
    balanced = [one for one in again if one.name in whys]
    faults = {one.name: whys[one.name] for one in balanced}
    # what turns the colours of some pictures has not measured the water of the others
    kept = [
        replace(one, record={**one.record, RUINED: len(whys)})
        for one in dive.restored
        if one.name not in faults
    ]
    return replace(dive, restored=kept, faults={**dive.faults, **faults}), balanced


# -- the photographs of a dive ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PreparedDive:
    """What `sucre-bench prepare` noted of a dive."""

    origins: Path
    """Folder of the maps that say how each pixel got its depth."""

    photographs: Path
    """Folder of the photographs."""

    lenses: tuple[Lens, ...]
    """Of its cameras."""

    def lens_of(self, camera: Camera | None) -> Lens | None:
        """Return the lens whose pinhole image has this camera; None if the photograph has no distortion."""
        for lens in self.lenses:
            own = lens.pinhole
            if camera is None or own.size != camera.size or not any(lens.coefficients):
                continue
            if np.allclose(own.K, camera.K, rtol=1e-6):
                return lens
        return None


def read_prepared(dive: Path) -> PreparedDive | None:
    """Return what a dive's prepare.json says; None without one. DamagedFileError if it cannot be read."""
    file = dive / "prepare.json"
    remedy = "prepare the dive again"
    record = read_json(file, remedy)
    if record is None:
        return None
    with reading(file, remedy):
        cameras = record["cameras"].values()
        lenses = (
            lens_of_model(c["model"], c["width"], c["height"], [float(p) for p in c["params"]])
            for c in cameras
        )
        return PreparedDive(
            dive / "depth_origin",
            Path(record["photos"]),
            tuple(lens for lens in lenses if not lens.fault),
        )


def photographs_in(folder: Path) -> dict[str, Path]:
    """Return the photographs in a folder and its sub-folders by their path in it. InputError if there is none."""
    check_folder(folder, "give the one that holds the photographs")
    found = {name: folder / name for name in image_names(folder, subfolders=True)}
    if not found:
        raise InputError("holds no photographs", folder, "put .jpg, .png or .tif there")
    return found


def view_of_each(photographs: Mapping[str, Path], views: Collection[str]) -> dict[str, str]:
    """Return the name of the photograph that each view is of, as `prepare` names views; those without one left out."""
    found = {}
    for name in photographs:
        undistorted = (f"{name}.png", PurePosixPath(name).with_suffix(".png").as_posix())
        if view := next((one for one in (name, *undistorted) if one in views), ""):
            found[view] = name
    return found
