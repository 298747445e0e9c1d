"""Bundles as files: the same bytes each time, what was written comes back, and a stranger's file does no harm."""

import json
import math
import stat
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sucre_bench import results
from sucre_bench.errors import InputError
from sucre_bench.results.bundle_format import Limits, open_bundle, write_bundle
from sucre_bench.results.rows import Row

LIMITS = Limits(entries=20, file_bytes=1 << 22, table_bytes=1 << 22, all_bytes=1 << 23)


def rows() -> pd.DataFrame:
    first = Row(
        "reef",
        "cove",
        "a.png",
        "sucre",
        '{"a": "x,\\"y"}',
        metric="psnr",
        variant="masked",
        value=1 / 3,
        time="2026-01-01",
    )
    more = replace(first, metric="ssim", value=math.inf), replace(first, metric="psi", value=math.nan, status="failed",
                                                                  reason="NA, null: line one\nline two")  # fmt: skip
    return results.frame([first, *more])


def written(path: Path, **files: bytes) -> str:
    return write_bundle(
        path,
        rows(),
        {f"restored/{name}.png": data for name, data in files.items()},
        {},
        "Jane",
        "1.2",
    )


def test_the_same_content_gives_the_same_bytes_wherever_it_is_written(tmp_path: Path):
    ids = [
        written(tmp_path / name / "b.zip", one=b"1", two=b"2" * 5000)
        for name in ("here", "there")
    ]
    assert (tmp_path / "here" / "b.zip").read_bytes() == (
        tmp_path / "there" / "b.zip"
    ).read_bytes()
    assert ids[0] == ids[1] != written(tmp_path / "c.zip", one=b"1", two=b"3" * 5000)


@pytest.mark.parametrize(
    "value", [14.689221706938191, -6.211417699675681, 1e-300, 0.1 + 0.2, 5e22]
)
def test_every_digit_of_a_score_comes_back_however_numpy_prints(tmp_path: Path, value: float):
    scores = rows().assign(value=value)
    with np.printoptions(legacy="1.13", precision=3):
        # what some packages set for the whole process
        write_bundle(tmp_path / "b.zip", scores, {}, {}, "Jane", "1.2")
    with open_bundle(tmp_path / "b.zip") as bundle:
        assert list(bundle.rows["value"]) == [value] * len(scores)


def test_an_altered_file_is_named(tmp_path: Path):
    written(tmp_path / "b.zip", one=b"picture", two=b"other")
    with (
        zipfile.ZipFile(tmp_path / "b.zip") as old,
        zipfile.ZipFile(tmp_path / "c.zip", "w") as new,
    ):
        for name in old.namelist():
            if name != "restored/two.png":
                new.writestr(name, b"forged!" if name == "restored/one.png" else old.read(name))
        new.writestr("restored/three.png", b"more")
    with open_bundle(tmp_path / "c.zip") as bundle:
        names = ("one", "two", "three")
        faults = [bundle.fault_of(f"restored/{name}.png") for name in names]
        assert all(faults)
        assert len(set(faults)) == 3
        assert not bundle.fault_of("scores.csv")
        with pytest.raises(InputError, match=r"one\.png"):
            bundle.read("restored/one.png")


def entry(name: str, mode: int = stat.S_IFREG | 0o644) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.external_attr = mode << 16
    return info


HOSTILE = {
    "nameless": [(entry(""), b"x")],
    "parent": [(entry("../evil"), b"x")],
    "inner parent": [(entry("restored/../../evil"), b"x")],
    "absolute": [(entry("/etc/evil"), b"x")],
    "drive": [(entry("C:/evil"), b"x")],
    "backslash": [(entry("restored\\evil"), b"x")],
    "control": [(entry("restored/e\nvil"), b"x")],
    "link": [(entry("restored/a.png", stat.S_IFLNK | 0o777), b"/etc/passwd")],
    "folder": [(entry("restored/", stat.S_IFDIR | 0o755), b"")],
    "device": [(entry("restored/a.png", stat.S_IFCHR | 0o644), b"")],
    "bomb": [(entry("restored/a.png"), b"\0" * (2 << 20))],
    "large": [(entry("restored/a.png"), b"\0" * ((4 << 20) + 1))],
    "large in all": [(entry(f"restored/{n}.png"), b"\0" * (1 << 20)) for n in range(8)],
    "many": [(entry(f"restored/{n}.png"), b"") for n in range(20)],
    "twice": [(entry("restored/a.png"), b"1"), (entry("restored/A.png"), b"2")],
    "long": [(entry("restored/" + "a" * 600), b"")],
}


@pytest.mark.parametrize("what", HOSTILE)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_hostile_bundle_is_refused_before_anything_is_read(tmp_path: Path, what: str):
    path = tmp_path / "b.zip"
    written(path)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        for info, content in HOSTILE[what]:
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, content)
    with pytest.raises(InputError, match=r"b\.zip"), open_bundle(path, LIMITS):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["b.zip"]


EMPTY = {
    "format": "sucre_bench bundle",
    "version": 1,
    "sucre_bench": "",
    "inside": {},
    "outside": {},
    "by": "",
}


def with_size(size: object) -> bytes:
    """A manifest that says this of the size of a picture."""
    outside = {"restored/a.png": {"sha256": "0" * 64, "bytes": size}}
    return json.dumps({**EMPTY, "outside": outside}).encode()


@pytest.mark.parametrize(
    "manifest",
    [
        b"no JSON", b"[]", b"{}", b'"text"', b"[" * 100_000,
        *(json.dumps({**EMPTY, **change}).encode() for change in ({"version": 2}, {"inside": [1]}, {"by": "\udc80"})),
        *(with_size(size) for size in (True, 1.5, "9", None, math.inf)),
    ],
)  # fmt: skip
def test_a_manifest_of_another_kind_is_refused(tmp_path: Path, manifest: bytes):
    with zipfile.ZipFile(tmp_path / "b.zip", "w") as archive:
        archive.writestr("bundle.json", manifest)
    with (
        pytest.raises(InputError, match=r"^.*bundle\.json.*$"),
        open_bundle(tmp_path / "b.zip"),
    ):
        pass


@pytest.mark.parametrize(
    "table", [b"", b"a,b\n1,2\n", b"\xff\xfe\x00", b"dataset\n" + b"x\n" * 5]
)
def test_a_table_of_another_kind_is_refused(tmp_path: Path, table: bytes):
    """Although its hash holds."""
    write_bundle(tmp_path / "b.zip", rows(), {"scores.csv": table}, {}, "", "")
    with (
        open_bundle(tmp_path / "b.zip") as bundle,
        pytest.raises(InputError, match=r"scores\.csv"),
    ):
        _ = bundle.rows


def test_a_results_folder_is_no_bundle_and_the_command_that_makes_one_is_named(tmp_path: Path):
    with pytest.raises(InputError, match="sucre-bench bundle"), open_bundle(tmp_path):
        pass


def test_a_bundle_cut_short_is_refused(tmp_path: Path):
    written(tmp_path / "b.zip", one=b"picture" * 100)
    content = (tmp_path / "b.zip").read_bytes()
    for share in (0.3, 0.9):
        (tmp_path / "cut.zip").write_bytes(content[: int(len(content) * share)])
        with pytest.raises(InputError, match=r"cut\.zip"), open_bundle(tmp_path / "cut.zip"):
            pass
