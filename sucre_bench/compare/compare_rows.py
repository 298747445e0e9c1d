"""Makes comparisons from rows: the units that all methods have, and a table for each dataset, view or region."""

import itertools
import math
from collections import Counter
from collections.abc import Collection, Hashable, Sequence
from dataclasses import replace

import numpy as np

from sucre_bench.arrays import DataFrame
from sucre_bench.compare import statistics
from sucre_bench.compare.choose_rows import (
    OWN_PIXELS,
    Pixels,
    asked_for,
    leaves_holes,
    without_replicates,
)
from sucre_bench.compare.model import FILLED, Cell, Column, Comparison, Note, plugin_of
from sucre_bench.compare.notes import (
    REPETITION,
    About,
    about,
    fault_notes,
    filled_rows,
    notes,
    pixel_notes,
)
from sucre_bench.compare.statistics import ColumnScores, Units
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.machine.text_formats import natural_order
from sucre_bench.results.rows import COSTS, PREFERENCE, RESTORATION, By, values_of
from sucre_bench.results.table import is_fresh

# Columns that nothing here looks at; they are most of a table's memory.
_UNUSED = ["options", "options_id", "n_pixels", "seconds", "peak_mb", "device", "seed", "code"]
_UNIT, _COLUMN = ["scene", "view", "region"], ["metric", "variant"]

# A column, and its values before and after repetitions are averaged.
_Measured = tuple[Column, DataFrame, DataFrame]


def compare(
    rows: DataFrame,
    metrics: Sequence[str] = (),
    by: By = "method",
    order: Sequence[str] = (),
    baseline: str = "",
) -> list[Comparison]:
    """Return a table per dataset; by "view" or "region", a table for each of those.

    metrics: "name" or "name:variant", default all; order: of the methods, default as they were first run; baseline: a
    method to compare the others with, instead of with the best.
    Raises InputError for a metric or a baseline that the rows do not have.
    """
    rows = rows.assign(_asked=asked_for(rows, metrics), _fresh=is_fresh(rows))
    known = {dataset: about(each) for dataset, each in rows.groupby("dataset")}
    # datasets, methods and metrics as they were run
    rows = rows.drop(columns=_UNUSED, errors="ignore").sort_values("time", kind="stable")
    order = list(dict.fromkeys([*order, *rows["method"].unique()]))
    if baseline and baseline not in order:
        raise InputError(
            f"no scores of '{baseline}' to compare with; {did_you_mean(baseline, order)}"
        )
    older = rows[~rows["_fresh"]]
    rows = without_replicates(rows[rows["_fresh"]])
    if "pixels" not in rows:
        rows = rows.assign(**OWN_PIXELS)
    groups = ["dataset"]
    if by != "method":
        rows = rows[rows["view"] != ""]
        several = rows.groupby("dataset")["scene"].nunique().max() > 1
        groups += ["scene", by] if several else [by]
    if by == "region":
        rows = rows[~rows["region"].str.contains("/", regex=False)]
    measured = _by_table(rows, groups)
    tables = []
    for key, of_table in rows.groupby(groups, sort=False):
        if by == "region":
            of_table = _with_reasons(
                of_table, rows[(rows[groups[:-1]] == list(key[:-1])).all(axis=1)]
            )
        if not of_table["_asked"].any():
            continue
        methods = sorted(of_table["method"].unique(), key=order.index)
        of_dataset = older[older["dataset"] == key[0]]
        table = _table(of_table, methods, known[key[0]], measured.get(key, []), of_dataset)
        table = replace(table, title=" · ".join(map(str, key)))
        scored = {name for one in table.columns for name in (one.metric, one.key)}
        if scored:
            lacking = [Note(f"{name} has no score") for name in metrics if name not in scored]
            table = replace(table, notes=(*table.notes, *lacking))
        if baseline in methods:
            table = against(table, baseline)
        elif baseline:
            text = f"{baseline} was not run here: there is nothing to compare with"
            table = replace(table, notes=(Note(text), *table.notes))
        tables.append(table)
    filled = [table for table in tables if table.columns]
    return filled if by != "method" and filled else tables  # of a region that some views lack


