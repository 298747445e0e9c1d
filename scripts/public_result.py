"""Makes the public result in docs/board: numbers-only bundles; compares a run with it.

python scripts/public_result.py [DATA]             make all of it; DATA holds u45/ and D5/, left out if it is not given
python scripts/public_result.py --check RESULTS    exit with 1 if scores of RESULTS differ from the bundle of the demo
"""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pandas as pd

from sucre_bench import results
from sucre_bench.arrays import DataFrame

ROOT = Path(__file__).resolve().parent.parent
BOARD = ROOT / "docs" / "board"
# of a score, or of the median score of its column: as `sucre-bench verify` has it
TOLERANCE = 0.02
RUNS = {
    "demo": [
        "experiment=demo",
        "metrics=[colours,colours_de00,psnr,ssim,psi,uciqe,uiqm,coverage]",
    ],
    "D5": [
        *(
            "experiment=table1",
            "dataset=colmap",
            "dataset.root=D5",
            "dataset.label=D5",
            "every=1",
        ),
        *(
            "views=[D5_fig01_LFT_3374.png,LFT_3411.png]",
            "metrics=[psi,de00,neutral,uciqe,uiqm,coverage]",
        ),
    ],
    "u45": [
        "experiment=photographs",
        "dataset=u45",
        "dataset.root=u45",
        "metrics=[uciqe:matlab,uiqm:panetta2016]",
    ],
}


def make(data: Path | None) -> None:
    """Run everything, without mlflow and pages, and write the bundles. They have relative paths only."""
    runs = ROOT / "outputs" / "board"
    runs.mkdir(parents=True, exist_ok=True)
    for name, words in RUNS.items():
        if data and name != "demo" and not (runs / name).exists():
            (runs / name).symlink_to(data.resolve() / name)
        if data or name == "demo":
            out = f"{name}-results"
            bench(
                "run", "-m", *words, f"out={out}", "tracking.uri=off", "report=false", at=runs
            )
            bundle = [
                str(BOARD / "bundles" / f"{name}.zip"),
                "--by",
                "sucre_bench contributors",
                "--force",
            ]
            bench("bundle", out, *bundle, at=runs)


def bench(*words: str, at: Path) -> None:
    subprocess.run(
        [str(Path(sys.executable).with_name("sucre-bench")), *words], cwd=at, check=True
    )


def differences(folder: Path, bundle: Path) -> DataFrame:
    """Return the rows of a bundle that a results folder lacks, or has with another score."""
    keys = ["dataset", "view", "method", "metric", "variant", "region"]
    with zipfile.ZipFile(bundle) as opened, opened.open("scores.csv") as file:
        public = pd.read_csv(file)
    public = public[~public["metric"].isin(["seconds", "peak_mb"]) & public["value"].notna()]
    both = public.merge(
        results.read(folder)[[*keys, "value"]], "left", on=keys, suffixes=("", "_here")
    )
    usual = both.groupby(["metric", "variant"])["value"].transform("median").abs()
    allowed = TOLERANCE * both["value"].abs().combine(usual, max)
    return both[~((both["value"] - both["value_here"]).abs() <= allowed)][
        [*keys, "value", "value_here"]
    ]


if __name__ == "__main__":
    if sys.argv[1:2] == ["--check"]:
        differing = differences(Path(sys.argv[2]), BOARD / "bundles" / "demo.zip")
        print(
            differing.to_string()
            if len(differing)
            else "the demo agrees with docs/board/bundles/demo.zip"
        )
        sys.exit(bool(len(differing)))
    make(Path(sys.argv[1]) if sys.argv[1:] else None)
