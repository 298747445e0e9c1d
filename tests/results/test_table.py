import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pandas as pd
import pytest

from sucre_bench import InputError, results
from sucre_bench.errors import OutputError
from sucre_bench.machine.files import write_atomically
from sucre_bench.results import table
from sucre_bench.results.rows import Row, frame
from sucre_bench.results.table import Part, merge, read

ROW = Row(
    dataset="sea", scene="reef", view="a.png", method="m", options="{}", options_id="o1", metric="psnr",
    variant="masked", region="image", value=1.0, unit="dB", better="higher", n_pixels=4, coverage=0.5, status="ok",
    reason="", seconds=1.0, peak_mb=2.0, device="cpu", seed=0, code="c1.p", data_id="d1",
    time="2026-01-01T00:00:00.000000+00:00",
)  # fmt: skip
LATER = "2026-01-02T00:00:00.000000+00:00"


def write(out: Path, job: str, *rows: Row) -> None:
    part = Part(out, job)
    part.add(rows)
    part.flush()


def test_parts_of_several_jobs_become_one_table(tmp_path: Path):
    write(tmp_path, "one", ROW)
    write(tmp_path, "two", replace(ROW, method="n"))
    assert set(read(tmp_path)["method"]) == {"m", "n"}  # even before they are joined
    merge(tmp_path)
    assert set(pd.read_parquet(tmp_path / "scores.parquet")["method"]) == {"m", "n"}
    assert not (tmp_path / "parts").exists()


def test_the_newest_of_a_score_counts(tmp_path: Path):
    write(tmp_path, "one", ROW)
    merge(tmp_path)
    write(tmp_path, "two", replace(ROW, value=2.0, time=LATER))
    assert read(tmp_path)["value"].tolist() == [2.0]


def test_a_newer_score_replaces_all_regions_of_the_older(tmp_path: Path):
    """A chart that is no longer there must not stay in the table."""
    write(tmp_path, "one", replace(ROW, region="chart1"), replace(ROW, region="chart2"))
    write(tmp_path, "two", replace(ROW, region="chart1", value=2.0, time=LATER))
    assert read(tmp_path)[["region", "value"]].to_numpy().tolist() == [["chart1", 2.0]]


@pytest.mark.parametrize("change", [{"options_id": "o2"}, {"data_id": "d2"}, {"code": "c2.p"}])
def test_scores_of_other_options_data_or_code_are_not_mixed(tmp_path: Path, change: dict[str, str]):
    write(tmp_path, "one", ROW, replace(ROW, metric="ssim"))
    write(tmp_path, "two", replace(ROW, value=2.0, time=LATER, **change))
    assert read(tmp_path)["metric"].tolist() == ["psnr"]


def test_rows_of_one_method_are_read_as_they_are_among_all(tmp_path: Path):
    rows = [replace(ROW, method=m, view=v, dataset=d) for d in ("sea", "lake") for m in "ab" for v in ("1", "2")]
    write(tmp_path, "one", *rows)
    merge(tmp_path)
    write(tmp_path, "two", replace(rows[0], value=5.0, time=LATER))
    whole = read(tmp_path)
    for dataset, method in (("sea", "a"), ("lake", "b"), ("lake", "none")):
        own = whole[(whole["dataset"] == dataset) & (whole["method"] == method)].reset_index(drop=True)
        pd.testing.assert_frame_equal(read(tmp_path, dataset=dataset, method=method), own)


@pytest.mark.parametrize("as_dictionary", [False, True])
def test_a_table_in_row_groups_with_texts_of_their_own_is_read_as_it_is(tmp_path: Path, as_dictionary: bool):
    rows = frame([replace(ROW, view=f"{n}.png", reason=f"because {n % 3}") for n in range(10)])
    text = {name: "category" for name in rows if rows[name].dtype == "str"} if as_dictionary else {}
    rows.astype(text).to_parquet(tmp_path / "scores.parquet", index=False, row_group_size=4)
    pd.testing.assert_frame_equal(read(tmp_path), rows)


def test_another_metrics_code_does_not_matter(tmp_path: Path):
    write(tmp_path, "one", replace(ROW, metric="ssim", code="c1.q"))
    write(tmp_path, "two", replace(ROW, time=LATER))
    assert sorted(read(tmp_path)["metric"]) == ["psnr", "ssim"]


