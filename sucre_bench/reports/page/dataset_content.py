"""The page's data of a dataset, as plain values: its table, its views with their pictures, its charts."""

import json
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from sucre_bench.arrays import DataFrame
from sucre_bench.compare import COSTS, Column, Comparison, Verdict, verdicts
from sucre_bench.compare.answer import answer
from sucre_bench.compare.choose_pixels import FILLED
from sucre_bench.compare.decisive_columns import Deciding, deciding
from sucre_bench.compare.documents import Format, as_text
from sucre_bench.compare.view_counts import rough
from sucre_bench.compare.words import left_out, legend, shown
from sucre_bench.errors import InputError
from sucre_bench.jobs.words import Rerun, metric_words, shell, value_of
from sucre_bench.reports.metric_roles import metrics_of
from sucre_bench.reports.page.gallery import Gallery
from sucre_bench.results import layout
from sucre_bench.results.restorations import FILES, read_record
from sucre_bench.results.rows import restoration_rows, tuples

_WATER = ("B", "beta", "gamma")
_LONGEST_VALUE = 600  # characters of a value in a method's record
_MOST_NAMED = 100  # views in one command
_VIEW = ["scene", "view"]
_EXPORTS: tuple[tuple[str, Format], ...] = (("LaTeX", "latex"), ("Markdown", "md"), ("CSV", "csv"))


def key_of(metric: str, variant: str) -> str:
    """The name of a score on the page, and in links to it."""
    return f"{metric}:{variant}"


def column_of(column: Column) -> dict[str, Any]:
    """A column of a table.

    cost: it is shown, but nobody wins by it; directed, ranked, pixels: see `Column`.
    """
    return {
        "key": key_of(column.metric, column.variant),
        "metric": column.metric,
        "variant": column.variant,
        "unit": column.unit,
        "better": column.better,
        "ranked": column.ranked,
        "directed": column.directed,
        "of": column.of,
        "n": column.n_units,
        "views": column.n_views,
        "cost": column.metric in (*COSTS, FILLED),
        "pixels": column.pixels,
    }


def cell_of(table: Comparison, name: str, column: Column) -> dict[str, Any] | None:
    """A cell of a table with the marks that every table gives it."""
    cell, marks = table.cells.get((name, column)), shown(table, name, column)
    if cell is None:
        return None
    numbers = {"mean": cell.mean, "std": cell.std, "low": cell.low, "high": cell.high}
    return {**numbers, "holes": cell.holes, "tie": bool(marks.mark), "look": marks.look}


def _verdict(verdict: Verdict) -> dict[str, Any]:
    return {**vars(verdict), "column": key_of(verdict.column.metric, verdict.column.variant)}


