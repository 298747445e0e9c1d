"""The notes of a comparison: what methods were trained on, lacking scores, pixels, faults of pictures."""

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame
from sucre_bench.compare.choose_rows import (
    among,
    metrics_of_faults,
    mixed_codes,
    options_of,
    scores_of_pixels,
)
from sucre_bench.compare.model import FILLED, METRICS, Column, Note, NoteKind, says_filled
from sucre_bench.compare.words import number
from sucre_bench.machine.text_formats import first_few
from sucre_bench.results.common_scores import LEAST_DIFFERENCE, filled_restorations
from sucre_bench.results.reasons import Reason, without_view
from sucre_bench.results.rows import COSTS, RESTORATION, restorations, values_of


@dataclass(frozen=True)
class About:
    """The methods of a dataset."""

    notes: tuple[Note, ...]
    """What each was trained on, which are this project's, and which changed between views."""

    photographs: Collection[str]
    """Those that return the photograph itself."""

    is_track: bool
    """Whether views lie along a track: views without poses have no order."""


def about(rows: DataFrame) -> About:
    """Return what is known of the methods of a dataset beside their scores. rows: with `_fresh`, see `is_fresh`."""
    notes = []
    photographs = []
    datasets = set[str]()
    for label, options in options_of(rows).items():
        datasets.add(options.get("dataset", {}).get("name", ""))
        if options.get("trained_on"):
            notes.append(Note(f"{label} was trained on: {options['trained_on']}", "trained on"))
        plugin = plugins.get("method", options.get("name", ""))
        if plugin and plugin.cites.startswith("by this project"):  # no published method
            notes.append(Note(f"{label}: {plugin.cites}"))
        if plugin and plugin.is_photograph:
            photographs.append(label)
    notes += map(Note, mixed_codes(rows[rows["_fresh"]]))
    known = [plugins.get("dataset", name) for name in datasets]
    is_track = any(plugin is None or "poses" in plugin.has for plugin in known)
    return About(tuple(notes), photographs, is_track)


_VIEW = ["scene", "view"]
REPETITION = [*_VIEW, "region", "_replicate"]


def notes(
    rows: DataFrame,
    repetitions: Mapping[Column, DataFrame],
    older: DataFrame,
) -> Iterator[Note]:
    """Yield what each method lacks that others have.

    rows: of the table, whatever became of them; repetitions: the scores of each column, by `REPETITION`, methods beside
    it, NaN = a hole; older: rows of the dataset on older data.
    """
    lost = rows[rows["status"] != "ok"]
    score = ("method", "metric", "variant", "scene", "view")
    known: dict[tuple[str, ...], str] = {}
    for status, reason, *key in values_of(lost, "status", "reason", *score):
        known[*key] = f"{status}: {without_view(reason, key[-1])}".rstrip(": ")
    stale = set(values_of(older, "method", *_VIEW))

    def why(method: str, column: Column, scene: str, view: str) -> str:
        """Why a method has no score of a view."""
        whole = (method, RESTORATION, "wall")
        own = (method, column.metric, column.variant, scene, view)
        if (method, scene, view) in stale and own not in known:
            return "of other data"
        # the last: the job failed as a whole
        keys = (own, (*whole, scene, view), (*whole, "", ""))
        return next((known[key] for key in keys if key in known), "not run")

    alike = defaultdict[str, list[Column]](list)
    scored = set[str]()
    for column, values in repetitions.items():
        if column.metric not in (*COSTS, FILLED):
            scored.update(values.columns)
        if column.n_scored == 0:
            text = f"{METRICS}: no {column.of} that {', '.join(values.columns)} all have"
            yield Note(text, columns=(column,))
        is_repeated = values.index.get_level_values("_replicate").nunique() > 1
        unit = "repetition" if is_repeated else column.of
        for name, is_hole in values.isna().items():
            holes = is_hole.index[is_hole]
            if len(holes) and column.metric not in COSTS:
                reasons = _counted(why(str(name), column, *place[:2]) for place in holes)
                alike[
                    f"{name} has no {METRICS} in {len(holes)} of {len(values)} {unit}s ({reasons}): "
                    f"all are compared on the {column.n_scored} {column.of}s that all have"
                ].append(column)
    for text, columns in alike.items():
        yield Note(text, columns=tuple(columns))
    of_scores = lost[lost["_asked"] | (lost["metric"] == RESTORATION)]
    for name, of_method in of_scores.groupby("method", sort=False):
        if name not in scored:
            causes = dict.fromkeys(map(": ".join, values_of(of_method, "status", "reason")))
            yield Note(f"{name} has no score ({first_few([*causes], 3)})")


