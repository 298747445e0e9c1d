"""Rules for datasets: scenes open without reading pixels, planes have right shapes, `has` is true."""

import tempfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

import numpy as np

from sucre_bench.arrays import evenly
from sucre_bench.engine.preflight import open_scenes
from sucre_bench.errors import InputError, one_line
from sucre_bench.imaging.chart_kinds import chart_kind
from sucre_bench.imaging.chart_patches import check_corners
from sucre_bench.plugins.options import Choice, options_of
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.programs.contract.contract import Lines, Rule, Subject
from sucre_bench.scene import Scene, View


def rules(_: Plugin) -> list[Rule]:
    """Return the rules for a dataset."""
    return [
        names_once,
        planes_are_sound,
        geometry_is_sound,
        has_what_it_says,
        is_repeatable,
        names_what_is_missing,
    ]


def _opened(subject: Subject) -> list[Scene]:
    subject.make()
    return open_scenes(Choice(subject.plugin, subject.plugin.name, subject.options))


def _views(subject: Subject, most: int) -> Iterator[tuple[str, View]]:
    """At most so many views of each scene, the first and the last among them, with their names in findings."""
    for scene in _opened(subject):
        for k in evenly(len(scene), most):
            yield f"{scene.name}/{scene.views[k].name}", scene.views[k]


def names_once(subject: Subject) -> Lines:
    """Opens, and names every scene and view once."""
    scenes = _opened(subject)  # refuses duplicates
    for name in (view.name for scene in scenes for view in scene):
        path = PurePosixPath(name)
        if not name or path.is_absolute() or ".." in path.parts or "\\" in name:
            yield f"a view is called '{name}'; a name is a path below the images, dive/a.png"


def planes_are_sound(subject: Subject) -> Lines:
    """Gives images, depth and references of the right shape and range."""
    for where, view in _views(subject, 3):
        yield from (f"{where}: {fault}" for fault in _plane_faults(view))


def _plane_faults(view: View) -> Lines:
    rgb, depth, reference = (view.pixels.load(plane) for plane in ("rgb", "depth", "reference"))
    if rgb is None or rgb.ndim != 3 or rgb.shape[2] != 3:
        yield f"rgb is {None if rgb is None else rgb.shape}; every view has (H, W, 3)"
        return
    for name, image in (("rgb", rgb), ("reference", reference)):
        if image is None:
            continue
        if image.dtype != np.float32:
            yield f"{name} is {image.dtype}; give float32"
        if not np.isfinite(image).all():
            yield f"{name} has values that are not finite; every pixel has a colour"
        elif image.min() < 0 or image.max() > 1:
            yield f"{name} goes from {image.min():.3g} to {image.max():.3g}; divide by full scale, to [0, 1]"
        if image.shape != rgb.shape:
            yield f"{name} is {image.shape}, rgb {rgb.shape}; bring it to the image's size"
    if depth is not None and (depth.shape != rgb.shape[:2] or depth.dtype != np.float32):
        yield f"depth is {depth.shape} {depth.dtype}; give {rgb.shape[:2]} float32 metres"
    elif depth is not None and not depth.min() >= 0:
        yield "depth is NaN or negative; what is unknown is 0"


def geometry_is_sound(subject: Subject) -> Lines:
    """Gives sound cameras, poses and charts."""
    for where, view in _views(subject, 30):
        camera = view.camera
        x, y = (1, 1) if camera is None else camera.K[:2, 2]
        if camera is not None and not (0 < x < camera.width and 0 < y < camera.height):
            at = f"the principal point ({x:g}, {y:g}) is not in the image of {camera.width}x{camera.height}"
            yield f"{where}: {at}; give K in pixels"
        if view.cam_from_world is not None and camera is None:
            yield f"{where}: has a pose and no camera; give both, or no pose"
        if len({chart.name for chart in view.charts}) < len(view.charts):
            yield f"{where}: two charts have one name; name each"
        for chart in view.charts:
            chart_kind(chart.kind)
            check_corners(chart.name, np.asarray(chart.corners, dtype=np.float64))


def has_what_it_says(subject: Subject) -> Lines:
    """Declares what its scenes have."""
    for scene in _opened(subject):
        views = [scene.views[k] for k in evenly(len(scene), 30)]
        there = {
            name: any(view.pixels.load(name) is not None for view in views)
            for name in ("depth", "reference")
        }
        there["poses"] = any(view.cam_from_world is not None for view in views)
        there["charts"] = any(view.charts for view in views)
        there["truth"] = scene.water is not None
        for name, found in there.items():
            if found and name not in scene.has:
                yield f"{scene.name}: views have {name}, which `has` does not say; add it, or methods skip them"
            if not found and name in scene.has and len(views) == len(scene):
                yield f"{scene.name}: `has` says {name}, no view has any; leave it out"
        if undeclared := sorted(scene.has - subject.plugin.has):
            yield f"{scene.name} has {', '.join(undeclared)}; add to has= of @dataset, which `list` shows"


def is_repeatable(subject: Subject) -> Lines:
    """Gives the same when it is opened again, with an id of its data."""
    first, second = _opened(subject), _opened(subject)
    if [(s.name, [v.name for v in s]) for s in first] != [
        (s.name, [v.name for v in s]) for s in second
    ]:
        yield "scenes or views come in another order; sort what the file system lists"
        return
    for one, other in zip(first, second, strict=True):
        if not one.data_id:
            yield f"{one.name}: no data_id; hash what the views hold, or results outlive the data they are of"
        elif one.data_id != other.data_id:
            yield f"{one.name}: data_id is another when opened again; hash contents, not dates or objects"
        if not np.array_equal(one.views[0].rgb, other.views[0].rgb):
            yield f"{one.views[0].name}: another image when opened again; seed what is random"


def names_what_is_missing(subject: Subject) -> Lines:
    """Names a folder that is missing or empty, in one line."""
    asked = [o.name for o in options_of(subject.plugin.cls) if o.type is Path and o.is_required]
    if not asked:
        return
    remedy = f'raise InputError(f"{{self.{asked[0]}}}: what is wrong; what to do")'
    with tempfile.TemporaryDirectory(prefix="sucre_bench_") as empty:
        for place, what in (
            (Path(empty, "not-there"), "a folder that is not there"),
            (Path(empty), "an empty folder"),
        ):
            options = {**subject.options, **dict.fromkeys(asked, place)}
            try:
                _opened(Subject(subject.plugin, options))
            except InputError as fault:
                said = one_line(fault)
                if str(place) not in said or "; " not in said or "\n" in str(fault):
                    yield f"{asked[0]}, {what}: says only '{said}'; {remedy}"
            except Exception as fault:
                yield f"{asked[0]}, {what}: {one_line(fault).split('; ')[0]}; {remedy}"
            else:
                yield f"{asked[0]}, {what}: opens all the same; {remedy}"
