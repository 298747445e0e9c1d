"""From a command's words to the session that they ask for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sucre_bench.charting.session import Session
from sucre_bench.charting.store import ChartsFile
from sucre_bench.charts import chart_kind
from sucre_bench.errors import InputError
from sucre_bench.scene import View
from sucre_bench.selection import Selection, select

__all__ = ["open_session"]


def open_session(words: Sequence[str], kind: str) -> Session:
    """Return the session for views and overrides, as `sucre-bench charts` takes them. kind: of new charts.

    Raises InputError for an unknown view or kind, and for a dataset that keeps no charts.json.
    """
    kind = str(Path(kind).expanduser().resolve()) if kind.lower().endswith(".csv") else kind
    chart_kind(kind)
    selections = select(_overrides(words))
    if len(selections) != 1:
        names = ", ".join(s.scene.name for s in selections)
        raise InputError(f"charts: the views are of {len(selections)} scenes ({names}); choose one scene's")
    selection, chosen = selections[0], {view.name for view in selections[0].views}
    file = ChartsFile(_path(selection), {view.name: _size(view) for view in selection.scene.views})
    others = [view for view in selection.scene.views if view.name not in chosen]
    return Session(selection.views, file, kind, others)


def _overrides(words: Sequence[str]) -> list[str]:
    """Overrides as they are; the rest are views: files in a scene's images/, or names beside dataset=."""
    given = [word for word in words if "=" in word]
    views = [word for word in words if "=" not in word]
    for word in (*views, *given):
        if word.startswith("-"):
            raise InputError(f"charts: no option {word}; see sucre-bench charts --help")
        if word.startswith(("degrade.", "dataset.image_scale=")):
            raise InputError(f"{word}: corners are kept in pixels of the images as they are; leave it out")
    if not any(word.startswith(("dataset.", "dataset=")) for word in given):
        if not views:
            raise InputError("charts: no view; give images of a folder images/, or dataset=colmap dataset.root=DIR")
        roots, views = zip(*map(_in_images, views), strict=True)  # type: ignore[assignment]
        if len(set(roots)) > 1:
            raise InputError(f"{views[-1]}: is not of the same scene as {views[0]}; give one scene's images")
        given += ["dataset=colmap", f"dataset.root={_quoted(str(roots[0]))}"]
    return [*given, *([f"views=[{','.join(map(_quoted, views))}]"] if views else [])]


def _in_images(word: str) -> tuple[Path, str]:
    """The folder of a scene that an image belongs to, and the image's name in it."""
    path = Path(word).expanduser().absolute()
    if not path.is_file():
        raise InputError(f"{word}: no such image; give one in a folder images/, or add dataset=")
    for folder in path.parents:
        if folder.name == "images":
            return folder.parent, path.relative_to(folder).as_posix()
    raise InputError(f"{word}: is not in a folder images/ of a scene; add dataset=colmap dataset.root=DIR")


def _quoted(text: str) -> str:
    """As Hydra takes any text."""
    escaped = text.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"


def _path(selection: Selection) -> Path:
    options = selection.dataset.options
    if not {"root", "charts"} <= options.keys():
        name = selection.dataset.plugin.name
        raise InputError(f"charts: dataset '{name}' keeps no charts.json; use one that does, like colmap")
    return Path(options["root"]).expanduser() / options["charts"]


def _size(view: View) -> tuple[int, int]:
    if view.camera is not None:
        return view.camera.width, view.camera.height
    height, width = view.rgb.shape[:2]
    return width, height
