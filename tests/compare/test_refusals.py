import json
import re
from dataclasses import replace
from typing import Any

import pytest
from click.testing import CliRunner
from support.made_rows import ROW, restored

from sucre_bench import compare
from sucre_bench.cli import cli
from sucre_bench.compare.choose_rows import NotComparableError
from sucre_bench.compare.words import left_out
from sucre_bench.results.rows import Row, frame, replicated


def run_of(method: str, views: str = "abcd", **kind: Any) -> list[Row]:
    """A method's restorations of views, and their scores."""
    return [row for view in views for row in restored(method, f"{view}.png", **kind)]


def refused(rows: list[Row], why: str, names: str, **how: Any) -> None:
    """why: words of the one reason; names: a pattern of what the line names."""
    with pytest.raises(NotComparableError, match=names) as fault:
        compare.refuse(frame(rows), **how)
    assert "\n" not in str(fault.value)
    assert why in str(fault.value)


def test_methods_that_ran_on_different_images_are_refused_and_the_difference_said():
    rows = [*run_of("sucre"), *run_of("underwater", "ab"), *run_of("gray_world", "ab")]
    names = r"^sea: .* gray_world on 2, sucre on 4, underwater on 2 \(gray_world not on reef/c\.png\); .* 2 "
    refused(rows, "different images", names)
    compare.refuse(frame(rows), common=True)


def test_nothing_in_common_is_refused_even_so():
    refused(
        [*run_of("a", "ab"), *run_of("b", "cd")],
        "different images",
        r"a on 2, b on 2",
        common=True,
    )


def test_pictures_of_two_named_sets_are_not_averaged():
    of_both = [
        row
        for scene in ("u90", "t90")
        for method in "ab"
        for row in run_of(method, scene=scene)
    ]
    refused(
        of_both,
        "rows are of the test sets t90, u90",
        r"^sea: .* dataset\.label ",
        common=True,
    )
    compare.refuse(frame([row for row in of_both if row.scene == "u90"]))


def repeated(method: str, *replicates: int) -> list[Row]:
    return [row for n in replicates for row in run_of(method, scene=replicated("reef", n))]


@pytest.mark.parametrize(
    "rows",
    [
        [*run_of("a"), *run_of("b", "abc"), replace(run_of("b", "d")[0], status="failed")],
        [*run_of("a"), replace(ROW, method="b", scene="", view="", status="failed")],
        [*repeated("a", 0, 2), *repeated("b", 2, 0)],
        [*run_of("a"), *run_of("b", "ab", dataset="lake")],
    ],
    ids=["an image failed", "a job failed", "the same replicates", "other datasets"],
)
def test_what_was_run_on_the_same_images_is_compared(rows: list[Row]):
    compare.refuse(frame(rows))


def test_methods_that_ran_on_different_replicates_are_refused_and_the_difference_said():
    rows = [*repeated("gray_world", 0, 1, 2), *repeated("underwater", 5)]
    for common in (False, True):
        names = r"^sea: .* gray_world on 12, underwater on 4 \(.* reef,replicate=5/a\.png\); (?!.*--common)"
        refused(rows, "different images", names, common=common)


def test_methods_scored_in_different_variants_only_are_refused():
    rows = [
        replace(ROW, method=m, view="a.png", metric="uciqe", variant=v)
        for m, v in (("a", "x"), ("b", "y"))
    ]
    refused(rows, "in variant", r"uciqe: a .* x, b .* y; .*metrics\.uciqe\.variants=\[x\]")
    compare.refuse(frame([*rows, replace(rows[1], variant="x")]))


@pytest.mark.parametrize(("one", "other"), [("one", "two"), ("one-x", "one-y")])
def test_scores_of_different_versions_or_options_of_a_metric_are_refused(one: str, other: str):
    rows = [
        *run_of("a", code=f"r.{one}", time="2026-01-01"),
        *run_of("b", code=f"s.{other}", time="2026-01-02"),
    ]
    refused(rows, "version or other options", r"psnr \(masked\): a .* b; .* a ")
    compare.refuse(frame([*run_of("a", code="r.one"), *run_of("b", code="s.one")]))


def test_views_from_different_versions_of_a_methods_code_are_refused():
    old, new = f"{'0' * 12}.m", f"{'1' * 12}.m"
    rows = [
        *run_of("a", "ab", code=old, time="2026-01-01"),
        *run_of("a", "cd", code=new, time="2026-01-02"),
    ]
    refused(
        [*rows, *run_of("b", code=old)],
        "another version of its code",
        r"^sea: a: a\.png, b\.png .* d\.png; ",
    )
    (table,) = compare.compare(frame(rows))
    (said,) = left_out(table)
    assert said.startswith("a: a.png, b.png ")
    charts = [
        *run_of("a", "ab", code=old),
        *run_of("a", "cd", scene="wall", code=f"{'0' * 12}{'c' * 12}.m"),
    ]
    compare.refuse(frame(charts))


def test_metrics_that_are_not_asked_for_refuse_nothing():
    rows = [
        *run_of("a", code="r.one", time="2026-01-01"),
        *run_of("b", code="s.two", time="2026-01-02"),
    ]
    rows += [replace(row, metric="ssim", code="r.one") for row in rows if row.metric == "psnr"]
    compare.refuse(frame(rows), metrics=["ssim"])


def shown(label: str, name: str, display: str) -> list[Row]:
    return run_of(label, options=json.dumps({"name": name, "display": display}))


def test_one_method_shown_in_two_ways_is_refused_unless_a_label_says_so():
    plain, stretched = shown("sucre", "sucre", "none"), shown("mine", "sucre", "stretch-1-99")
    names = r"sucre and mine .* sucre, .* none and stretch-1-99; .*method\.label='mine,display=stretch-1-99'"
    refused([*plain, *stretched], "in different ways", names)
    compare.refuse(
        frame([*plain, *shown("sucre,display=stretch-1-99", "sucre", "stretch-1-99")])
    )
    compare.refuse(frame([*plain, *shown("other", "other", "stretch-1-99")]))


def test_a_configuration_for_linear_light_has_a_display_of_its_own() -> None:
    options = {"name": "sucre_plus", "display": "black-0.5-white-99", "encoding": "view"}
    linear = {**options, "display": "white-99", "encoding": "linear"}
    rows = [
        run_of(label, options=json.dumps(o))
        for label, o in (("sucre_plus", options), ("linear", linear))
    ]
    compare.refuse(frame([*rows[0], *rows[1]]))


def test_every_fault_is_a_line():
    rows = [
        *run_of("a", code="r.one", time="2026-01-01"),
        *run_of("b", "ab", code="s.two", time="2026-01-02"),
    ]
    with pytest.raises(NotComparableError) as fault:
        compare.refuse(frame(rows))
    assert len(str(fault.value).splitlines()) == 2


def test_the_command_refuses_and_compares_what_is_common(tmp_path):
    frame([*run_of("a"), *run_of("b", "ab")]).to_parquet(tmp_path / "scores.parquet")
    done = CliRunner().invoke(cli, ["compare", str(tmp_path)])
    assert isinstance(done.exception, NotComparableError)
    done = CliRunner().invoke(
        cli, ["compare", str(tmp_path), "--common", "--metric", "psnr", "--format", "md"]
    )
    assert done.exit_code == 0
    assert re.search(r"\bb .* 2 of 4 images \(2 not run\)", done.output)
