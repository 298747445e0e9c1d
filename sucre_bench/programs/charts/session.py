"""A session of marking charts: opened for the words of a command; what the page shows and sends, as plain values."""

import threading
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import Array, Size
from sucre_bench.engine.preflight import select
from sucre_bench.errors import InputError, MissingFileError, did_you_mean, one_line
from sucre_bench.imaging.chart_kinds import KINDS, chart_kind
from sucre_bench.imaging.chart_patches import measure, reading_order
from sucre_bench.imaging.display import display
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.jobs.word_syntax import quoted
from sucre_bench.loading.view_files import Files
from sucre_bench.machine import progress
from sucre_bench.machine.files import expanded
from sucre_bench.programs.charts.charts_json import ChartsFile
from sucre_bench.programs.charts.proposals import DETECTABLE, Proposal, detect, overlap, propose
from sucre_bench.scene import Chart, View


@dataclass
class Session:
    """The views of a scene for marking charts, and the charts' file.

    Charts are proposed from and for all views.
    """

    views: Sequence[View]
    """The named views, which come first and which the detector examines."""

    file: ChartsFile

    kind: str
    """Of new charts."""

    others: Sequence[View] = ()
    """Further views of the scene."""

    lock: threading.RLock = field(default_factory=threading.RLock)

    @property
    def everything(self) -> Sequence[View]:
        """All views, in the page's numbering."""
        return [*self.views, *self.others]

    def prepare(self) -> None:
        """Detect charts in views without any, propose marked charts in other views, and save."""
        if self.kind in DETECTABLE:
            known = self._marked()
            for view in progress.track(self.views, "looking for charts"):
                if self.file.confirmed(view.name) or self.file.proposed(view.name):
                    continue
                try:
                    found = detect(_picture(view), self.kind)
                except InputError as fault:
                    progress.say(f"failed  {fault}", is_fault=True)
                    continue
                # A chart is named as in other views if the geometry identifies it.
                expected = list(propose(known, [view]))
                taken = {chart.name for _, chart in known}
                for chart in found:
                    names = [
                        p.chart.name
                        for p in expected
                        if overlap(chart.corners, p.chart.corners)
                    ]
                    # one of these is free
                    numbered = [f"chart{n + 1}" for n in range(len(taken) + 1)]
                    names += [name for name in numbered if name not in taken]
                    named = replace(chart, name=names[0])
                    taken.add(named.name)
                    known.append((view, named))
                    self.file.propose([Proposal(view.name, named, "detector")])
        self._carry_over()
        self.file.save()

    def accept(self) -> tuple[list[Proposal], list[tuple[Proposal, str]]]:
        """Confirm every proposal whose patches are in order; return these, and the others with their faults."""
        accepted, doubtful = [], []
        with self.lock:
            for view in progress.track(self.everything, "checking patches"):
                proposals = self.file.proposed(view.name)
                try:
                    shown = _picture(view) if proposals else np.empty(0)
                    checked = [
                        (proposal, reading_order(shown, proposal.chart).fault)
                        for proposal in proposals
                    ]
                except InputError as fault:  # an unreadable view does not stop the others
                    checked = [(proposal, one_line(fault)) for proposal in proposals]
                good = [proposal for proposal, wrong in checked if not wrong]
                doubtful += [(proposal, wrong) for proposal, wrong in checked if wrong]
                if good:
                    self.file.confirm(
                        view.name, [*self.file.confirmed(view.name), *(p.chart for p in good)]
                    )
                    accepted += good
            self.file.save()
        return accepted, doubtful

    # -- requests of the page ------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """All views with their charts, and the kinds there are."""

        def plain(chart: Chart) -> dict[str, Any]:
            return {"name": chart.name, "kind": chart.kind, "corners": chart.corners.tolist()}

        with self.lock:
            views = [
                {
                    "name": view.name,
                    "charts": [plain(chart) for chart in self.file.confirmed(view.name)],
                    "proposed": [
                        {**plain(p.chart), "from": p.source}
                        for p in self.file.proposed(view.name)
                    ],
                }
                for view in self.everything
            ]
        return {"file": str(self.file.path), "kinds": self.kinds, "views": views}

    @property
    def kinds(self) -> list[str]:
        """The kinds of charts, that of new charts first; the page cannot name other files."""
        with self.lock:
            marked = sorted(self.file.kinds)
        return list(dict.fromkeys([self.kind, *KINDS, "colorchecker_sg", *marked]))

    def image(self, number: int, bright: bool) -> bytes:
        """A view as JPEG, at its own size. bright: with its contrast stretched."""
        import cv2

        view = self._numbered(number)
        shown = _picture(view, "stretch-1-99" if bright else "none")
        return bytes(
            cv2.imencode(".jpg", to_8bit(shown)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])[1]
        )

    def check(self, number: int, kind: str, corners: Any) -> dict[str, Any]:
        """A chart with these corners: the measured and expected colours of its patches, and its fault."""
        view = self._numbered(number)
        chart = self._chart(view, "chart", kind, corners)
        about, shown = chart_kind(chart.kind), _picture(view)
        patches = [
            {
                "box": one.patch.box,
                "measured": _css(one.rgb),
                "expected": _css(one.patch.srgb),
            }
            for one in measure(shown, chart)
        ]
        order = reading_order(shown, chart)
        return {
            "patches": patches,
            "fault": order.fault,
            "explained": None if np.isnan(order.explained) else round(order.explained, 2),
            "aspect": about.width / about.height,
        }

    def save(self, number: int, charts: Any, turned_down: Any = ()) -> dict[str, Any]:
        """Make these the charts of a view, propose them in the others, write the file, return the new state."""
        view = self._numbered(number)
        entries = [(str(c["name"]), str(c["kind"]), c["corners"]) for c in charts]
        names = {name for name, _, _ in entries if name.strip() and "/" not in name}
        if len(names) < len(entries):
            raise InputError(
                f"{view.name}: charts need names, different ones and without '/'; rename them"
            )
        with self.lock:
            before = _identities(self.file.confirmed(view.name))
            marked = [self._chart(view, *entry) for entry in entries]
            self.file.confirm(view.name, marked)
            for name in turned_down:
                self.file.turn_down(view.name, str(name))
            # Unchanged charts are not proposed again: a dive may show one in a thousand views.
            self._carry_over({name for name, *_ in before ^ _identities(marked)})
            self.file.save()
        return self.state()

    def _carry_over(self, only: Container[str] | None = None) -> None:
        views = progress.track(self.everything, "carrying charts over")
        self.file.propose(propose(self._marked(), views, only))

    def _marked(self) -> list[tuple[View, Chart]]:
        return [
            (view, chart)
            for view in self.everything
            for chart in self.file.confirmed(view.name)
        ]

    def _chart(self, view: View, name: str, kind: str, corners: Any) -> Chart:
        if kind not in self.kinds:
            raise InputError(
                f"{view.name}: chart kind '{kind}' is not the page's; {did_you_mean(kind, self.kinds)}"
            )
        return self.file.chart(view.name, name, kind, corners)

    def _numbered(self, number: int) -> View:
        views = self.everything
        if not 0 <= number < len(views):
            raise InputError(f"view {number}: there is none; reload the page")
        return views[number]


