"""Says over how many views the scores are, and that intervals over few views are rough."""

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence

from sucre_bench.compare.choose_pixels import says_filled
from sucre_bench.compare.model import FEWEST_VIEWS, Column, Comparison
from sucre_bench.machine.text_formats import counted

_ROUGH = "intervals are rough"


def rough_below() -> str:
    """Return below how many views intervals are rough, and why; it follows a sentence about intervals."""
    return f"over fewer than {FEWEST_VIEWS} views they are rough: so few scores do not show how scores are distributed"


def rough(columns: Sequence[Column]) -> str:
    """Return what says which scores are over too few views for more than rough intervals; "" where none is."""
    counts = _counts(columns)
    few = [(names, alike) for names, alike in counts if alike[0].has_few_views]
    if len(counts) == 1 and few:
        return f"{_views(few[0][1][0])}: {_interval_of_few(few[0][1][0])}"
    return "; ".join(f"{names}: over {_views(alike[0])}, {_interval_of_few(alike[0])}" for names, alike in few)


def over_views(columns: Sequence[Column]) -> list[str]:
    """Return over how many views the scores are: most views first, then the scores that have fewer, by name."""
    (_, first), *others = _counts(columns) or [("", list(columns[:1]))]
    if not first:
        return []
    if first[0].has_few_views and not others:
        hint = ", --intervals shows them" if first[0].n_views > 1 else ""
        return [f"{rough(columns)}{hint}"]
    fewer = [
        f"{names}: over {_views(alike[0])}" + (f", {_interval_of_few(alike[0])}" if alike[0].has_few_views else "")
        for names, alike in others
    ]
    return [f"means over {_views(first[0])}", *fewer]


def over_datasets(mains: Sequence[Column]) -> list[str]:
    """Return over how many views the main score of several datasets is."""
    views = [column.n_views for column in mains]
    few = sum(column.has_few_views for column in mains)
    if min(views) == max(views):
        return over_views(mains[:1])
    rough_in = f"in {few} datasets over fewer than {FEWEST_VIEWS}, where {_ROUGH}"
    return [f"means over {min(views)} to {max(views)} views", *([rough_in] if few else [])]


def over_units(comparison: Comparison) -> Iterator[str]:
    """Yield over how many views: of most metrics, then of those that differ."""
    counts = Counter(_count(column) for column in comparison.columns if column.n_units)
    for place, (count, _) in enumerate(counts.most_common()):
        names = [column.metric for column in comparison.columns if _count(column) == count]
        of = "over " if place == 0 else f"{', '.join(dict.fromkeys(names))} over "
        yield of + count


def _counts(columns: Sequence[Column]) -> list[tuple[str, list[Column]]]:
    """The scores with the same number of views, and their names; the largest number first."""
    measured = [column for column in columns if column.n_units]
    scores = [column for column in measured if column.ranked and not says_filled(column.metric, column.variant)]
    scores = sorted(scores or measured, key=lambda column: -column.n_views)
    groups = [list(alike) for _, alike in itertools.groupby(scores, lambda column: column.n_views)]
    return [(", ".join(dict.fromkeys(column.metric for column in alike)), alike) for alike in groups]


def _views(column: Column) -> str:
    return counted(column.n_views, "view")


def _interval_of_few(column: Column) -> str:
    return "no intervals" if column.n_views < 2 else _ROUGH


def _count(column: Column) -> str:
    scenes = f" of {column.n_scenes} scenes" if column.n_scenes > 1 else ""
    charts = f" ({counted(column.n_units, 'chart')})" if column.of == "chart" else ""
    return _views(column) + scenes + charts
