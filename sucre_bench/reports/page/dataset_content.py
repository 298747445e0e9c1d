"""What the page shows of a dataset: its table, its plots, and its views with their pictures for the script."""

import json
import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from sucre_bench.arrays import DataFrame
from sucre_bench.compare import COSTS, Column, Comparison, verdicts
from sucre_bench.compare.model import FILLED
from sucre_bench.compare.words import (
    ARROW,
    Deciding,
    answer,
    best_first,
    deciding,
    left_out,
    legend,
    number,
    parts_of,
    shown,
    shown_table,
    title,
    verdict_text,
)
from sucre_bench.errors import InputError
from sucre_bench.jobs.rerun import Rerun, metric_words
from sucre_bench.jobs.word_syntax import shell, value_of
from sucre_bench.machine.text_formats import counted
from sucre_bench.reports.metric_roles import metrics_of
from sucre_bench.reports.page import plots
from sucre_bench.reports.page.gallery import Gallery
from sucre_bench.reports.page.plots import CHANNELS, PARAMETERS, Choice, Places, chart_content
from sucre_bench.results import layout
from sucre_bench.results.restorations import FILES, read_record
from sucre_bench.results.rows import RESTORATION, restoration_rows, tuples

Content = dict[str, Any]  # what the template, or the script, reads

_WATER = ("B", "beta", "gamma")
_LONGEST_VALUE = 600  # characters of a value in a method's record
_MOST_NAMED = 100  # views in one command
_VIEW = ["scene", "view"]
# what the script reads of a column
_OF_COLUMN = (
    "metric",
    "variant",
    "unit",
    "better",
    "ranked",
    "directed",
)
_WHISKER = 84  # pixels, of an interval that is drawn in a cell


def heading(column: Column) -> Content:
    """Return the head of a column. kind: "describes", without a better, and no cost: shown when asked for; or "dim"."""
    kind = "dim" if column.knows == "taste" else ""
    if not column.directed and column.metric not in (*COSTS, FILLED):
        kind = "describes"
    return {
        "key": column.key,
        "head": " ".join(
            filter(
                None, [column.metric, ARROW[column.better], column.unit and f"({column.unit})"]
            )
        ),
        "below": [
            column.variant,
            counted(column.n_scored, column.of),
            *(["common pixels"] if column.pixels == "common" else []),
        ],
        "better": column.better,
        "kind": kind,
    }


def cells(table: Comparison, column: Column) -> list[Content | None]:
    """Return a column's cells, a method each, with the marks that every table gives them; None: no score."""
    known = [
        table.cells[name, column] for name in table.methods if (name, column) in table.cells
    ]
    ends = [
        end for cell in known for end in (cell.low, cell.mean, cell.high) if math.isfinite(end)
    ]
    low, high = min(ends, default=0.0), max(ends, default=0.0)
    made: list[Content | None] = []
    for name in table.methods:
        cell = table.cells.get((name, column))
        marks = shown(table, name, column)
        if cell is None:
            made.append(None)
            continue
        has_interval = (
            math.isfinite(cell.low) and math.isfinite(cell.high) and cell.high > cell.low
        )
        interval = f"{number(cell.low)} to {number(cell.high)}" if has_interval else ""
        said = [
            f"{title(column)}: {number(cell.mean)}{f' ± {number(cell.std)}' if math.isfinite(cell.std) else ''}",
            interval and f"95 % interval {interval}",
            "the difference from the best may be chance" if marks.mark else "",
            f"lacks {cell.holes} that others have" if cell.holes else "",
        ]
        # whose intervals are rough
        draws = interval and high > low and not column.has_few_views
        whisker = [
            4 + (_WHISKER - 8) * (end - low) / (high - low)
            for end in (cell.low, cell.mean, cell.high)
            if draws
        ]
        made.append(
            {
                "value": cell.mean,
                "text": number(cell.mean),
                "look": marks.look,
                "is_tie": bool(marks.mark),
                "holes": marks.holes,
                "interval": interval if draws else "",
                "whisker": [round(place, 1) for place in whisker],
                "title": "; ".join(filter(None, said)),
            }
        )
    return made