def against(comparison: Comparison, baseline: str, methods: Collection[str] = ()) -> Comparison:
    """Return the comparison with the differences of its methods, or of some of them, to a baseline among them.

    Nothing is resampled again: columns and intervals of means are those of `comparison`.
    """
    methods = tuple(
        name
        for name in comparison.methods
        if name in methods or not methods or name == baseline
    )
    cells: dict[tuple[str, Column], Cell] = {}
    for column in comparison.columns:
        measured = comparison.measured.get(column)
        if measured is None:
            continue
        scores = measured.of([m for m, name in enumerate(measured.methods) if name in methods])
        made = [comparison.cells[name, column] for name in scores.methods]
        if baseline in scores.methods:
            number = scores.methods.index(baseline)
            made = statistics.against(column, scores, made, number, comparison.photographs)
        cells |= {(name, column): cell for name, cell in zip(scores.methods, made, strict=True)}
    return replace(comparison, methods=methods, cells=cells, baseline=baseline)


def only(comparison: Comparison, metrics: Sequence[str]) -> Comparison:
    """Return the comparison with only the columns of these metrics, in their order; all of them if there are none.

    metrics: "name" or "name:variant". The share that methods fill stays, and comes first.
    """
    places: dict[Column, int] = {}
    for column in comparison.columns:
        names = (column.metric, column.key)
        found = [n for n, metric in enumerate(metrics) if metric in names]
        if column.is_share_filled:
            places[column] = -1
        elif found or not metrics:
            places[column] = min(found, default=0)
    return comparison.with_columns(sorted(places, key=places.__getitem__))


def _with_reasons(region: DataFrame, everywhere: DataFrame) -> DataFrame:
    """A region's rows, and other rows with the reasons for missing scores: a failure concerns a whole image."""
    import pandas as pd

    elsewhere = everywhere.drop(region.index)
    has_reason = (elsewhere["metric"] == RESTORATION) | (elsewhere["status"] != "ok")
    scored = region["_asked"] & (region["status"] == "ok").any()
    return pd.concat([region.assign(_asked=scored), elsewhere[has_reason].assign(_asked=False)])


def _table(
    rows: DataFrame,
    methods: list[str],
    known: About,
    found: list[_Measured],
    older: DataFrame,
) -> Comparison:
    """One table. found: its columns; older: rows of the dataset on older data."""
    noted = list[Note]()
    if leaves_holes(rows):  # else all methods fill the same pixels
        filled = filled_rows(rows).assign(_one=0, _asked=True)
        found = [*_by_table(filled, ["_one"]).get((0,), ()), *found]
        noted += pixel_notes(rows, [column for column, *_ in found])
    photographs = tuple(name for name in methods if name in known.photographs)
    measured: dict[Column, ColumnScores] = {}
    cells: dict[tuple[str, Column], Cell] = {}
    for column, _, values in found:
        if column.n_scored:
            scores = _scores(column, values.dropna(), known.is_track)
            holes = values.isna().to_numpy().sum(axis=0)
            of_column = statistics.cells(column, scores, holes, photographs)
            measured[column] = scores
            cells |= {
                (name, column): cell
                for name, cell in zip(scores.methods, of_column, strict=True)
            }
    # The share that methods fill comes first; what describes, costs and taste come last; else as they were run.
    columns = sorted(
        (column for column, *_ in found),
        key=lambda column: (
            not column.is_share_filled,
            column.knows == "taste",
            column.better == "none",
            column.metric in COSTS,
        ),
    )
    noted += notes(rows, {column: repeated for column, repeated, _ in found}, older)
    left = [name for name in older["method"].unique() if name not in methods]
    if left:
        noted.append(Note(f"left out, because they ran on other data: {', '.join(left)}"))
    noted += [
        Note(f"{column.metric}: not registered here, so nobody wins by it; add --plugin FILE")
        for column in columns
        if column.is_unknown
    ]
    return Comparison(
        "",
        tuple(methods),
        tuple(columns),
        cells,
        notes=(*noted, *known.notes, *fault_notes(rows)),
        measured=measured,
        photographs=photographs,
    )


