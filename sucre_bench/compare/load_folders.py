"""Reads the score tables of several results folders, or bundles, as one; refuses those that do not go together."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from sucre_bench import results
from sucre_bench.arrays import DataFrame
from sucre_bench.errors import InputError
from sucre_bench.machine import progress
from sucre_bench.results.bundle_format import is_bundle, open_bundle
from sucre_bench.results.rows import COSTS

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
        _refuse_several(
            rows[rows["scene"] != ""], ["dataset", "scene"], "data_id", "the data differ between these runs"
        )
        coded = rows.assign(_code=rows["code"].str.split(".").str[0])
        _refuse_several(coded, ["dataset", "method"], "options_id", "these folders mean different options by it")
        _refuse_several(
            coded, ["dataset", "method"], "_code", "these folders hold it from different versions of its code"
        )
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


def _refuse_several(rows: DataFrame, group: list[str], column: str, fault: str) -> None:
    several = rows.groupby(group)[column].nunique()
    if (several > 1).any():
        names = " / ".join(several[several > 1].index[0])
        raise InputError(f"{names}: {fault}; run it again, or give it another label")


def names_of(names: Sequence[str]) -> str:
    """Return names as words: "a, b and c"."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
