"""How methods do in natural conditions: scenes of `dataset=nature` with exact poses and depth, one row a condition.

Run: python benchmarks/nature.py --methods sucre,sucre_plus,sucre_paper --cache /tmp/nature. A case is
CONDITION/WATER/GEOMETRY; water and geometry may be left out (coastal, approach). `--conditions` takes cases, separated
by commas, `table` or `all`. A method may have options: `sucre:robust=true:light=even`.

Each cell has a number a method, in their order, the worst of the targets:

- beta, B, gamma: largest error of the three channels in % of the truth; of a true 0, the value itself x 100;
- raw, affine: PSNR of J in dB over the pixels with a colour, as it is and after the best gain and offset a channel;
- cov: share of the colours within 2 x `confidence` of the truth, 0.95 if that is a standard deviation;
- z: largest error of beta in standard errors;
- limits: targets whose record has a limit.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

import sucre_bench as sb
from sucre_bench.arrays import Array
from sucre_bench.datasets.nature import Nature
from sucre_bench.datasets.nature.conditions import CONDITIONS
from sucre_bench.datasets.nature.render import WATERS

# Conditions that also depend on water or geometry, and where they are tried; all others once, in "coastal/approach".
ELSEWHERE = {
    "plain": "coastal/approach clear/approach deep/approach green/approach blue/approach haze/approach "
    "coastal/approach_rough coastal/forward clear/forward haze/forward coastal/survey coastal/survey_flat clear/survey "
    "coastal/survey_two_heights coastal/survey_two_heights_flat coastal/survey_varying blue/orbit",
    "fish": "coastal/approach coastal/survey",
    "fish_2": "coastal/approach coastal/forward",
    "caustics_25": "coastal/approach coastal/survey coastal/survey_flat coastal/forward",
    "caustics_10": "coastal/approach coastal/survey coastal/survey_flat coastal/forward",
    "white_balance_3": "coastal/approach coastal/survey coastal/forward",
    "jpeg_95": "coastal/approach coastal/forward",
    "jpeg_75": "coastal/approach coastal/forward clear/approach",
    "exposure_15": "coastal/approach coastal/survey clear/forward",
    "exposure_30": "deep/approach",
    "auto_exposure": "coastal/approach coastal/forward coastal/survey_two_heights_flat blue/orbit",
    "vignette_35": "coastal/approach coastal/survey",
    "strobe": "coastal/survey_varying coastal/approach coastal/forward coastal/survey_flat coastal/survey_two_heights "
    "coastal/orbit",
    "strobe_narrow": "coastal/survey_two_heights",
    "strobe_daylight": "coastal/survey_varying coastal/survey_flat",
    "strobe_auto_exposure": "coastal/survey_varying",
    "all_mild": "coastal/approach coastal/forward coastal/survey",
    "pose_1": "coastal/approach coastal/forward",
    "linear_light": "coastal/approach coastal/forward",
    "scatter": "coastal/approach coastal/forward coastal/survey clear/approach",
    "scatter_weak": "coastal/approach coastal/forward",
    "clipping": "clear/approach",
    "low_contrast": "coastal/approach haze/survey",
}
# The model holds in these, and light is even: nothing is to be said.
QUIET = [
    *(
        "plain/coastal/approach",
        "plain/clear/forward",
        "plain/haze/approach",
        "plain/deep/approach",
    ),
    *("plain/green/approach", "plain/blue/orbit", "noise_1/coastal/approach"),
    *("low_contrast/coastal/approach", "noise_3/coastal/approach"),
]
TABLE = [
    *QUIET, "fish", "fish_2", "fish_2/coastal/forward", "snow", "caustics_10",
    "caustics_10/coastal/forward", "caustics_25", "caustics_25/coastal/forward",
    "caustics_25/coastal/survey_flat", "white_balance_3", "white_balance_10", "exposure_5",
    "exposure_30/deep/approach", "auto_exposure", "vignette_15", "vignette_35", "vignette_35/coastal/survey",
    "jpeg_90", "jpeg_75", "jpeg_75/coastal/forward", "all_mild", "all_mild/coastal/forward", "all_mild/coastal/survey",
    "all_mild/coastal/survey_flat", "scatter", "strobe/coastal/survey_varying", "strobe",
    "strobe/coastal/forward", "strobe/coastal/survey_flat",
]  # fmt: skip
LIMIT_BETA = 20  # % from which on a water is called wrong


def error_of(found: Array, truth: Array) -> Array:
    """Return the error (3,) in %: of the truth, or of 1 where the truth is 0."""
    return 100 * (found - truth) / np.where(truth == 0, 1, truth)


def psnr(difference: Array) -> float:
    return float(-10 * np.log10(np.mean(difference**2))) if difference.size else np.nan


def scores_of(result: sb.Restored, water: sb.Water, J: Array) -> dict[str, Any]:
    """Return the numbers of one restoration, signed errors and the record's words among them."""
    # the ground behind fish is unknown
    ok = result.valid & np.isfinite(J).all(axis=-1)
    row = {}
    found, true = result.image[ok].astype(float), J[ok]
    fitted = found.copy()
    for c in range(3):
        if len(found) > 2:
            design = np.stack([found[:, c], np.ones(len(found))], axis=1)
            fitted[:, c] = design @ np.linalg.lstsq(design, true[:, c], rcond=None)[0]
    row = {"pixels": int(ok.sum()), "raw": psnr(found - true), "affine": psnr(fitted - true)}
    if result.confidence is not None and len(found):
        row["cov"] = float((np.abs(found - true) < 2 * result.confidence[ok][:, None]).mean())
    if result.water is not None:
        for name, field in (
            ("beta", "attenuation"),
            ("B", "veiling_light"),
            ("gamma", "backscatter"),
        ):
            error = error_of(getattr(result.water, field), getattr(water, field))
            row |= {f"{name}_{c}": value for c, value in zip("rgb", error, strict=True)}
            row[name] = float(np.abs(error).max())
        spread = [
            np.nan if x is None else x
            for x in result.info.get("standard_error", {}).get("beta", [np.nan] * 3)
        ]
        with np.errstate(divide="ignore", invalid="ignore"):
            z = (result.water.attenuation - water.attenuation) / np.array(spread)
        row |= {"z": float(np.abs(z).max()), **dict(zip(("z_r", "z_g", "z_b"), z, strict=True))}
    about = {
        key: value
        for key, value in result.info.items()
        if key in ("gains", "light", "robust", "unexplained")
    }
    limits = list(result.info.get("limits", ()))
    return row | {
        "limits": len(limits) > 0,
        "limits_text": " | ".join(limits),
        "about": str(about)[:500],
    }


