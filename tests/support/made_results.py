"""A folder of results written by hand: what a run leaves behind, with values that a test knows beforehand.

Two methods restore every view, a third failed on one; each view shows a chart of three patches, farther each time.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd

from sucre_bench import results
from sucre_bench.reports.paper import Study, study_results as along, style, write_study
from sucre_bench.results import layout
from sucre_bench.results.restorations import write_masked_png
from sucre_bench.results.rows import Row, frame

# psnr by method and view.
PSNR = {"plain": (20.0, 22.0, 21.0), "clever": (25.0, 27.0, 26.5), "broken": (18.0, 19.0, None)}
# Measured and expected, 0 to 255.
PATCHES = {
    "1-white": ((200, 210, 255), (255, 255, 255)),
    "2-red": ((120, 60, 70), (235, 28, 36)),
    "10-blue": ((40, 60, 90), (1, 27, 84)),
}
DE00 = {"1-white": 12.5, "2-red": 33.25, "10-blue": 7.75}
DISTANCES = (2.0, 4.0, 8.0)
TRUTH = {"B": [0.1, 0.4, 0.5], "beta": [0.4, 0.2, 0.1], "gamma": [0.3, 0.2, 0.15]}
ESTIMATE = {"B": [0.12, 0.41, 0.52], "beta": [0.37, 0.21, 0.11], "gamma": [0.33, 0.22, 0.16]}


def made_results(
    out: Path, datasets: Sequence[str] = ("reef",), size: tuple[int, int] = (96, 64)
) -> pd.DataFrame:
    """Write pictures and what methods tell under `out`; return the rows. size: of the first dataset's pictures."""
    rows = [
        row
        for n, name in enumerate(datasets)
        for row in _rows(out, name, (96, 64) if n else size, 1.5 * n)
    ]
    return results.frame(rows)


def _rows(out: Path, dataset: str, size: tuple[int, int], worse: float) -> Iterator[Row]:
    rng = np.random.default_rng(7)
    for method, scores in PSNR.items():
        options = json.dumps({"name": "gray_world", "dataset": {"name": "demo"}})
        base = Row(
            dataset, "cove", method=method, options=options, options_id=method, data_id=dataset
        )
        for number, score in enumerate(scores):
            row = replace(base, view=f"v{number}.png")
            if score is None:
                yield replace(
                    row, value=np.nan, status="failed", reason="ValueError: boom <b>bold</b>"
                )
                continue
            _write(out, row, size, rng, holes=method == "clever")
            yield replace(row, value=0.5 + number, coverage=0.75 if method == "clever" else 1.0)
            psnr = {"metric": "psnr", "variant": "masked", "unit": "dB", "better": "higher"}
            yield replace(
                row, **psnr, value=score - worse, coverage=0.75 if method == "clever" else 1.0
            )
            yield from chart_rows(
                row,
                "near",
                DISTANCES[number],
                {"de00": DE00},
                {"2-red": (10.0, 350.0)},
                {patch: np.divide(pair, 255).tolist() for patch, pair in PATCHES.items()},
            )


def chart_rows(
    row: Row,
    chart: str,
    distance: float,
    errors: Mapping[str, Mapping[str, float]],
    hues: Mapping[str, Sequence[float]],
    colours: Mapping[str, Sequence[Sequence[float]]],
) -> Iterator[Row]:
    """Scores of a chart. errors: of patches by metric; hues, colours: of patches, measured and expected."""
    away = {"metric": "chart_distance", "variant": "median", "unit": "m", "better": "none"}
    yield replace(row, **away, region=chart, value=distance)
    for metric, of_patches in errors.items():
        error = replace(row, metric=metric, variant="lab", unit="dE00", better="lower")
        yield replace(error, region=chart, value=float(np.mean([*of_patches.values()])))
        for patch, value in of_patches.items():
            yield replace(error, region=f"{chart}/{patch}", value=value)
    for patch, pair in hues.items():
        hue = replace(row, metric="hue", unit="deg", better="none", region=f"{chart}/{patch}")
        for end, value in zip(("", "-expected"), pair, strict=True):
            yield replace(hue, variant=f"hsv{end}", value=value)
    for patch, colour_pair in colours.items():
        one = replace(row, metric="patch_colour", better="none", region=f"{chart}/{patch}")
        for end, colour in zip(("", "-expected"), colour_pair, strict=True):
            for channel, value in zip(("red", "green", "blue"), colour, strict=True):
                yield replace(one, variant=f"{channel}{end}", value=value)


