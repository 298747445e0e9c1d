"""A lab's board: bundles of several people in tables that mix nothing."""

import html
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from sucre_bench import results
from sucre_bench.errors import InputError
from sucre_bench.programs.site.board import Entry, State, board, write_page
from sucre_bench.results.bundle_format import COMMON, open_bundle, write_bundle
from sucre_bench.results.rows import Row, csv_text

HOSTILE = "<script>alert(1)</script>"
SCORES = {"plain": (20.0, 22.0, 21.0), "clever": (25.0, 27.0, 26.0)}


def rows(method: str, gain: float = 0.0, **other: Any) -> pd.DataFrame:
    """Three views restored by a method."""
    made = []
    for n, value in enumerate(SCORES[method]):
        base = Row("reef", "cove", f"v{n}.png", method, data_id="d1", code="c.m1")
        base = replace(base, **{k: v for k, v in other.items() if k not in ("variant", "metric_code")})
        made.append(replace(base, value=1.0 + n, code="c"))
        code = f"c.{other.get('metric_code', 'm1')}"
        more = {"metric": "psnr", "variant": other.get("variant", "masked"), "unit": "dB", "better": "higher"}
        made.append(replace(base, **more, value=value + gain, code=code))
    return results.frame(made)


def entry(name: str, table: pd.DataFrame, state: State = State.VERIFIED) -> Entry:
    return Entry(f"{name}.zip", name * 4, name, "0.1", state, (3, 3), "", table)


def tables(*entries: Entry) -> list[tuple[set[str], str]]:
    return [({line.entry.by for line in table.lines}, table.apart) for table in board(entries)]


def test_what_may_be_compared_stands_in_one_table():
    (found,) = board([entry("a", rows("plain")), entry("b", rows("clever")), entry("c", rows("plain", 1.0))])
    assert [(line.method, line.entry.by) for line in found.lines] == [("plain", "a"), ("clever", "b"), ("plain", "c")]
    means = [found.comparison.cells[line.label, found.comparison.columns[0]].mean for line in found.lines]
    assert means == pytest.approx([21.0, 26.0, 22.0])
    assert [column.metric for column in found.comparison.columns] == ["psnr"], "seconds of other machines do not count"


def test_copies_of_a_bundle_stand_in_a_table_once_and_coverage_stands_behind_what_decides():
    """A metric that decides is the first column, by which the methods are sorted."""
    table = rows("plain")
    share = table[table["metric"] == "psnr"].assign(metric="coverage", variant="image", unit="share", value=1.0)
    entries = [
        entry("a", pd.concat([share, table])),
        replace(entry("a", table), file="copy.zip"),
        entry("b", rows("clever")),
    ]
    (found,) = board(entries)
    assert [line.entry.by for line in found.lines] == ["a", "b"]
    assert found.comparison.columns[0].metric == "psnr"


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        ({"data_id": "d2"}, "d2"),
        ({"variant": "unmasked"}, "unmasked"),
        ({"metric_code": "m2"}, "version"),
        ({"scene": "bay"}, "different images"),
    ],
)
def test_other_data_variants_versions_and_images_stand_apart(other: dict[str, str], reason: str):
    first, second = tables(entry("a", rows("plain")), entry("b", rows("clever", **other)))
    assert (first, second[0]) == (({"a"}, ""), {"b"})
    assert reason in second[1]


def test_methods_that_fill_different_pixels_are_named_below_their_table(tmp_path: Path):
    for share, expected in ((1.0, False), (0.5, True)):
        with_holes = rows("clever").assign(coverage=share)
        entries = [entry("a", rows("plain")), entry("b", with_holes)]
        page = write_page(tmp_path, entries, board(entries), "Lab").read_text()
        assert ("own pixels" in html.unescape(page)) is expected


