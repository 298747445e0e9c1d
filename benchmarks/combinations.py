r"""Do several scores together order methods more as true colours do than the best one alone? On scenes that did not
choose them.

Run the command of docs/formulas.md, then
     python benchmarks/combinations.py validity

Scores are ranks among the methods of a view, 0 to 1. On half of the scenes the best score, the best pair and the best
three by mean rank, and weights by non-negative least squares, are chosen; the other half judges them. Each split is
used both ways, so every scene judges as often. A line has the mean of Kendall's tau-b over views and scenes with its
95 % interval over scenes, the same of its gain over the best single score, and what was chosen most often.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import nnls

from sucre_bench import results

SPLITS = 10
# Scores without truth, and whether less is better: one variant of each metric, and the forms of UIQM that differ.
SCORES = {
    "uiqm:getuiqm1": False, "uiqm:matlab-first-output": False, "uiqm:panetta2016": False, "uciqe:yang2015": False,
    "uism:panetta2016": False, "uicm:panetta2016": False, "uiconm:panetta2016": False, "saturated_red:hsv": True,
    "seams:visible": True, "negative:any": True, "faults:clipped": True, "faults:noise": True, "faults:cast": True,
    "faults:red": True, "consistency:relative": True, "matches:doublings": False,
}  # fmt: skip


def taus(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Kendall's tau-b (V,) of two scores (V, M); 0 where one of them has no order."""
    a, b = (np.sign(x[:, :, None] - x[:, None]) for x in (one, other))
    pairs = np.sqrt((a**2).sum(axis=(1, 2)) * (b**2).sum(axis=(1, 2)))
    return np.asarray((a * b).sum(axis=(1, 2)) / np.maximum(pairs, 1))


def interval(values: np.ndarray) -> str:
    """Return the mean and its 95 % interval, a bootstrap over scenes."""
    draws = values[np.random.default_rng(0).integers(0, len(values), (4000, len(values)))].mean(
        axis=1
    )
    return "{:+.3f} [{:+.3f}, {:+.3f}]".format(
        values.mean(), *np.quantile(draws, (0.025, 0.975))
    )


def best(
    of: Sequence[tuple[str, ...]],
    values: dict[str, np.ndarray],
    target: np.ndarray,
    fits: np.ndarray,
) -> tuple[str, ...]:
    """Return the scores whose mean rank agrees best with the target on the views that fit."""
    agreement = [
        taus(sum(values[name][fits] for name in some), target[fits]).mean() for some in of
    ]
    return of[int(np.argmax(agreement))]


def judge(folder: Path, truth: str) -> None:
    """Print the lines of a results folder; truth: the score that knows the true colours."""
    rows = results.read(folder)
    rows = rows[(rows["status"] == "ok") & (rows["region"] == "image")]
    wide = rows.assign(score=rows["metric"] + ":" + rows["variant"]).pivot_table(
        index=["scene", "view"], columns=["score", "method"], values="value"
    )
    methods = list(dict.fromkeys(rows["method"]))
    true = wide[truth].reindex(columns=methods)
    wide, true = wide[true.notna().all(axis=1)], true.dropna()
    known = [name for name in SCORES if name in wide and wide[name].notna().mean().mean() > 0.9]
    ranks = {
        n: wide[n]
        .reindex(columns=methods)
        .rank(axis=1, pct=True, ascending=not SCORES[n])
        .fillna(0.5)
        for n in known
    }
    values, target = (
        {n: r.to_numpy() for n, r in ranks.items()},
        true.rank(axis=1, pct=True, ascending="de00" not in truth).to_numpy(),
    )
    scenes = true.index.get_level_values("scene").to_numpy()
    names = np.unique(scenes)
    found: dict[str, dict[str, list[float]]] = {}
    chosen: dict[str, Counter[str]] = {}
    for split in range(2 * SPLITS):
        order = np.random.default_rng(split // 2).permutation(names)
        half = order[: len(names) // 2] if split % 2 else order[len(names) // 2 :]
        fits = np.isin(scenes, half)

        one, pair = (
            best([(n,) for n in known], values, target, fits),
            best([*combinations(known, 2)], values, target, fits),
        )
        three = best([(*pair, n) for n in known if n not in pair], values, target, fits)
        columns = np.stack([values[n][fits].ravel() - 0.5 for n in known], axis=1)
        weights = nnls(columns, target[fits].ravel() - 0.5)[0]
        rules = {
            name: sum(values[n] for n in c)
            for name, c in (("single", one), ("pair", pair), ("three", three))
        }
        rules["least squares"] = sum(w * values[n] for w, n in zip(weights, known, strict=True))
        for name, what in (("single", one), ("pair", pair), ("three", three)):
            chosen.setdefault(name, Counter())[" + ".join(what)] += 1
        chosen.setdefault("least squares", Counter()).update(
            n for w, n in zip(weights, known, strict=True) if w > 0.1
        )
        for name, rule in rules.items():
            of_view = taus(rule, target)
            for scene in np.setdiff1d(names, half):
                found.setdefault(name, {}).setdefault(scene, []).append(
                    of_view[scenes == scene].mean()
                )
    print(
        f"{truth}: {len(names)} scenes, {len(true)} views, {len(methods)} methods; {len(known)} scores"
    )
    single = pd.Series({scene: np.mean(of) for scene, of in found["single"].items()})
    for name, by_scene in found.items():
        mean = pd.Series({scene: np.mean(of) for scene, of in by_scene.items()})
        gain = "" if name == "single" else f"  gain {interval((mean - single).to_numpy())}"
        print(f"  {name:<14}{interval(mean.to_numpy())}{gain}  {chosen[name].most_common(4)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", type=Path)
    for known_truth in ("colours:gain", "colours:raw", "colours_de00:gain"):
        judge(parser.parse_args().results, known_truth)