def _identities(charts: Iterable[Chart]) -> set[tuple[str, str, bytes]]:
    return {(chart.name, chart.kind, chart.corners.tobytes()) for chart in charts}


def _picture(view: View, how: str = "none") -> Array:
    return display(view.rgb, how, view.encoding)


def _css(rgb: Any) -> str:
    return "" if np.isnan(rgb).any() else "#" + to_8bit(np.asarray(rgb)).tobytes().hex()


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
        raise InputError(
            f"charts: the views are of {len(selections)} scenes ({names}); choose one scene's"
        )
    selection = selections[0]
    chosen = {view.name for view in selection.views}
    options, plugin = selection.dataset.options, selection.dataset.plugin
    if not plugin.charts_file:
        known = [p.name for p in plugins.usable("dataset").values() if p.charts_file]
        fault = f"dataset '{plugin.name}' has no charts.json in its root"
        raise InputError(fault, "charts", f"use {' or '.join(known)}")
    is_scaled = options.get("image_scale", 1) != 1
    if options.get("undistort") or is_scaled or selection.degrade.identity():
        fault = "corners are kept in pixels of the images as they are stored"
        raise InputError(fault, "charts", "leave undistort, image_scale and degrade out")
    # absolute, so that kinds, which may be paths, do not depend on the current folder
    path = (expanded(options["root"]) / expanded(options[plugin.charts_file])).resolve()
    file = ChartsFile(path, {view.name: _size(view) for view in selection.scene.views})
    others = [view for view in selection.scene.views if view.name not in chosen]
    return Session(selection.views, file, kind, others)


def _overrides(words: Sequence[str], dataset: str) -> list[str]:
    """The overrides, with views added: files in a scene's images/, or with dataset= their names."""
    given = [word for word in words if "=" in word]
    views = [word for word in words if "=" not in word]
    for word in (*views, *given):
        if word.startswith("-"):
            raise InputError(f"charts: no option {word}; see sucre-bench charts --help")
    if not any(word.startswith(("dataset.", "dataset=")) for word in given):
        if not views:
            raise InputError(
                f"charts: no view; give images of a folder images/, or dataset={dataset} dataset.root=DIR"
            )
        roots, views = zip(*(_in_images(view, dataset) for view in views), strict=True)  # type: ignore[assignment]
        if len(set(roots)) > 1:
            raise InputError(
                f"{views[-1]}: is not of the same scene as {views[0]}; give one scene's images"
            )
        given += [f"dataset={dataset}", f"dataset.root={quoted(str(roots[0]))}"]
    return [*given, *([f"views=[{','.join(map(quoted, views))}]"] if views else [])]


def _in_images(word: str, dataset: str) -> tuple[Path, str]:
    """The folder of a scene that an image belongs to, and the image's name in it."""
    path = expanded(word).absolute()
    if not path.is_file():
        raise MissingFileError(
            "no such image", word, "give one in a folder images/, or add dataset="
        )
    for folder in path.parents:
        if folder.name == "images":
            return folder.parent, path.relative_to(folder).as_posix()
    raise InputError(
        f"{word}: is not in a folder images/ of a scene; add dataset={dataset} dataset.root=DIR"
    )


def _size(view: View) -> Size:
    """Return (width, height) of a view, from its camera or file header if possible, else by decoding it."""
    if view.camera is not None:
        return view.camera.size
    if isinstance(view.pixels, Files):
        return view.pixels.size
    height, width = view.rgb.shape[:2]
    return width, height
