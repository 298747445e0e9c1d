"""Reads and writes charts.json while charts are marked: confirmed charts for loaders, and proposals.

    {"images": {"a.png": {"chart1": [[x, y], ...]}},
     "proposed": {"b.png": {"chart1": {"kind": "dgk", "corners": [[x, y], ...], "from": "a.png"}, "chart2": null}}}

Loaders read "images" only (see `sucre_bench.loading.charts_file`). null is a rejected proposal, which is not
made again. Other entries of the file stay.
"""

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from sucre_bench.arrays import Size
from sucre_bench.loading.charts_file import chart_of, read_charts
from sucre_bench.machine.files import reading, write_atomically
from sucre_bench.programs.charts.proposals import Proposal
from sucre_bench.scene import Chart


class ChartsFile:
    """The charts of a scene's images, and their file.

    path: of charts.json (may be missing); sizes: (width, height) in pixels of every image, by name.
    Raises InputError for a file that is not in its format.
    """

    def __init__(self, path: Path, sizes: Mapping[str, Size]) -> None:
        # so that kinds, which may be paths, do not depend on the current folder
        self.path = path = path.resolve()
        self._sizes = sizes
        self._confirmed = {
            name: list(charts) for name, charts in read_charts(path, sizes).items()
        }
        self._content: dict[str, Any] = (
            json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        )
        with reading(path, "remove 'proposed' there"):
            self._proposed = {
                view: {
                    name: self._proposal(view, name, entry) for name, entry in charts.items()
                }
                for view, charts in self._content.get("proposed", {}).items()
                if view in sizes
            }

    def confirmed(self, view: str) -> tuple[Chart, ...]:
        """The charts marked in a view."""
        return tuple(self._confirmed.get(view, ()))

    def proposed(self, view: str) -> tuple[Proposal, ...]:
        """The charts proposed for a view and not rejected."""
        return tuple(p for p in self._proposed.get(view, {}).values() if p is not None)

    @property
    def kinds(self) -> frozenset[str]:
        """The kinds of all charts in the file."""
        return frozenset(chart.kind for charts in self._confirmed.values() for chart in charts)

    def chart(self, view: str, name: str, kind: str, corners: Any) -> Chart:
        """Return a chart as loaders would read it. Raises InputError if it is none."""
        return chart_of(
            self.path, view, name, {"kind": kind, "corners": corners}, kind, self._sizes[view]
        )

    def confirm(self, view: str, charts: Iterable[Chart]) -> None:
        """Make these the charts of a view and drop proposals of their names. Raises InputError for a repeated name."""
        kept = {chart.name: chart for chart in charts}
        for name in kept:
            self._proposed.get(view, {}).pop(name, None)
        self._confirmed[view] = list(kept.values())

    def propose(self, proposals: Iterable[Proposal]) -> None:
        """Add proposals, except rejected ones."""
        for proposal in proposals:
            of_view = self._proposed.setdefault(proposal.view, {})
            if of_view.get(proposal.chart.name, proposal) is not None:
                of_view[proposal.chart.name] = proposal

    def turn_down(self, view: str, name: str) -> None:
        """Reject a proposal for good."""
        self._proposed.setdefault(view, {})[name] = None

    def save(self) -> None:
        """Write the file atomically, if there is anything to store. Raises OutputError."""
        images: dict[str, Any] = dict(self._content.get("images", {}))
        plain = self._content.get("kind", "dgk")  # of charts that are written as corners alone
        for view, charts in self._confirmed.items():
            full = {chart.name: self._full(chart) for chart in charts}
            images[view] = {
                name: each["corners"] if each["kind"] == plain else each
                for name, each in full.items()
            }
        images = {view: entries for view, entries in images.items() if entries}
        proposed = {
            view: {
                name: None if p is None else {**self._full(p.chart), "from": p.source}
                for name, p in proposals.items()
            }
            for view, proposals in self._proposed.items()
            if proposals
        }
        if not (images or proposed or self.path.is_file()):
            return
        content = {**self._content, "images": images, "proposed": proposed}
        if not proposed:
            del content["proposed"]
        write_atomically(
            self.path, (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()
        )

    def _full(self, chart: Chart) -> dict[str, Any]:
        is_file = chart.kind.lower().endswith(".csv")  # relative to the file, as it is read
        kind = (
            Path(os.path.relpath(chart.kind, self.path.parent)).as_posix()
            if is_file
            else chart.kind
        )
        return {
            "kind": kind,
            "corners": [[round(float(x), 2), round(float(y), 2)] for x, y in chart.corners],
        }

    def _proposal(self, view: str, name: str, entry: Any) -> Proposal | None:
        if entry is None:
            return None
        chart = chart_of(self.path, view, name, entry, "dgk", self._sizes[view])
        return Proposal(view, chart, str(entry["from"]))
