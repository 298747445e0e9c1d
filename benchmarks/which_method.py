"""Which method when: errors of colours by method and natural condition, on 48 independent scenes of `dataset=nature`.

    python benchmarks/which_method.py measure which_method.csv
    python benchmarks/which_method.py show benchmarks/which_method.csv which-method.png

`measure` appends a row a scene and method, and goes on where it was stopped; `--part 0/2` measures every second scene.
`show` prints a table in Markdown and draws a picture, of the seas whose twelve conditions are all measured. Each scene
has its own ground, path and noise. All have mild errors of depth and poses. It takes about 30 CPU minutes.
benchmarks/which_method.csv is the table behind docs/which-method.md.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import sucre_bench as sb

SIZE = {"width": 96, "height": 72, "views": 6}
TARGET = 3
CONDITIONS = (
    "plain", "pose_2", "depth_3", "fish_2", "caustics_25", "auto_exposure", "camera", "linear_light", "jpeg_75",
    "strobe", "scatter", "all_mild",
)  # fmt: skip
SEAS = (
    ("coastal", "approach"),
    ("clear", "forward"),
    ("green", "survey_varying"),
    ("blue", "orbit"),
)
SUCRE_EXACT = {"footprint": False, "physical": False, "robust": False, "light": "even"}
METHODS: dict[str, tuple[str, dict[str, Any]]] = {
    **{
        name: (name, {})
        for name in (
            "underwater", "gray_world", "histogram_stretch", "clahe", "red_compensation", "rghs", "fusion_2012",
            "fusion_2018", "mlle", "udcp", "ulap", "ibla", "haze_lines", "dive_gray_world", "gaussian_seathru",
            "seathru", "stitching", "sucre_paper", "sucre_authors",
        )
    },
    "sucre_exact": ("sucre", SUCRE_EXACT),
    "sucre": ("sucre", {}),
    "sucre_plus": ("sucre_plus", {}),
}  # fmt: skip
COLUMNS = [
    "condition",
    "water",
    "path",
    "seed",
    "method",
    "gain",
    "raw",
    "coverage",
    "kept_photograph",
]


def scenes() -> Iterator[dict[str, Any]]:
    """Yield the options of each scene; a sea's twelve conditions come together."""
    for turn, (water, path) in enumerate(SEAS):
        for place, condition in enumerate(CONDITIONS):
            yield {
                "condition": condition,
                "water": water,
                "path": path,
                "seed": len(CONDITIONS) * turn + place,
            }


def measure(file: Path, part: str) -> None:
    """Append the rows of scenes that the file has not."""
    which, of = (int(number) for number in part.split("/"))
    done = set(pd.read_csv(file)["seed"]) if file.exists() else set()
    for options in list(scenes())[which::of]:
        if options["seed"] in done:
            continue
        scene = sb.load_scene("nature", **options, **SIZE)
        rows = []
        for label, (name, chosen) in METHODS.items():
            result = sb.restore(name, scene, TARGET, **chosen)
            scores = sb.score(result, scene[TARGET], metrics=["colours:all", "coverage"])
            found = scores.set_index(["metric", "variant"])["value"]
            rows.append({
                **options, "method": label, "gain": round(found["colours", "gain"], 2),
                "raw": round(found["colours", "raw"], 2), "coverage": round(found["coverage"].iloc[0], 3),
                "kept_photograph": result.info.get("model") == "no water",
            })  # fmt: skip
        is_new = not file.exists()
        with file.open("a", newline="") as stream:
            writer = csv.DictWriter(stream, COLUMNS)
            if is_new:
                writer.writeheader()
            writer.writerows(rows)
        print(options, flush=True)


def _interval(values: np.ndarray) -> tuple[float, float, float]:
    """Return a mean and its 95 % interval, a bootstrap over scenes."""
    draws = values[np.random.default_rng(0).integers(0, len(values), (4000, len(values)))].mean(
        axis=1
    )
    return (float(values.mean()), *(float(x) for x in np.quantile(draws, (0.025, 0.975))))


def show(file: Path, picture: Path) -> None:
    """Print the table in Markdown, and draw methods x conditions."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    rows = pd.read_csv(file)
    rows = rows[rows["method"].isin(METHODS)]
    rows = rows[rows.groupby("water")["condition"].transform("nunique") == len(CONDITIONS)]
    if rows.empty:
        raise SystemExit(
            f"{file}: no sea has all {len(CONDITIONS)} conditions yet; measure more"
        )
    seeds = rows["seed"].nunique()
    gain = rows.pivot_table(index="method", columns="condition", values="gain")[
        list(CONDITIONS)
    ]
    by_scene = rows.pivot_table(index="method", columns="seed", values="gain")
    order = by_scene.mean(axis=1).sort_values(ascending=False).index
    ranks = by_scene.rank(ascending=False).mean(axis=1)
    print("| method | all | rank | " + " | ".join(f"`{name}`" for name in CONDITIONS) + " |")
    print("|---|" + "---:|" * (2 + len(CONDITIONS)))
    for method in order:
        mean, low, high = _interval(by_scene.loc[method].to_numpy())
        cells = []
        for name in CONDITIONS:
            text = f"{gain.loc[method, name]:.1f}"
            is_best = gain.loc[method, name] == gain[name].max()
            cells.append(f"**{text}**" if is_best else text)
        print(
            f"| `{method}` | {mean:.1f} [{low:.1f}, {high:.1f}] | {ranks[method]:.1f} | "
            + " | ".join(cells)
            + " |"
        )
    kept = (
        rows[rows["method"].isin(["sucre", "sucre_plus"])]
        .groupby(["method", "condition"])["kept_photograph"]
        .sum()
    )
    print(
        f"\n{seeds} scenes; scenes in which the photograph was kept:\n{kept.unstack()[list(CONDITIONS)].to_string()}"
    )

    plot, axes = pyplot.subplots(figsize=(9, 7.5), layout="constrained")
    values = gain.loc[order].to_numpy()
    shown = axes.imshow(values, cmap="viridis", aspect="auto")
    for (row, column), value in np.ndenumerate(values):
        colour = "black" if value > (values.max() + values.min()) / 2 else "white"
        weight = "bold" if value == values[:, column].max() else "normal"
        axes.text(
            column,
            row,
            f"{value:.0f}",
            ha="center",
            va="center",
            color=colour,
            fontsize=9,
            weight=weight,
        )
    axes.set_xticks(range(len(CONDITIONS)), CONDITIONS, rotation=40, ha="right")
    axes.set_yticks(range(len(order)), order)
    axes.set_title(
        f"colours:gain, dB, higher is better; means of {seeds // len(CONDITIONS)} scenes; best in bold"
    )
    plot.colorbar(shown, shrink=0.6)
    plot.savefig(picture, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("measure", "show"))
    parser.add_argument(
        "files", type=Path, nargs="+", help="the CSV file, and with show the picture"
    )
    parser.add_argument("--part", default="0/1", help="which scenes: every Nth from K, K/N")
    words = parser.parse_args()
    if words.what == "measure":
        measure(words.files[0], words.part)
    else:
        show(*words.files)


if __name__ == "__main__":
    main()