def keep(out: Path, row: Row, told: Mapping[str, Any], image: np.ndarray | None = None) -> None:
    """Write the files that a run keeps of a restoration. image: BGR, 8 bits."""
    place = layout.Place(row.dataset, Path(row.view).with_suffix(""))
    path = place.restored(out, row.method)
    for file in (path, place.original(out)):
        file.parent.mkdir(parents=True, exist_ok=True)
    path.with_suffix(".json").write_text(json.dumps(told))
    place.original(out).touch()
    if image is not None:
        cv2.imwrite(str(path), image)


def _write(
    out: Path, row: Row, size: tuple[int, int], rng: np.random.Generator, holes: bool
) -> None:
    place = layout.Place(row.dataset, Path(row.view).with_suffix(""))
    # Smooth: a page of large pictures of noise would be 16 MB.
    image = cv2.resize(
        rng.integers(30, 255, (8, 12, 3), dtype=np.uint8), size, interpolation=cv2.INTER_LINEAR
    )
    if holes:
        image[:, : size[0] // 4] = 0
    told: dict[str, Any] = {
        **ESTIMATE,
        "encoding": "gamma",
        "true_water": TRUTH,
        "steps": 7,
        "write_seconds": 0.1,
    }
    told["limits"] = ["flat"]
    for path in (place.original(out), place.reference(out), place.restored(out, row.method)):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_masked_png(path, image, image.any(axis=-1))
    if holes:
        place.restored(out, row.method).with_suffix(".json").write_text(json.dumps(told))


ROW = Row(
    scene="reef",
    metric="psnr",
    variant="masked",
    unit="dB",
    better="higher",
    code="c",
    data_id="d",
)


def row(
    method: str,
    view: str,
    value: float,
    degrade: Mapping[str, Any] = {},
    dataset: Mapping[str, Any] = {"name": "sea"},
    options: Mapping[str, Any] = {},
    **about: Any,
) -> Row:
    """A score as a run keeps it; NaN is a failure."""
    said = {
        "name": method,
        "dataset": dict(dataset),
        **options,
        **({"degrade": dict(degrade)} if degrade else {}),
    }
    label = ",".join(
        [
            str(dataset["name"]),
            *(f"{k}={str(v).replace(', ', '_')}" for k, v in degrade.items()),
        ]
    )
    status = {"status": "failed", "reason": "broke"} if np.isnan(value) else {}
    own = {"dataset": label, "method": method, "time": "2026-01-01", **status, **about}
    return replace(ROW, view=view, value=value, options=json.dumps(said), **own)


def noisy(
    values: Mapping[Any, Mapping[str, list[float]]], option: str = "depth_noise", **about: Any
) -> pd.DataFrame:
    """Scores by value, method and view; None is the value of undegraded data, which no row says."""
    return frame(
        row(method, f"v{n}", score, {} if value is None else {option: value}, **about)
        for value, methods in values.items()
        for method, scores in methods.items()
        for n, score in enumerate(scores)
    )


def followed(rows: pd.DataFrame, option: str, **study: Any) -> along.Along:
    (one,) = along.along(rows, Study(name="s", along=option, **study))
    return one


def drawn(
    name: str, rows: pd.DataFrame, out: Path = Path("nowhere"), **study: Any
) -> dict[str, Any]:
    """The figures of one kind, by the ends of their files' names."""
    with style.look():
        return dict(write_study.drawn(name, along.StudyResults(Study("s", **study), rows, out)))


def words(one: along.Along) -> list[str]:
    return [value.word for value in one.values]


def csv(out: Path, name: str = "s") -> pd.DataFrame:
    return pd.read_csv(out / "tables" / f"{name}.csv", keep_default_na=False, na_values=[""])
