"""Makes comparisons from rows: the units that all methods have, and a table for each dataset, view or region."""

import json
from collections.abc import Collection, Sequence
from dataclasses import replace

from sucre_bench import plugins, results
from sucre_bench.arrays import DataFrame, Series
from sucre_bench.compare import ranks
from sucre_bench.compare.choose_pixels import on_pixels
from sucre_bench.compare.missing_scores import filled_rows, notes, pixel_notes
from sucre_bench.compare.model import Cell, Column, Comparison, Note, says_filled
from sucre_bench.compare.ranks import column_of, measured_column, repetitions_of
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.results.reasons import Reason
from sucre_bench.results.rows import COSTS, RESTORATION, By, values_of
from sucre_bench.results.table import is_fresh

# Columns that nothing here looks at; they are most of a table's memory.
_UNUSED = frozenset({"options", "options_id", "n_pixels", "seconds", "peak_mb", "device", "seed", "code"})


def compare(
    rows: DataFrame, metrics: Sequence[str] = (), by: By = "method", order: Sequence[str] = (), baseline: str = ""
) -> list[Comparison]:
    """Return a table per dataset; by "view" or "region", a table for each of those.

    metrics: "name" or "name:variant", default all; order: of the methods, default as they were first run; baseline: a
    method to compare the others with, instead of with the best.
    Raises InputError for a metric or a baseline that the rows do not have.
    """
    asked, photographs = asked_for(rows, metrics), _photographs(rows)
    rows = rows[[name for name in rows.columns if name not in _UNUSED]]
    rows = rows.sort_values("time", kind="stable")  # datasets, methods and metrics as they were run
    order = list(dict.fromkeys([*order, *rows["method"].unique()]))
    if baseline and baseline not in order:
        raise InputError(f"no scores of '{baseline}' to compare with; {did_you_mean(baseline, order)}")
    rows = rows.assign(_fresh=is_fresh(rows), _asked=asked)
    if "pixels" not in rows:
        rows = on_pixels(rows, None)
    numbers = {name: results.unreplicated(name)[1] for name in rows["scene"].unique()}
    rows = without_replicates(rows.assign(_replicate=rows["scene"].map(numbers)))
    of_patch = rows["region"].str.contains("/", regex=False)
    rows = rows[~of_patch] if of_patch.any() else rows  # patches are inside their charts' scores
    groups = ["dataset"]
    if by != "method":
        rows = rows[rows["view"] != ""]
        several = rows.groupby("dataset")["scene"].nunique().max() > 1
        groups += ["scene", by] if several else [by]
    tables = []
    for key, of_table in rows.groupby(groups, sort=False):
        if by == "region":
            of_table = _with_reasons(of_table, rows[(rows[groups[:-1]] == list(key[:-1])).all(axis=1)])
        if of_table["_asked"].any():
            methods = sorted(of_table["method"].unique(), key=order.index)
            of_dataset = {name for dataset, name in photographs if dataset == key[0]}
            tables.append(_table(" · ".join(map(str, key)), of_table, methods, baseline, of_dataset))
    scored = [table for table in tables if table.columns]
    return scored if by != "method" and scored else tables  # of a region that some views lack


def against(comparison: Comparison, baseline: str, methods: Collection[str] = ()) -> Comparison:
    """Return the comparison with the differences of its methods, or of some of them, to a baseline among them.

    Nothing is resampled again: columns and intervals of means are those of `comparison`.
    """
    methods = tuple(name for name in comparison.methods if name in methods or not methods or name == baseline)
    cells: dict[tuple[str, Column], Cell] = {}
    for column, measured in comparison.measured.items():
        chosen = [m for m, name in enumerate(measured.methods) if name in methods]
        scores = measured.of(chosen)
        made = [comparison.cells[name, column] for name in scores.methods]
        if baseline in scores.methods:
            made = ranks.against(column, scores, made, scores.methods.index(baseline))
        cells |= {(name, column): cell for name, cell in zip(scores.methods, made, strict=True)}
    return replace(comparison, methods=methods, cells=cells, baseline=baseline)


def only(comparison: Comparison, metrics: Sequence[str]) -> Comparison:
    """Return the comparison with only the columns of these metrics, in their order; all of them if there are none.

    metrics: "name" or "name:variant".
    """

    def place(column: Column) -> int | None:
        names = (column.metric, f"{column.metric}:{column.variant}")
        if says_filled(column.metric, column.variant):
            return -1
        return next((n for n, metric in enumerate(metrics) if metric in names), None if metrics else 0)

    places = {column: n for column in comparison.columns if (n := place(column)) is not None}
    columns = tuple(sorted(places, key=places.__getitem__))
    notes = [replace(note, columns=tuple(c for c in note.columns if place(c) is not None)) for note in comparison.notes]
    return replace(
        comparison,
        columns=columns,
        cells={key: cell for key, cell in comparison.cells.items() if key[1] in places},
        measured={column: measured for column, measured in comparison.measured.items() if column in places},
        notes=tuple(new for new, old in zip(notes, comparison.notes, strict=True) if new.columns or not old.columns),
    )


