"""Files that were cut, changed or made up: a reader returns what they hold, or raises an error that names the file.

`make fuzz` tries thousands; what it finds becomes an @example here.
"""

import functools
import io
import json
import os
import re
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import tifffile
from hypothesis import HealthCheck, example, given, settings, strategies as st
from support.colmap_folder import to_binary, write_dive

from sucre_bench import results
from sucre_bench.errors import SucreBenchError
from sucre_bench.imaging.image_files import image_size, read_array, read_rgb
from sucre_bench.jobs.compose_jobs import jobs
from sucre_bench.loading.charts_file import read_charts
from sucre_bench.loading.colmap_model import read_model
from sucre_bench.loading.depth_maps import read_depth
from sucre_bench.results.rows import Row
from sucre_bench.results.water_file import read_water

# `make fuzz` asks for more, and gives a seed.
EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "0"))
tried = settings(
    max_examples=EXAMPLES or 25,
    derandomize=not EXAMPLES,
    print_blob=True,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)

IMAGE = np.random.default_rng(0).integers(0, 255, (30, 40, 3), dtype=np.uint8)
DEPTH = np.random.default_rng(1).random((30, 40), dtype=np.float32)


def encoded(suffix: str, values: np.ndarray = IMAGE) -> bytes:
    return bytes(cv2.imencode(suffix, values)[1])


def through(write: Callable[[io.BytesIO], Any]) -> bytes:
    content = io.BytesIO()
    write(content)
    return content.getvalue()


# A whole file of each format by its name, and its reader.
FORMATS: dict[str, tuple[bytes, Callable[[Path], Any]]] = {
    "a.png": (encoded(".png"), lambda path: read_rgb(path, (40, 30))),
    "a.jpg": (encoded(".jpg"), read_rgb),
    "a.bmp": (encoded(".bmp"), read_rgb),
    "a.webp": (encoded(".webp"), read_rgb),
    "a.tif": (through(lambda file: tifffile.imwrite(file, IMAGE)), read_rgb),
    "depth.png": (encoded(".png", (DEPTH * 60000).astype(np.uint16)), read_depth),
    "depth.tif": (through(lambda file: tifffile.imwrite(file, DEPTH)), read_depth),
    "depth.npy": (through(lambda file: np.save(file, DEPTH)), read_depth),
    "a.npz": (
        through(lambda file: np.savez_compressed(file, image=DEPTH)),
        lambda path: read_array(path, lambda names: names[0]),
    ),
    "water.json": (b'{"B": [1, 2, 3], "beta": [0.1, 0.2, 0.3]}', read_water),
    "water.npz": (
        through(lambda file: np.savez(file, B=np.ones(3), beta=np.ones(3))),
        read_water,
    ),
    "mine.yaml": (
        b"every: 4\nhydra: {sweeper: {methods: [gray_world]}}\n",
        lambda path: jobs([str(path)], True),
    ),
}


def read(reader: Callable[[Path], Any], name: str, content: bytes) -> None:
    """Read a file; a fault is one line that names it."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / name
        path.write_bytes(content)
        image_size(path)
        try:
            reader(path)
        except SucreBenchError as fault:
            check_names(fault, name)


def check_names(fault: SucreBenchError, place: object) -> None:
    """The fault is one line that names the place."""
    assert str(place) in str(fault)
    assert len(str(fault).splitlines()) == 1
    assert not re.search(r"\b[A-Z]\w*Error\b", str(fault))


changes = st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=1, max_size=8)), max_size=4)


def changed(content: bytes, end: float, spots: list[tuple[float, bytes]]) -> bytes:
    """The content, cut at a share of its length, with other bytes at some."""
    data = bytearray(content[: round(end * len(content))])
    for share, other in spots:
        place = int(share * len(data))
        data[place : place + len(other)] = other
    return bytes(data)


@tried
@given(name=st.sampled_from(sorted(FORMATS)), end=st.floats(0, 1) | st.just(1.0), spots=changes)
@example(name="a.tif", end=0.004, spots=[])
def test_cut_and_changed_files_are_named(
    name: str, end: float, spots: list[tuple[float, bytes]]
):
    content, reader = FORMATS[name]
    read(reader, name, changed(content, end, spots))


@functools.cache
def model() -> dict[str, bytes]:
    """The files of a binary COLMAP model."""
    with tempfile.TemporaryDirectory() as folder:
        sparse = write_dive(Path(folder) / "dive", ("a.png", "b.png")) / "sparse"
        to_binary(sparse)
        return {path.name: path.read_bytes() for path in sparse.iterdir()}


@tried
@given(
    name=st.sampled_from(["cameras.bin", "images.bin"]),
    end=st.floats(0, 1) | st.just(1.0),
    spots=changes,
)
@example(
    name="cameras.bin", end=1.0, spots=[(0.4375, b"\x01")]
)  # a height of 4,294,967,326 pixels
# focal 1e212
@example(
    name="cameras.bin",
    end=1.0,
    spots=[(0.984375, bytes(8)), (0.5625, b"T"), (0.65625, b"\x00l")],
)
def test_cut_and_changed_models_are_named(
    name: str, end: float, spots: list[tuple[float, bytes]]
):
    with tempfile.TemporaryDirectory() as folder:
        sparse = Path(folder)
        for own, content in model().items():
            (sparse / own).write_bytes(changed(content, end, spots) if own == name else content)
        try:
            read_model(sparse, sparse)
        except SucreBenchError as fault:
            check_names(fault, sparse)


values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4)
    ),
    max_leaves=12,
)
corners = st.lists(st.lists(st.floats() | st.integers(), max_size=3), max_size=5)
charts = st.fixed_dictionaries(
    {
        "images": st.dictionaries(
            st.just("a.png"), st.dictionaries(st.text(max_size=3), corners | values)
        )
    }
)


@tried
@given(content=values | charts)
@example(content={"images": {"a.png": {"\x1e": []}}})
@example(content={"images": {"a\nb": {"c": []}}})
@example(content={"images": {"a.png": {"caf\udce9": [[1, 1], [9, 1], [9, 9], [1, 9]]}}})
def test_made_up_charts_are_named(content: Any):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "charts.json"
        path.write_text(json.dumps(content))
        try:
            read_charts(path, {"a.png": (40, 30)})
        except SucreBenchError as fault:
            check_names(fault, "charts.json")


ROWS = results.frame(
    [Row("d", "s", "v.png", "m", value=1.0), Row("d", "s", "w.png", "m", status="failed")]
)


@tried
@given(
    name=st.sampled_from(sorted(ROWS)),
    column=st.lists(values, min_size=2, max_size=2),
    end=st.floats(0, 1) | st.just(1.0),
)
@example(name="better", column=[None, {"\x1e": None}], end=1.0)
def test_made_up_tables_are_named(name: str, column: list[Any], end: float):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scores.parquet"
        try:
            content = through(
                lambda file: (
                    ROWS.drop(columns=name).assign(**{name: pd.Series(column)}).to_parquet(file)
                )
            )
        except Exception:  # no table can hold these
            return
        path.write_bytes(content[: round(end * len(content))])
        try:
            results.read(folder)
        except SucreBenchError as fault:
            check_names(fault, "scores.parquet")