def nature_of(case: str, seed: int, size: tuple[int, int], cache: Path | None) -> Nature:
    """Return the dataset of a case "condition/water/geometry"; a geometry is a path, or survey_flat."""
    condition, water, geometry = case.rsplit("/", 2)
    options: dict[str, Any] = {"condition": condition, "water": water, "path": geometry}
    for relief in ("flat", "rough"):
        if geometry.endswith(f"_{relief}"):
            options |= {"path": geometry.removesuffix(f"_{relief}"), "relief": relief}
    return Nature(
        **options, errors="none", width=size[0], height=size[1], seed=seed, root=cache
    )


def run_case(
    case: str, seed: int, methods: Sequence[str], size: tuple[int, int], cache: Path | None
) -> list[dict[str, Any]]:
    """Return a row for each method and target of a case "condition/water/geometry"."""
    nature = nature_of(case, seed, size, cache)
    (scene,), waters = nature.scenes(), nature.arrays()["water"]
    rows = []
    for method in methods:
        name, *options = method.split(":")
        chosen = {
            key: yaml.safe_load(value)
            for key, value in (option.split("=", 1) for option in options)
        }
        for target in (nature.views // 6, 2 * nature.views // 3):
            row = {
                "case": case,
                "seed": seed,
                "method": method,
                "target": scene[target].name,
                "error": "",
            }
            started = time.perf_counter()
            try:
                result = sb.restore(name, scene, target, **chosen)
            except sb.SucreBenchError as fault:
                rows.append(row | {"error": str(fault)})
                continue
            row["s"] = time.perf_counter() - started
            rows.append(
                row | scores_of(result, sb.Water(*waters[target]), scene[target].reference)
            )
    return rows


# How each number of the table is made of the targets: the worst.
WORST = {
    "beta": "max",
    "B": "max",
    "gamma": "max",
    "raw": "min",
    "affine": "min",
    "cov": "min",
    "z": "max",
}


def table_of(rows: pd.DataFrame, methods: Sequence[str]) -> str:
    """Return one line a case; a cell has one number a method."""
    lines = []
    for case, of_case in rows.groupby("case", sort=False):
        line = {"condition": case.removesuffix("/coastal/approach")}
        by_method = [of_case[of_case["method"] == method] for method in methods]
        for column, worst in WORST.items():
            digits = {"cov": 2, "raw": 1, "affine": 1}.get(column, 0)
            values = [
                part[column].agg(worst) if column in part else np.nan for part in by_method
            ]
            line[column] = " / ".join("-" if np.isnan(x) else f"{x:.{digits}f}" for x in values)
        line["limits"] = " / ".join(
            f"{int(part['limits'].eq(True).sum())}of{len(part)}" for part in by_method
        )
        lines.append(line)
    heading = "worst of the targets, " + " / ".join(methods)
    return heading + "\n" + pd.DataFrame(lines).to_string(index=False, justify="right")


def summary_of(rows: pd.DataFrame, methods: Sequence[str]) -> str:
    """Return counts of each method: wrong waters, silent ones, losses against sucre_paper, faults, seconds."""
    paper = rows[rows["method"] == "sucre_paper"].set_index(["case", "seed", "target"])["raw"]
    lines = []
    for method in methods:
        own = rows[rows["method"] == method].set_index(["case", "seed", "target"])
        wrong, quiet = own["beta"] > LIMIT_BETA, own["limits"] != True  # noqa: E712
        doubtful = own["beta"].between(5, LIMIT_BETA)
        ahead, calm = own["raw"] - paper.reindex(own.index), own.index.isin(QUIET, level="case")
        spread = round(
            float(np.sqrt(np.nanmean(own[["z_r", "z_g", "z_b"]].replace(np.inf, np.nan) ** 2))),
            2,
        )
        lines.append({
            "method": method, "targets": len(own), f"beta off > {LIMIT_BETA} %": wrong.sum(),
            "... no limit": (wrong & quiet).sum(), f"beta off 5-{LIMIT_BETA} %, no limit": (doubtful & quiet).sum(),
            "cov < .7, no limit": ((own["cov"] < 0.7) & quiet).sum(), "quiet": calm.sum(),
            "... with a limit": (calm & ~quiet).sum(), "rms z": spread, "raw < paper - 1": (ahead < -1).sum(),
            "raw > paper + 1": (ahead > 1).sum(), "not restored": (own["error"] != "").sum(),
            "median s": round(own["s"].median(), 2),
        })  # fmt: skip
    return pd.DataFrame(lines).set_index("method").T.to_string()


def cases_of(words: str) -> list[str]:
    """Return full names of cases: "all", "table", or "fish,plain/clear/forward"."""
    if words == "all":
        return [
            f"{name}/{place}"
            for name in CONDITIONS
            for place in ELSEWHERE.get(name, "coastal/approach").split()
        ]
    cases = []
    for word in TABLE if words == "table" else words.split(","):
        name = max(
            (name for name in CONDITIONS if f"{word.strip()}/".startswith(f"{name}/")),
            key=len,
            default=word,
        )
        condition, *rest = name, *word.strip().removeprefix(name).split("/")[1:]
        water, geometry = [*rest, *["coastal", "approach"][len(rest) :]]
        if condition not in CONDITIONS or water not in WATERS:
            raise SystemExit(
                f"--conditions: no '{word}'; conditions: {', '.join(CONDITIONS)}; waters: {', '.join(WATERS)}"
            )
        cases.append(f"{condition}/{water}/{geometry}")
    return cases


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--methods", default="sucre,sucre_plus,sucre_paper", help="separated by commas"
    )
    parser.add_argument(
        "--option",
        action="append",
        default=[],
        help="option of all methods, such as robust=true",
    )
    parser.add_argument(
        "--conditions", default="all", help="cases separated by commas, table or all"
    )
    parser.add_argument("--seeds", type=int, default=1, help="scenes of each case")
    parser.add_argument("--first-seed", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--size", default="192x144", help="pixels, width x height")
    parser.add_argument("--cache", type=Path, help="folder in which scenes are stored")
    parser.add_argument("--csv", type=Path, help="file for all numbers of all targets")
    parser.add_argument("--processes", type=int, default=1)
    words = parser.parse_args()
    methods = [":".join([method, *words.option]) for method in words.methods.split(",")]
    width, height = (int(side) for side in words.size.split("x"))
    rows: list[dict[str, Any]] = []
    with ProcessPoolExecutor(words.processes, get_context("spawn")) as pool:
        jobs = [
            pool.submit(run_case, case, seed, methods, (width, height), words.cache)
            for seed in range(words.first_seed, words.first_seed + words.seeds)
            for case in cases_of(words.conditions)
        ]
        for place, job in enumerate(jobs, 1):
            rows += job.result()
            frame = pd.DataFrame(rows)
            if words.csv:  # after each case, so that an interrupted run leaves its numbers
                frame.to_csv(words.csv, index=False)
            print(f"{place} of {len(jobs)}: {rows[-1]['case']}", file=sys.stderr)
    print(table_of(frame, methods), summary_of(frame, methods), sep="\n\n")


if __name__ == "__main__":
    main()