def _by_table(
    rows: DataFrame, groups: list[str]
) -> dict[tuple[Hashable, ...], list[_Measured]]:
    """Return the columns of each table with scores, in the order of rows, in one pass over all tables.

    groups: columns that tell tables apart. The scores are units x methods, sorted, with `REPETITION` in the index and
    NaN for a hole.
    """
    ok = rows[rows["_asked"] & (rows["status"] == "ok") & rows["value"].notna()]
    # names of faults; and patches, which are inside their charts' scores
    ok = ok[~ok["region"].str.contains("/", regex=False)]
    if ok.empty:
        return {}
    of_column = [*groups, *_COLUMN]
    on_common = {*values_of(ok[ok["pixels"] == "common"], *of_column)}
    keys = [*dict.fromkeys([*of_column, *REPETITION])]
    # sums do not depend on rows' order
    in_order = ok[[*keys, "method", "value"]].sort_values("value", kind="stable")
    every = in_order.groupby([*keys, "method"])["value"].mean().unstack("method")
    places = every.index.to_frame(index=False).groupby(of_column).indices
    scores = every.droplevel([name for name in keys if name not in REPETITION]).reorder_levels(
        REPETITION
    )
    tables: dict[tuple[Hashable, ...], list[_Measured]] = {}
    firsts = values_of(ok.drop_duplicates(of_column), *of_column, "unit", "better")
    for *key, metric, variant, unit, better in firsts:
        names = (*key, metric, variant)
        pixels: Pixels = "common" if names in on_common else "own"
        column = _column(metric, variant, unit, better, pixels, scores.iloc[places[names]])
        tables.setdefault(tuple(key), []).append(column)
    return tables


def _column(
    metric: str, variant: str, unit: str, better: str, pixels: Pixels, repeated: DataFrame
) -> _Measured:
    """Return a column of these scores.

    Values are units x methods, both sorted, NaN = a hole. Of a unit without any repetition that all methods have,
    methods that lack one have a hole.
    """
    if (lacking := repeated.isna().to_numpy()).any():
        repeated = repeated.loc[:, ~lacking.all(axis=0)]
    values = repeated.droplevel("_replicate")
    if not values.index.is_unique:  # means over the repetitions that all methods have
        holes = repeated.isna()
        shared = repeated[~holes.any(axis=1)].groupby(level=_UNIT).mean()
        means = repeated.groupby(level=_UNIT).mean().mask(holes.groupby(level=_UNIT).any())
        values = shared.reindex(means.index).fillna(means)
    units = values.index.tolist()
    is_whole = ~np.isnan(values.to_numpy()).any(axis=1)
    left = list(itertools.compress(units, is_whole))
    plugin = plugin_of(metric)
    if plugin:
        bounds = plugin.range
        knows = plugin.knows(variant)
        better = "none" if variant in plugin.unranked else better
    else:
        bounds = (
            0 if metric in (*COSTS, FILLED) else -math.inf,
            1 if metric == FILLED else math.inf,
        )
        knows = "truth" if metric in (*COSTS, FILLED, PREFERENCE) else "taste"
    column = Column(
        metric=metric,
        variant=variant,
        unit=unit,
        better=better,
        range=bounds,
        of="image" if all(region == "image" for *_, region in units) else "chart",
        n_scored=len(left),
        n_views=len({(scene, view) for scene, view, _ in left}),
        n_scenes=len({scene for scene, *_ in left}),
        pixels=pixels,
        knows=knows,
    )
    return column, repeated, values


def _scores(column: Column, complete: DataFrame, is_track: bool) -> ColumnScores:
    """The numbers of a column. complete: units x methods, both sorted, without holes; is_track: of their views."""
    per_view = (
        complete
        if column.n_views == len(complete)
        else complete.groupby(level=_UNIT[:2]).mean()
    )
    # neighbours of a track stand side by side
    names = [(scene, natural_order(view)) for scene, view, *_ in per_view.index]
    per_view = per_view.iloc[sorted(range(len(names)), key=names.__getitem__)]
    places = [(scene, view) for scene, view, *_ in per_view.index]
    views = per_view.to_numpy()
    scenes = [*Counter(scene for scene, _ in places).values()]
    is_of_pairs = len(scenes) == 1 and column.plugin is not None and column.plugin.is_of_pairs
    units = None
    if column.metric != FILLED and len(views) > (2 if is_of_pairs else 1):
        # Pseudo-values hold what neighbours that are paired have in common.
        units = Units.of(
            statistics.pseudo_values(views) if is_of_pairs else views,
            scenes,
            is_track and not is_of_pairs,
        )
    return ColumnScores(tuple(map(str, complete.columns)), tuple(places), views, units)
