"""Reads the score tables of several folders, and refuses those that are not comparable."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import TypeVar

from sucre_bench import results
from sucre_bench.arrays import DataFrame
from sucre_bench.compare.about_methods import options_of
from sucre_bench.compare.compare_rows import asked_for
from sucre_bench.errors import InputError, LinesError
from sucre_bench.loading.named_sets import named_sets
from sucre_bench.machine import progress
from sucre_bench.results.bundle_format import is_bundle, open_bundle
from sucre_bench.results.rows import COSTS, values_of
from sucre_bench.results.table import is_fresh

_SCORE = ["dataset", "method", "metric", "variant", "scene", "view", "region"]  # what names a score
_SAME = 1e-6  # relative difference of one score on two machines


def load(folders: Iterable[str | Path]) -> DataFrame:
    """Read the tables of several output folders as one; of a score that several hold, the newest that is ok.

    Says with `progress.say` where folders have different values. A folder may be a bundle (.zip), too.
    Raises InputError when a folder has none, when folders mean different options or code by one method, or hold results
    on different data.
    """
    import pandas as pd

    folders = [Path(f) for f in folders]
    rows = pd.concat([_rows(Path(f)).assign(_folder=str(f)) for f in folders], ignore_index=True)
    if len(folders) > 1:
        coded = rows.assign(_code=rows["code"].str.split(".").str[0])
        of_method, of_scene = ["dataset", "method"], ["dataset", "scene"]
        for group, column, fault in (
            (of_scene, "data_id", "the data differ between these runs"),
            (of_method, "options_id", "these folders mean different options by it"),
            (of_method, "_code", "these folders hold it from different versions of its code"),
        ):
            several = (coded if group is of_method else rows[rows["scene"] != ""]).groupby(group)[column].nunique()
            if (several > 1).any():
                names = " / ".join(several[several > 1].index[0])
                raise InputError(f"{names}: {fault}; run it again, or give it another label")
        _say_differing(rows)
    rows = rows.assign(_ok=rows["status"] == "ok").sort_values(["_ok", "time"], kind="stable")
    return rows.drop_duplicates(_SCORE, keep="last").drop(columns=["_ok", "_folder"]).sort_index(ignore_index=True)


def _say_differing(rows: DataFrame) -> None:
    """Say that folders have other values of the same scores, of which the newest are taken."""
    scores = rows[(rows["status"] == "ok") & ~rows["metric"].isin(COSTS)]
    twice = scores[scores.duplicated(_SCORE, keep=False)]
    of_score = twice.groupby(_SCORE)["value"]
    low, high = of_score.min(), of_score.max()
    differing = low.index[high - low > _SAME * high.abs().combine(low.abs(), max)]
    if not len(differing):
        return
    disagreeing = twice[twice.set_index(_SCORE).index.isin(differing)]
    shown = disagreeing.sort_values("time", kind="stable").drop_duplicates(_SCORE, keep="last")["_folder"]
    methods = [
        " / ".join(pair) for pair in dict.fromkeys(zip(disagreeing["dataset"], disagreeing["method"], strict=True))
    ]
    more = f" and {len(methods) - 3} more" if len(methods) > 3 else ""
    progress.say(
        f"{names_of(list(dict.fromkeys(disagreeing['_folder'])))} share {len(of_score)} scores, and have different "
        f"values of {len(differing)} of them ({', '.join(methods[:3])}{more}); "
        f"the table shows the newest, from {names_of(list(dict.fromkeys(shown)))}. "
        "Run one with another label to see both"
    )


def _rows(place: Path) -> DataFrame:
    """The score table of an output folder, or of a bundle; `verify` checks what a bundle says."""
    if not is_bundle(place):
        return results.read(place)
    with open_bundle(place) as bundle:
        return bundle.rows


def names_of(names: Sequence[str]) -> str:
    """Return names as words: "a, b and c"."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


T = TypeVar("T")


class NotComparableError(LinesError, InputError):
    """Methods cannot be compared: a line a reason."""


def refuse(rows: DataFrame, metrics: Sequence[str] = (), common: bool = False) -> None:
    """Raise NotComparableError, a line a reason, where methods cannot be compared. Arguments as for `refusals`."""
    if lines := [f"{dataset}: {reason}" for dataset, reason in refusals(rows, metrics, common)]:
        raise NotComparableError("\n".join(lines))


def refusals(rows: DataFrame, metrics: Sequence[str] = (), common: bool = False) -> Iterator[tuple[str, str]]:
    """Yield a dataset and why its methods cannot be compared: the difference, and what to do.

    metrics: those to be compared, as in `compare`; common: methods may have run on different images or replicates, as
    long as they share some.
    """
    asked = asked_for(rows, metrics)
    fresh = is_fresh(rows)
    for dataset, of_dataset in rows[fresh].groupby("dataset", sort=False):
        scored = of_dataset[asked[of_dataset.index] & ~of_dataset["metric"].isin(COSTS)]
        ok = scored[scored["status"] == "ok"]
        scenes = {results.unreplicated(scene)[0] for scene in of_dataset["scene"].unique()}
        if len(scenes) > 1 and len(sets := sorted(scenes & set(named_sets()))) > 1:
            remedy = "run each again with a dataset.label of its own, or compare folders of one set"
            yield str(dataset), f"rows are of the test sets {names_of(sets)}; {remedy}"
        reasons = (*_images(of_dataset, common), *_variants(scored), *_versions(ok), *_normalisations(of_dataset))
        yield from ((str(dataset), reason) for reason in reasons)