@dataclass(frozen=True)
class Section:
    """A dataset on the page."""

    out: Path
    """The run's folder."""

    rows: DataFrame
    """All rows of the dataset."""

    table: Comparison
    """Of its methods."""

    gallery: Gallery

    plugins: tuple[str, ...]
    """Files they were loaded from."""

    places: Places
    """Number of every method among all of the page, which gives the method its colour."""

    def content(self) -> Content:
        """Return what the template shows of the dataset, and under "data" what the script reads."""
        methods = {name: self.places[name] for name in self.table.methods}
        scene = "" if self._has_scenes else next(iter({*self.rows["scene"]} - {""}), "")
        enough = any(
            column.n_scored and not column.has_few_views for column in self.table.columns
        )
        parts = parts_of(self.table, with_variants=True)
        shown_cells = shown_table(self.table.methods, parts, intervals=enough)
        seconds = [
            column
            for column in self.table.columns
            if (column.metric, column.variant) == (RESTORATION, "wall")
        ]
        scores = [column for column in self._columns if column.directed and seconds]
        costs = [
            (column, plots.cost(self.table, column, seconds[0], self.places))
            for column in scores
        ]
        lines = answer(self.table.with_columns(self._deciding.columns))
        said = verdicts(self.table)
        return {
            "name": self.table.title,
            "title": f"Results on {self.table.title}{f': {scene}' if scene not in ('', self.table.title) else ''}",
            "lines": [line.split("`") for line in lines],  # every second part is a command
            "leads": [verdict_text(self.table, verdict) for verdict in said if verdict.is_sure],
            "chances": [
                verdict_text(self.table, verdict) for verdict in said if not verdict.is_sure
            ],
            "columns": [heading(column) for column in self._columns],
            "main": self._main.key if self._main else "",
            "lower_first": bool(self._main and self._main.better == "lower"),
            "rows": self._rows(),
            "note": ". ".join([legend(self.table, shown_cells), *left_out(self.table)]),
            "costs": [Choice(title(column), [figure]) for column, figure in costs if figure],
            **chart_content(self.rows, self.table.columns, methods, self._names),
            "charts": list(methods),
            "waters": self._waters(),
            "commands": [self._command(name) for name in methods],
            "data": self._data(),
        }

    @cached_property
    def _deciding(self) -> Deciding:
        return deciding(self.table)

    @property
    def _main(self) -> Column | None:
        return self._deciding.main

    @property
    def _columns(self) -> tuple[Column, ...]:
        """The columns that decide, then the others."""
        first = self._deciding.columns
        return (*first, *(column for column in self.table.columns if column not in first))

    # -- the table -------------------------------------------------------------------------------------------

    def _rows(self) -> list[Content]:
        """The table's rows: by the main score, the photograph below the methods."""
        table = replace(self.table, methods=best_first(self.table, self._main))
        columns = [cells(table, column) for column in self._columns]
        faults = {note.method: note.text for note in table.notes if note.kind == "faults"}
        return [
            {
                "label": name,
                "place": self.places[name],
                "photograph": name in table.photographs,
                "cells": of_method,
            }
            | {"faults": faults.get(name, "")}
            for name, *of_method in zip(table.methods, *columns, strict=True)
        ]

    def _rerun(self, name: str) -> Rerun:
        last = self.rows[self.rows["method"] == name].iloc[-1]
        return Rerun(
            self.table.title, name, json.loads(last["options"]), int(last["seed"]), self.plugins
        )

    def _command(self, name: str) -> Content:
        """The command that runs a method again, and its options."""
        rerun = self._rerun(name)
        words = shell(rerun.words())
        of_method = self.rows.loc[self.rows["method"] == name, "view"]
        views = sorted(set(of_method.unique()) - {""})
        # A line has room for few views.
        chosen = shell([f"views={value_of(views)}"]) if 0 < len(views) <= _MOST_NAMED else ""
        whole = " ".join(filter(None, [words, chosen, self._metric_words]))
        return {
            "label": name,
            "place": self.places[name],
            "command": whole if words else "",
            "options": rerun.method_record,
        }

    @cached_property
    def _metric_words(self) -> str:
        """The words that ask for all scores again."""
        scored = self.rows.loc[
            ~self.rows["metric"].isin(COSTS), ["metric", "variant"]
        ].drop_duplicates()
        variants = {
            name: list(of_metric["variant"])
            for name, of_metric in scored.groupby("metric", sort=False)
        }
        words = [
            word for name, names in variants.items() for word in metric_words(str(name), names)
        ]
        return shell([f"metrics={value_of(list(variants))}", *words]) if variants else ""

    # -- its views -------------------------------------------------------------------------------------------

    def _data(self) -> Content:
        """The views with pictures and scores, a result a method."""
        methods = [(name, self._rerun(name)) for name in self.table.methods]
        return {
            "name": self.table.title,
            "main": self._main.key if self._main else "",
            "first": next(iter(best_first(self.table, self._main)), ""),
            "photographs": list(self.table.photographs),
            "columns": [
                {"key": c.key} | {name: getattr(c, name) for name in _OF_COLUMN}
                for c in self._columns
            ],
            "methods": [
                {
                    "label": name,
                    "place": self.places[name],
                    "given": rerun.given(),
                    "command": shell(rerun.words()),
                }
                for name, rerun in methods
            ],
            "metrics": self._metric_words,
            "views": self._views,
        }

    @cached_property
    def _names(self) -> dict[tuple[str, str], str]:
        """What the page calls each view, by scene and view, in order."""
        names = (
            self.rows.loc[self.rows["view"] != "", _VIEW].drop_duplicates().sort_values(_VIEW)
        )
        pairs = names.itertuples(index=False, name=None)
        return {
            (scene, view): f"{scene} · {view}" if self._has_scenes else view
            for scene, view in pairs
        }

    @cached_property
    def _has_scenes(self) -> bool:
        return len(set(self.rows["scene"]) - {""}) > 1

    @cached_property
    def _views(self) -> list[Content]:
        """The views; of as many as may be, spread evenly, the page keeps the pictures."""
        restored = {
            (row.scene, row.view, row.method): row
            for row in tuples(restoration_rows(self.rows))
        }
        ok = self.rows[
            (self.rows["status"] == "ok") & ~self.rows["region"].str.contains("/", regex=False)
        ]
        by = [*_VIEW, "method", "metric", "variant"]
        means = ok.groupby(by, sort=False)[["value", "coverage"]].mean()  # of charts their mean
        scores: dict[Any, dict[str, tuple[float, float]]] = defaultdict(dict)
        for (*place_and_method, metric, variant), value, coverage in means.itertuples(
            name=None
        ):
            scores[tuple(place_and_method)][f"{metric}:{variant}"] = (value, coverage)
        share = self.gallery.share
        picture = self.gallery.picture
        made = []
        for n, ((scene, view), name) in enumerate(self._names.items()):
            kept = int((n + 1) * share) > int(n * share)
            place = layout.find(self.table.title, scene, view, self.out)
            results = [
                self._result(
                    place,
                    restored.get((scene, view, method)),
                    scores[scene, view, method],
                    kept,
                )
                for method in self.table.methods
            ]
            made.append(
                {
                    "name": name,
                    "words": shell([f"views={value_of([view])}"]),
                    "original": picture(place.original(self.out), kept) if place else None,
                    "reference": picture(place.reference(self.out), kept) if place else None,
                    "truth": next((r["truth"] for r in results if r.get("truth")), None),
                    "results": results,
                }
            )
        return made

    def _result(
        self,
        place: layout.Place | None,
        row: Any,
        scores: Mapping[str, tuple[float, float]],
        kept: bool,
    ) -> Content:
        """What the script reads of a method's restoration of a view. scores: by their key, each with its coverage."""
        if row is None or row.status != "ok":
            return (
                {"status": row.status, "reason": row.reason}
                if row
                else {"status": "not run", "reason": ""}
            )
        try:
            record = read_record(row, self.out)
        except InputError:  # damaged; the page shows the rest
            record = {}
        whole = {*metrics_of("coverage"), *COSTS}  # scores that ignore coverage
        partly = {
            key: share
            for key, (_, share) in scores.items()
            if share < 1 and key.partition(":")[0] not in whole
        }
        parameters = [record[name] for name in _WATER if isinstance(record.get(name), list)]
        has_water = any(
            isinstance(x, (int, float)) for parameter in parameters for x in parameter
        )
        shown = {
            k: v
            for k, v in record.items()
            if k not in (*_WATER, "encoding", "limits", "true_water", FILES)
        }
        path = place and place.restored(self.out, row.method)
        return {
            "status": "ok",
            "picture": self.gallery.picture(path, kept, row.coverage < 1) if path else None,
            "limits": [str(limit) for limit in limits]
            if isinstance(limits := record.get("limits"), list)
            else [],
            "coverage": row.coverage,
            "scores": {f"{FILLED}:image": row.coverage}
            | {key: value for key, (value, _) in scores.items()},
            "covers": partly,
            "water": {k: record.get(k) for k in (*_WATER, "encoding", "standard_error")}
            if has_water
            else None,
            "truth": record.get("true_water"),
            "record": {k: v for k, v in shown.items() if len(json.dumps(v)) <= _LONGEST_VALUE},
        }

    # -- their water -----------------------------------------------------------------------------------------

    def _waters(self) -> list[Choice]:
        """A choice for each method that estimates the water; the first has the numbers of all below."""
        names = self.table.methods
        views = self._views
        rows = []
        for view in views:
            waters = [view["truth"], *(result.get("water") for result in view["results"])]
            for name, water in zip(("true", *names), waters, strict=True):
                if water:
                    values = [
                        plots.of_water(water, key, c)
                        for key, *_ in PARAMETERS
                        for c in range(len(CHANNELS))
                    ]
                    encoding = water.get("encoding") or ""
                    rows.append(
                        {
                            "view": view["name"],
                            "method": name,
                            "values": values,
                            "encoding": encoding,
                        }
                    )
        estimating = [
            at
            for at in range(len(names))
            if any(view["results"][at].get("water") for view in views)
        ]
        return [
            Choice(names[at], plots.waters(views, at), rows if at == estimating[0] else None)
            for at in estimating
        ]