@dataclass(frozen=True)
class Section:
    """A dataset on the page.

    out: the run's folder; rows: all of the dataset's; table: of its methods; plugins: files they were loaded from.
    """

    out: Path
    rows: DataFrame
    table: Comparison
    gallery: Gallery
    plugins: tuple[str, ...]

    def content(self) -> dict[str, Any]:
        """Return everything that the page shows of the dataset."""
        values, charts, few = self._values(), self._charts(), rough(self._deciding.columns)
        enough = any(column.n_units and not column.has_few_views for column in self.table.columns)
        views = [self._view(*place, values, charts) for place in self._chosen()]
        return {
            "name": self.table.title,
            "scene": "" if self._has_scenes else next(iter({*self.rows["scene"]} - {""}), ""),
            "legend": legend(self.table, intervals=enough),
            "answer": answer(self.table, self._deciding),
            "few": few,
            "main": key_of(main.metric, main.variant) if (main := self._deciding.main) else "",
            "photographs": list(self.table.photographs),
            "notes": list(left_out(self.table)),
            "verdicts": [_verdict(verdict) for verdict in verdicts(self.table)],
            "columns": [column_of(c) for c in self._columns],
            "methods": [self._method(name) for name in self.table.methods],
            "cells": [[cell_of(self.table, name, c) for c in self._columns] for name in self.table.methods],
            "metric_words": self._metric_words(),
            "views": views,
            "exports": [{"name": name, "text": as_text([self.table], how)} for name, how in _EXPORTS],
        }

    @cached_property
    def _deciding(self) -> Deciding:
        return deciding(self.table)

    @property
    def _columns(self) -> tuple[Column, ...]:
        """The columns that decide, then the others."""
        first = self._deciding.columns
        return (*first, *(column for column in self.table.columns if column not in first))

    # -- the table -------------------------------------------------------------------------------------------

    def _method(self, name: str) -> dict[str, Any]:
        of_method = self.rows[self.rows["method"] == name]
        last = of_method.iloc[-1]
        command = Rerun(self.table.title, name, json.loads(last["options"]), int(last["seed"]), self.plugins)
        return {
            "label": name,
            "options": command.method_record,
            "given": command.given(),
            "command": shell(command.words()),
            "views": self._view_words(of_method),
            "code": last["code"].split(".")[0],
        }

    @staticmethod
    def _view_words(of_method: DataFrame) -> str:
        """The words that ask for a method's views again; none for more than a command line has room for."""
        views = sorted(set(of_method["view"].unique()) - {""})
        return shell([f"views={value_of(views)}"]) if 0 < len(views) <= _MOST_NAMED else ""

    def _metric_words(self) -> dict[str, str]:
        """The words that ask for a score again, and under "" those for all of them."""
        variants: dict[str, list[str]] = defaultdict(list)
        scored = self.rows.loc[~self.rows["metric"].isin(COSTS), ["metric", "variant"]].drop_duplicates()
        for name, variant in scored.itertuples(index=False, name=None):
            variants[name].append(variant)
        words = {name: metric_words(name, names) for name, names in variants.items()}
        everything = [f"metrics={value_of(list(words))}", *(word for names in words.values() for word in names)]
        single = {
            key_of(name, variant): shell([f"metrics={value_of([name])}", *metric_words(name, [variant])])
            for name, names in variants.items()
            for variant in names
        }
        return {**single, "": shell(everything) if words else ""}

    # -- its views -------------------------------------------------------------------------------------------

    def _chosen(self) -> list[tuple[str, str, bool]]:
        """Every view, and whether the page keeps its pictures: as many as may be, spread evenly."""
        names = self.rows.loc[self.rows["view"] != "", _VIEW].drop_duplicates().sort_values(_VIEW)
        share, views = self.gallery.share, names.itertuples(index=False, name=None)
        return [(scene, view, int((n + 1) * share) > int(n * share)) for n, (scene, view) in enumerate(views)]

    def _values(self) -> Mapping[tuple[str, str], Mapping[str, Mapping[str, tuple[float, float]]]]:
        """Of each view and method, each score and its coverage: of charts their mean."""
        ok = self.rows[(self.rows["status"] == "ok") & ~self.rows["region"].str.contains("/", regex=False)]
        by = [*_VIEW, "method", "metric", "variant"]
        means = ok.groupby(by, sort=False)[["value", "coverage"]].mean()
        made: dict[tuple[str, str], dict[str, dict[str, tuple[float, float]]]] = defaultdict(lambda: defaultdict(dict))
        for (scene, view, method, metric, variant), *score in means.itertuples(name=None):
            made[scene, view][method][key_of(metric, variant)] = (score[0], score[1])
        return made

    def _view(self, scene: str, view: str, kept: bool, values: Any, charts: Any) -> dict[str, Any]:
        place = layout.find(self.table.title, scene, view, self.out)
        whole = self._restorations.get((scene, view), {})
        results = [
            self._result(place, whole.get(name), values.get((scene, view), {}).get(name, {}), kept, name)
            for name in self.table.methods
        ]
        return {
            "name": f"{scene} · {view}" if self._has_scenes else view,
            "words": shell([f"views={value_of([view])}"]),
            "original": self.gallery.picture(place.original(self.out), kept) if place else None,
            "reference": self.gallery.picture(place.reference(self.out), kept) if place else None,
            "truth": next((r["truth"] for r in results if r.get("truth")), None),
            "results": results,
            "charts": charts.get((scene, view), {}),
        }

    @cached_property
    def _has_scenes(self) -> bool:
        return len(set(self.rows["scene"]) - {""}) > 1

    @cached_property
    def _restorations(self) -> dict[tuple[str, str], dict[str, Any]]:
        made: dict[tuple[str, str], dict[str, Any]] = defaultdict(dict)
        for row in tuples(restoration_rows(self.rows)):
            made[row.scene, row.view][row.method] = row
        return made

    def _result(
        self, place: layout.Place | None, row: Any, scores: Mapping[str, tuple[float, float]], kept: bool, name: str
    ) -> dict[str, Any]:
        if row is None:
            return {"status": "not run", "reason": ""}
        if row.status != "ok":
            return {"status": row.status, "reason": row.reason}
        record = _record(row, self.out)
        mask = place.mask(self.out, name) if place and row.coverage < 1 else None
        whole = {*metrics_of("coverage"), *COSTS}  # scores that ignore coverage
        return {
            "status": "ok",
            "picture": self.gallery.picture(place.restored(self.out, name), kept, mask) if place else None,
            "coverage": row.coverage,
            "device": row.device,
            "scores": {key_of(FILLED, "image"): row.coverage} | {key: value for key, (value, _) in scores.items()},
            "covers": {
                key: share for key, (_, share) in scores.items() if share < 1 and key.partition(":")[0] not in whole
            },
            "water": {k: record.get(k) for k in (*_WATER, "encoding", "standard_error")}
            if _has_water(record)
            else None,
            "truth": record.get("true_water"),
            "record": {
                k: v
                for k, v in record.items()
                if k not in (*_WATER, "encoding", "true_water", FILES) and len(json.dumps(v)) <= _LONGEST_VALUE
            },
        }

    # -- its charts ------------------------------------------------------------------------------------------

    def _charts(self) -> Mapping[tuple[str, str], Mapping[str, Any]]:
        """Of each view and chart, each score and those of its patches, a value a method (None: a hole)."""
        place = {name: n for n, name in enumerate(self.table.methods)}
        ok = self.rows[(self.rows["status"] == "ok") & self.rows["method"].isin(place)]
        of_charts = ok[(ok["region"] != "image") & ~ok["region"].str.startswith("image/")]
        made: dict[tuple[str, str], dict[str, Any]] = defaultdict(dict)
        columns = ["scene", "view", "region", "metric", "variant", "method", "value"]
        for scene, view, region, metric, variant, method, value in of_charts[columns].itertuples(
            index=False, name=None
        ):
            chart, _, patch = region.partition("/")
            of_chart = made[scene, view].setdefault(chart, {"scores": {}, "patches": {}})
            scores = of_chart["patches"].setdefault(patch, {}) if patch else of_chart["scores"]
            scores.setdefault(key_of(metric, variant), [None] * len(place))[place[method]] = value
        return made


def _record(row: Any, out: Path) -> Mapping[str, Any]:
    """A method's record of its work; empty if the file is damaged, so that the page shows the rest."""
    try:
        record = read_record(row, out)
    except InputError:
        return {}
    return record if isinstance(record, dict) else {}


def _has_water(record: Mapping[str, Any]) -> bool:
    values = [value for name in _WATER if isinstance(value := record.get(name), list)]
    return any(isinstance(x, (int, float)) for value in values for x in value)