def on_common_pixels(table: pd.DataFrame, variant: str = "common") -> pd.DataFrame:
    """Scores on the pixels that the two methods of a table share: 1 dB less than on their own."""
    shares = {f"v{n}.png": f"mask{n}" for n in range(3)}
    of_views = table[(table["metric"] == "seconds") & (table["method"] == "plain")]
    about = {"metric": "common_pixels", "variant": variant, "method": "", "value": 0.5, "code": ""}
    scores = table[table["metric"] == "psnr"]
    common = pd.concat([of_views.assign(**about), scores.assign(value=scores["value"] - 1)], ignore_index=True)
    return common.assign(pixels=common["view"].map(shares), methods='["clever", "plain"]', time=table["time"].max())


def means_of(table: pd.DataFrame, common: pd.DataFrame) -> dict[str, float]:
    (found,) = board([replace(entry("a", table), common=common)])
    return {line.method: found.comparison.cells[line.label, found.comparison.columns[0]].mean for line in found.lines}


def test_scores_on_common_pixels_that_nobody_verified_are_in_no_table():
    """A bundle says scores without the pixels that they are on, or pixels that it says are not known."""
    table = pd.concat([rows("plain"), rows("clever").assign(coverage=0.5)], ignore_index=True)
    common = on_common_pixels(table)
    alone = common[common["metric"] == "psnr"].assign(pixels="")
    for forged in (alone, on_common_pixels(table, "unknown")):
        assert means_of(table, forged) == pytest.approx({"plain": 21.0, "clever": 26.0})


def test_a_bundle_whose_methods_are_no_labels_is_refused(tmp_path: Path):
    table = on_common_pixels(rows("plain")).assign(methods='[["plain"]]')
    write_bundle(tmp_path / "a.zip", rows("plain"), {COMMON: csv_text(table).encode()}, {}, "me", "0.1")
    with open_bundle(tmp_path / "a.zip") as bundle, pytest.raises(InputError, match="methods"):
        _ = bundle.common


def test_a_bundles_scores_on_common_pixels_are_what_its_table_shows(tmp_path: Path):
    """One of two methods leaves half of each view empty; on the pixels of both, both have 1 dB less."""
    table = pd.concat([rows("plain"), rows("clever").assign(coverage=0.5)], ignore_index=True)
    common = on_common_pixels(table)
    assert means_of(table, common) == pytest.approx({"plain": 20.0, "clever": 25.0})
    entries = [replace(entry("a", table), common=common)]
    page = write_page(tmp_path, entries, board(entries), "Lab").read_text()
    assert "all methods" in html.unescape(page)


def test_what_differs_is_in_no_table():
    found = board([entry("a", rows("plain")), entry("b", rows("clever"), State.DIFFERS)])
    assert {line.entry.by for table in found for line in table.lines} == {"a"}


def test_the_page_shows_all_and_runs_nothing(bench: Callable[..., Any], tmp_path: Path):
    (tmp_path / "bundles").mkdir()
    for name, method in (("a", "plain"), ("b", "clever")):
        write_bundle(tmp_path / "bundles" / f"{name}.zip", rows(method), {}, {}, f"{name}{HOSTILE}", "0.1")
    (tmp_path / "bundles" / "broken.zip").write_bytes(b"PK")
    done = bench("site", "bundles", "public", "--title", f"Lab {HOSTILE}")
    assert done.returncode == 1, "one file is no bundle"
    assert "broken.zip" in done.stderr
    page = (tmp_path / "public" / "index.html").read_text()
    assert "<script" not in page
    assert "default-src 'none'" in page
    assert not re.search(r'(?:src|href)="(?!bundles/)', page)
    shown = html.unescape(re.sub(r"<(?!script>|/script>)[^<>]*>", " ", page))
    for word in ("plain", "clever", "26.0", f"a{HOSTILE}", f"Lab {HOSTILE}", "hashes hold", "broken.zip"):
        assert word in shown, word
    assert {path.name for path in (tmp_path / "public" / "bundles").iterdir()} == {"a.zip", "b.zip"}
    assert bench("site", "public", "elsewhere").returncode == 2, "no bundle is there"