def _images(rows: DataFrame, common: bool) -> Iterator[str]:
    """Methods that ran on different images or replicates. Failed images count as run; a job that failed ran on all."""
    whole = set(rows.loc[rows["view"] == "", "method"])
    per_view = rows.loc[~rows["method"].isin(whole), ["method", "scene", "view"]].drop_duplicates()
    split = {scene: results.unreplicated(scene) for scene in per_view["scene"].unique()}
    images: dict[str, frozenset[tuple[str, int, str]]] = {
        str(name): frozenset((*split[scene], view) for scene, view in values_of(of_method, "scene", "view"))
        for name, of_method in per_view.groupby("method", sort=False)
    }
    if len(_alike(images)) < 2 or ((shared := frozenset.intersection(*images.values())) and common):
        return
    n = len({(scene, view) for scene, _, view in shared})
    share = f", or --common compares them on the {n} images they share" if n else ", for they share none"
    plain = {name: frozenset((scene, view) for scene, _, view in of_method) for name, of_method in images.items()}
    anywhere = frozenset[tuple[str, str]]().union(*plain.values())
    if len(alike := _alike(plain)) > 1:
        counts = ", ".join(f"{names_of(names)} on {len(views)}" for views, names in alike.items())
        lacking, views = next((name, views) for name, views in plain.items() if views != anywhere)
        scene, view = min(anywhere - views)
        example = f"{scene}/{view}" if len({name for name, _ in anywhere}) > 1 else view
        why = f"{counts} ({lacking} not on {example}); run them on the same ones{share}"
        yield f"methods ran on different images: {why}"
        return
    scene, _, view = min(image for of_method in images.values() for image in of_method - shared)
    replicates = {
        name: tuple(sorted(number for plain, number, of in of_method if (plain, of) == (scene, view)))
        for name, of_method in images.items()
    }
    have = (f"{names_of(names)} {', '.join(map(str, numbers))}" for numbers, names in _alike(replicates).items())
    why = f"{'; '.join(have)}; run the same ones{share}"
    yield f"methods ran on different replicates of {scene}/{view}: {why}"


def _variants(rows: DataFrame) -> Iterator[str]:
    """Methods that were scored by one metric in different variants only."""
    for metric, of_metric in rows.groupby("metric", sort=False):
        variants = {
            str(name): frozenset(scores["variant"].unique()) for name, scores in of_metric.groupby("method", sort=False)
        }
        for (first, names), (second, others) in combinations(_alike(variants).items(), 2):
            if not first & second:
                yield (
                    f"{metric}: {names_of(names)} scored in variant {names_of(sorted(first))}, {names_of(others)} in "
                    f"{names_of(sorted(second))}; score all in one, metrics.{metric}.variants=[{min(first)}]"
                )
                break


def _versions(rows: DataFrame) -> Iterator[str]:
    """Scores of one column from different versions or options of the metric; the newest is taken as right."""
    for (metric, variant), of_variant in rows.groupby(["metric", "variant"], sort=False):
        made_by = of_variant["code"].map({code: "".join(code.split(".")[1:2]) for code in of_variant["code"].unique()})
        last = of_variant["time"].groupby(made_by).max().sort_values().index[-1]
        if (made_by == last).all():
            continue
        older = made_by[made_by != last].iloc[0]
        names = [list(dict.fromkeys(of_variant["method"][made_by == code])) for code in (older, last)]
        differing = "options" if older.split("-")[0] == last.split("-")[0] else "versions"
        yield (
            f"{metric} ({variant}): {names_of(names[0])} scored by other {differing} of the metric than "
            f"{names_of(names[1])}; give the run command of {names_of(names[0])} again, "
            "what is out of date is done anew"
        )


def _normalisations(rows: DataFrame) -> Iterator[str]:
    """Two labels of one method with different display normalisations that the labels do not mention.

    If they were fitted to different encodings, as `sucre` and `sucre` with `encoding=linear`, each needs its own.
    """
    options = options_of(rows)
    for first, second in combinations(options, 2):
        one, other = options[first], options[second]
        shown = one.get("display"), other.get("display")
        are_alike = all(one.get(name) == other.get(name) for name in ("name", "encoding"))
        if are_alike and shown[0] != shown[1] and "display=" not in first + second:
            yield (
                f"{first} and {second} are both {one.get('name')}, shown in different ways, {shown[0]} and {shown[1]}; "
                f"show them alike, or say it in a label: method.label='{second},display={shown[1]}'"
            )


def _alike(values: Mapping[str, T]) -> dict[T, list[str]]:
    """Return the methods with equal values, by value."""
    alike: dict[T, list[str]] = {}
    for name, value in values.items():
        alike.setdefault(value, []).append(name)
    return alike
