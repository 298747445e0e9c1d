"""Opens the session for the words of `sucre-bench charts`."""

from collections.abc import Sequence
from pathlib import Path

from sucre_bench import plugins
from sucre_bench.engine.select_views import Selection, select
from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.imaging.chart_kinds import chart_kind
from sucre_bench.jobs.words import quoted
from sucre_bench.loading.view_files import Files
from sucre_bench.machine.files import expanded
from sucre_bench.programs.charts.charts_json import ChartsFile
from sucre_bench.programs.charts.session import Session
from sucre_bench.scene import View

_AS_STORED = "corners are kept in pixels of the images as they are stored"


def open_session(words: Sequence[str], kind: str, dataset: str) -> Session:
    """Return the session for views and overrides, as `sucre-bench charts` takes them.

    kind: of new charts; dataset: the plugin that reads images of a folder images/, if the words name none.

    Raises InputError for an unknown view or kind, and for a dataset without a charts.json.
    """
    kind = str(expanded(kind).resolve()) if kind.lower().endswith(".csv") else kind
    chart_kind(kind)
    selections = select(_overrides(words, dataset))
    if len(selections) != 1:
        names = ", ".join(s.scene.name for s in selections)
        raise InputError(f"charts: the views are of {len(selections)} scenes ({names}); choose one scene's")
    selection, chosen = selections[0], {view.name for view in selections[0].views}
    file = ChartsFile(_path(selection), {view.name: _size(view) for view in selection.scene.views})
    others = [view for view in selection.scene.views if view.name not in chosen]
    return Session(selection.views, file, kind, others)


def _overrides(words: Sequence[str], dataset: str) -> list[str]:
    """The overrides, with views added: files in a scene's images/, or with dataset= their names."""
    given = [word for word in words if "=" in word]
    views = [word for word in words if "=" not in word]
    for word in (*views, *given):
        if word.startswith("-"):
            raise InputError(f"charts: no option {word}; see sucre-bench charts --help")
        if word.startswith(("degrade.", "dataset.image_scale=")):
            raise InputError(f"{word}: {_AS_STORED}; leave it out")
    if not any(word.startswith(("dataset.", "dataset=")) for word in given):
        if not views:
            raise InputError(f"charts: no view; give images of a folder images/, or dataset={dataset} dataset.root=DIR")
        roots, views = zip(*(_in_images(view, dataset) for view in views), strict=True)  # type: ignore[assignment]
        if len(set(roots)) > 1:
            raise InputError(f"{views[-1]}: is not of the same scene as {views[0]}; give one scene's images")
        given += [f"dataset={dataset}", f"dataset.root={quoted(str(roots[0]))}"]
    return [*given, *([f"views=[{','.join(map(quoted, views))}]"] if views else [])]


def _in_images(word: str, dataset: str) -> tuple[Path, str]:
    """The folder of a scene that an image belongs to, and the image's name in it."""
    path = expanded(word).absolute()
    if not path.is_file():
        raise MissingFileError("no such image", word, "give one in a folder images/, or add dataset=")
    for folder in path.parents:
        if folder.name == "images":
            return folder.parent, path.relative_to(folder).as_posix()
    raise InputError(f"{word}: is not in a folder images/ of a scene; add dataset={dataset} dataset.root=DIR")


def _size(view: View) -> tuple[int, int]:
    """Return (width, height) of a view, from its camera or file header if possible, else by decoding it."""
    if view.camera is not None:
        return view.camera.width, view.camera.height
    if isinstance(view.pixels, Files):
        return view.pixels.size
    height, width = view.rgb.shape[:2]
    return width, height


def _path(selection: Selection) -> Path:
    options, plugin = selection.dataset.options, selection.dataset.plugin
    if not plugin.charts_file:
        known = [p.name for p in plugins.usable("dataset").values() if p.charts_file]
        raise InputError(f"charts: dataset '{plugin.name}' has no charts.json in its root; use {' or '.join(known)}")
    if options.get("undistort"):
        remedy = "undistort the images before, or mark charts in the distorted ones"
        raise InputError(f"dataset.undistort=true: {_AS_STORED}; {remedy}")
    if options.get("image_scale", 1) != 1 or selection.degrade.identity():
        raise InputError(
            f"charts: images are not shown as they are, and {_AS_STORED}; leave image_scale and degrade out"
        )
    return expanded(options["root"]) / expanded(options[plugin.charts_file])