def _counted(reasons: Iterable[str]) -> str:
    """Reasons with how often they hold: those of one kind together, by the commonest of them."""
    kinds = defaultdict[str, Counter[str]](Counter)
    for reason in sorted(reasons):
        kind, _, why = reason.partition(": ")
        kinds[kind][why] += 1
    parts = []
    for kind, whys in kinds.items():
        why = whys.most_common(1)[0][0] + (" and others" if len(whys) > 1 else "")
        parts.append(f"{whys.total()} {kind}: {why}".rstrip(": "))
    return "; ".join(parts)


# -- pixels ------------------------------------------------------------------------------------------------


def filled_rows(rows: DataFrame) -> DataFrame:
    """Return rows of the share of the image that methods fill, if pictures are ranked and one has holes.

    rows: of one table, with `_asked`. No rows if the metric of coverage is among them.
    """
    asked = rows[rows["_asked"]]
    whole = restorations(rows)
    has_holes = (whole["coverage"] < 1 - LEAST_DIFFERENCE).any()
    pairs = set(values_of(asked, "metric", "variant"))
    if (
        not has_holes
        or not scores_of_pixels(asked).any()
        or any(says_filled(*p) for p in pairs)
    ):
        return whole.iloc[:0]
    return whole.assign(
        metric=FILLED,
        variant="image",
        unit="share",
        better="none",
        region="image",
        value=whole["coverage"],
    )


def pixel_notes(rows: DataFrame, columns: Sequence[Column]) -> Iterator[Note]:
    """Yield on which pixels scores are that methods would have of different ones.

    rows: of one table, with `_asked` and the columns of `on_pixels`; columns: of the table.
    """
    scores = rows[rows["_asked"] & scores_of_pixels(rows)]
    total = len(scores[_VIEW].drop_duplicates())
    none = Reason.among(scores["reason"], Reason.NO_SHARED_PIXELS)
    # Scores on own pixels: with a reason, or of views of which methods fill shares that differ by much.
    filled = filled_restorations(rows).groupby(_VIEW)["coverage"]
    difference = filled.max() - filled.min()
    differing = difference.index[difference > LEAST_DIFFERENCE]
    is_differing = scores.set_index(_VIEW).index.isin(differing)
    is_own = (is_differing & (scores["pixels"] == "own")) | (scores["pixels_reason"] != "")
    common = scores[(scores["pixels"] == "common") & ~none]
    share = number(100 * common.drop_duplicates(_VIEW)["pixels_share"].mean())
    cases: list[tuple[DataFrame, NoteKind, str]] = [
        (
            common,
            "common pixels",
            f"on the pixels that all methods fill: {share} % of the image",
        )
    ]
    if none.any():
        n = len(scores.loc[none, _VIEW].drop_duplicates())
        yield Note(f"no score in {n} of {total} images: methods share no pixel")
    for reason, each in scores[is_own].groupby("pixels_reason", sort=False):
        why = f" ({reason})" if reason else ""
        cases.append((each, "own pixels", f"on each method's own pixels, which differ{why}"))
    for some, kind, text in cases:
        pairs = set(values_of(some, "metric", "variant"))
        named = tuple(column for column in columns if (column.metric, column.variant) in pairs)
        if named:  # a metric that lacks a reference, say, has none
            n = len(some[_VIEW].drop_duplicates())
            yield Note(f"{METRICS} in {n} of {total} images {text}", kind, columns=named)


# A method has a fault if more than this share of its views has it.
_FEW = 0.2


# -- faults, in the words that metrics declare for them (`plugins.Fault`) ----------------------------------


def fault_notes(rows: DataFrame) -> Iterator[Note]:
    """Yield a note for each method whose pictures have faults. rows: of one table."""
    metrics = metrics_of_faults(rows)
    scored = rows[(rows["status"] == "ok") & rows["metric"].isin(metrics)]
    said = defaultdict[str, list[str]](list)
    score = ["method", "metric", "variant"]
    for (method, metric, variant), values in scored.groupby(score, sort=False):
        fault = metrics[metric].get(variant)
        whole = values[values["region"] == "image"]
        if fault is None:
            continue
        bad = whole[whole["value"] > fault.limit]
        if len(bad) <= _FEW * len(whole):
            continue
        parts = values[among(values, bad, _VIEW) & (values["region"] != "image")]
        hue = "".join(parts["region"].str.removeprefix("image/").mode()[:1])
        words = fault.words.format(share=f"{100 * bad['value'].mean():.0f} %", hue=hue)
        if len(bad) < len(whole):
            words += f" in {len(bad)} of {len(whole)} views"
        said[method].append(words.strip())
    for method, faults in said.items():
        yield Note(", ".join(faults), "faults", method)