def _with_reasons(region: DataFrame, everywhere: DataFrame) -> DataFrame:
    """A region's rows, and other rows with the reasons for missing scores: a failure concerns a whole image."""
    import pandas as pd

    elsewhere = everywhere.drop(region.index)
    has_reason = (elsewhere["metric"] == RESTORATION) | (elsewhere["status"] != "ok")
    scored = region["_asked"] & (region["status"] == "ok").any()
    return pd.concat([region.assign(_asked=scored), elsewhere[has_reason].assign(_asked=False)])


def asked_for(rows: DataFrame, metrics: Sequence[str]) -> Series:
    """Return which rows are of these metrics, "name" or "name:variant"; without metrics, all."""
    if not metrics:
        return rows["metric"].notna()
    full = rows["metric"] + ":" + rows["variant"]
    known = set(rows["metric"].unique())
    for text in metrics:
        name, _, variant = text.partition(":")
        if name not in known:
            raise InputError(f"no scores of '{name}'; {did_you_mean(name, known)}")
        variants = set(rows.loc[rows["metric"] == name, "variant"].unique())
        if variant and variant not in variants:
            raise InputError(f"no scores of {name} in variant '{variant}'; {did_you_mean(variant, variants)}")
    return rows["metric"].isin(metrics) | full.isin(metrics)


def without_replicates(rows: DataFrame) -> DataFrame:
    """Give the scenes of repetitions the name of what they repeat."""
    names = {name: results.unreplicated(name)[0] for name in rows["scene"].unique()}
    return rows.assign(scene=rows["scene"].map(names))


def _table(
    title: str, rows: DataFrame, methods: list[str], baseline: str, all_photographs: Collection[str]
) -> Comparison:
    import pandas as pd

    with_fresh = set(rows.loc[rows["_fresh"], "method"].unique())
    stale = tuple(name for name in methods if name not in with_fresh)
    methods = [name for name in methods if name in with_fresh]
    ok = rows[rows["_fresh"] & (rows["status"] == "ok") & rows["value"].notna()]
    of_colours = {name: plugin.needs for name, plugin in plugins.usable("metric").items() if plugin.knows_colours}
    knows = bool(ok["metric"].isin(of_colours).any())  # be it among the requested metrics or not
    is_lack = (rows["status"] == "skipped") & rows["reason"].str.startswith(Reason.LACK.value)
    lacks = frozenset[str]().union(*(of_colours.get(name, ()) for name in rows.loc[is_lack, "metric"].unique()))
    ok = ok[ok["_asked"]]
    if len(filled := filled_rows(rows)):
        ok = pd.concat([filled, ok])
    scores, repetitions = dict[Column, DataFrame](), dict[Column, DataFrame]()
    for _, of_column in ok.groupby(["metric", "variant"], sort=False):
        repeats = repetitions_of(of_column)
        column, values = column_of(of_column, repeats, knows)
        scores[column], repetitions[column] = values, repeats
    columns = sorted(scores, key=_order)
    found = [*pixel_notes(rows, columns), *notes(rows[rows["method"].isin(methods)], scores, repetitions, methods)]
    if stale:
        found.append(Note("older data", stale))
    if baseline and baseline not in methods:
        found.append(Note("no baseline", (baseline,)))
        baseline = ""
    measured = {column: measured_column(column, values) for column, values in scores.items() if column.n_units}
    photographs = tuple(name for name in methods if name in all_photographs)
    made = {
        (name, column): cell
        for column, of_column in measured.items()
        for name, cell in zip(of_column.methods, ranks.cells(column, of_column, photographs), strict=True)
    }
    has_none = lacks >= {"reference", "charts"}
    table = Comparison(
        title, tuple(methods), tuple(columns), made, stale, "", tuple(found), measured, photographs, has_none
    )
    return against(table, baseline) if baseline else table


def _photographs(rows: DataFrame) -> set[tuple[str, str]]:
    """The methods that return the photograph itself, each with its dataset."""
    known, columns = plugins.usable("method"), ["dataset", "method", "options"]
    each = rows[columns].drop_duplicates(columns[:2], keep="last")
    plugin_of = {(d, m): known.get(json.loads(options).get("name", "")) for d, m, options in values_of(each, *columns)}
    return {of for of, plugin in plugin_of.items() if plugin and plugin.is_photograph}


def _order(column: Column) -> tuple[bool, bool, bool]:
    """The share that methods fill comes first; what only describes and costs come last; else as they were run."""
    return not says_filled(column.metric, column.variant), column.better == "none", column.metric in COSTS