def test_a_folder_without_a_table_is_named(tmp_path: Path):
    with pytest.raises(InputError, match=r"scores\.parquet "):
        read(tmp_path)


def test_a_damaged_table_is_named_and_not_overwritten(tmp_path: Path):
    (tmp_path / "scores.parquet").write_bytes(b"PAR1 but not really")
    write(tmp_path, "one", ROW)
    with pytest.raises(InputError, match=r"scores\.parquet: "):
        merge(tmp_path)
    assert (tmp_path / "scores.parquet").read_bytes() == b"PAR1 but not really"
    assert list((tmp_path / "parts").glob("*.parquet"))


def test_columns_and_types_are_the_same_for_no_rows_and_many():
    assert frame([]).dtypes.to_dict() == frame([ROW, ROW]).dtypes.to_dict()


def test_equal_options_have_equal_ids_whatever_their_order():
    assert results.fingerprint({"a": 1, "b": 2}) == results.fingerprint({"b": 2, "a": 1})
    assert results.fingerprint({"a": 1})[1] != results.fingerprint({"a": 2})[1]


WHOLE = replace(ROW, metric="seconds", variant="wall")


def test_a_try_that_failed_leaves_no_older_scores_standing(tmp_path: Path):
    write(tmp_path, "one", WHOLE, ROW)
    write(tmp_path, "two", replace(WHOLE, status="failed", reason="boom", time=LATER))
    rows = read(tmp_path)
    assert rows[["metric", "status"]].to_numpy().tolist() == [["seconds", "failed"]]


def test_the_failure_of_a_whole_job_is_forgotten_once_it_works(tmp_path: Path):
    write(tmp_path, "one", replace(WHOLE, scene="", view="", data_id="", status="failed", reason="no data"))
    assert read(tmp_path)["status"].tolist() == ["failed"]
    write(tmp_path, "two", replace(WHOLE, time=LATER))
    assert read(tmp_path)["status"].tolist() == ["ok"]


def test_two_jobs_of_one_process_and_name_keep_all_their_rows(tmp_path: Path):
    write(tmp_path, "same", ROW)
    write(tmp_path, "same", replace(ROW, view="b.png"))
    assert set(read(tmp_path)["view"]) == {"a.png", "b.png"}


@pytest.mark.parametrize("place", ["a_file/out.txt", "x" * 300 + "/out.txt"])
def test_a_place_that_cannot_be_written_to_is_one_line(tmp_path: Path, place: str):
    (tmp_path / "a_file").write_text("")
    with pytest.raises(OutputError, match=f"^{re.escape(str(tmp_path / place.split('/')[0]))}.*: ") as fault:
        write_atomically(tmp_path / place, b"")
    assert "\n" not in str(fault.value)
    assert [path.name for path in tmp_path.iterdir()] == ["a_file"]


def test_a_long_job_writes_each_row_a_few_times_into_few_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    written = []
    whole = table.write_atomically

    def counted(path: Path, content: bytes) -> None:
        whole(path, content)
        written.append(len(pd.read_parquet(path)))

    monkeypatch.setattr(table, "write_atomically", counted)
    part = results.Part(tmp_path, "job")
    for n in range(200):
        part.add([results.Row(dataset="d", scene="s", view=f"{n}.png", method="m", value=float(n))])
        part.flush()
    assert sum(written) <= 200 * 4
    assert len(list((tmp_path / "parts").iterdir())) <= 3 * 8
    assert sorted(results.merge(tmp_path)["value"]) == list(range(200))


def test_a_clock_that_was_set_back_leaves_the_last_row_the_newest(tmp_path: Path):
    """Ten days back: what a rerun mended must not stay failed."""
    future = (datetime.now(UTC) + timedelta(days=10)).isoformat(timespec="microseconds")
    same = {"dataset": "d", "scene": "s", "view": "a.png", "method": "m"}
    for row in (
        lambda: results.Row(**same, status="failed", reason="cut", time=future),
        lambda: results.Row(**same, value=1.0),
    ):
        part = results.Part(tmp_path, "job")
        part.add([row()])
        part.flush()
        rows = results.merge(tmp_path)
    assert rows["status"].tolist() == ["ok"]
