"""A bundle from `sucre-bench bundle`, checked by `sucre-bench verify`: what holds, and what was altered."""

import hashlib
import io
import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
from support.colmap_folder import picture, write_dive, write_image
from support.command_line import succeeded

QUIET = ("tracking.uri=off", "report=false")
MADE = ("dataset=demo", "dataset.width=160", "dataset.height=120", "dataset.views=2")
SMALL = ("dataset=demo", "dataset.width=64", "dataset.height=48", "dataset.views=2")

HALF = """
from dataclasses import dataclass
import numpy as np
from sucre_bench import Restoration, method

@method()
@dataclass(frozen=True)
class Half:
    def restore(self, scene, view):
        image = view.rgb * 1.2
        image[:, :16] = np.nan
        image[:, 16:18] = 0
        return Restoration(image, filled=np.full_like(image, 0.5))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in which one method has black pixels, and holes that its picture fills; and the data it is of."""
    place = tmp_path_factory.mktemp("run")
    (place / "half.py").write_text(HALF)
    words = (*SMALL, "method=gray_world,half", "metrics=[psnr,uciqe,coverage,negative]", *QUIET)
    succeeded(
        place, "run", "-m", "--plugin", "half.py", *words, "out=results", "dataset.root=dive"
    )
    for pictures in ("none", "restored", "all"):
        succeeded(place, "bundle", "results", f"{pictures}.zip", "--pictures", pictures)
    return place


@pytest.fixture
def bundles(folder: Path, tmp_path: Path) -> Path:
    """The bundles alone, as somebody else gets them."""
    for file in folder.glob("*.zip"):
        shutil.copy(file, tmp_path)
    return tmp_path


def verified(bench: Callable[..., Any], *words: str) -> tuple[int, dict[str, Any]]:
    done = bench("verify", *words, "--json")
    assert done.stdout, done.stderr
    return done.returncode, json.loads(done.stdout)


def rewritten(path: Path, change: Callable[[dict[str, bytes]], None]) -> None:
    """Change files of a bundle, and its hashes so that they hold: what a forger would do."""
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    change(files)
    manifest = json.loads(files["bundle.json"])
    manifest["inside"] = {
        name: {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
        for name, data in files.items()
        if name != "bundle.json"
    }
    files["bundle.json"] = json.dumps(manifest).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)


def with_table(change: Callable[[pd.DataFrame], Any]) -> Callable[[dict[str, bytes]], None]:
    """change: alters the table, or returns another."""

    def of(files: dict[str, bytes]) -> None:
        rows = pd.read_csv(io.BytesIO(files["scores.csv"]), keep_default_na=False)
        changed = change(rows)
        files["scores.csv"] = (
            (rows if changed is None else changed).to_csv(index=False).encode()
        )

    return of


def test_scores_come_out_again_from_the_pictures_and_the_data(
    bench, bundles: Path, folder: Path
):
    status, found = verified(bench, "restored.zip", "--data", str(folder / "dive"))
    assert (status, found["holds"], found["differing"], found["faults"]) == (0, True, [], [])
    assert found["n_common"] == 8  # of psnr and uciqe, two methods on two views
    assert found["n_agree"] - found["n_common"] == 12  # the same, and coverage
    assert sum(found["unchecked"].values()) == 4  # negative intensities are not in a picture


def test_pixels_that_rounding_moves_over_a_limit_of_faults_do_not_make_a_bundle_differ(
    bench, tmp_path: Path
):
    words = (*MADE, "method=gray_world", "metrics=[faults,saturated_red,seams]", *QUIET)
    succeeded(tmp_path, "run", *words, "out=results", "dataset.root=dive")
    succeeded(tmp_path, "bundle", "results", "b.zip", "--pictures", "restored")
    status, found = verified(bench, "b.zip", "--data", "dive")
    assert (status, found["differing"]) == (0, [])
    assert found["n_agree"] > 0, "most shares stay as they are"

    def flatter(rows: pd.DataFrame) -> None:
        rows.loc[rows["metric"] == "saturated_red", "value"] = "0.9"

    rewritten(tmp_path / "b.zip", with_table(flatter))
    _, forged = verified(bench, "b.zip", "--data", "dive")
    assert {score["metric"] for score in forged["differing"]} == {"saturated_red"}


def test_scores_of_other_options_are_not_computed_again(bench, tmp_path: Path):
    words = (*SMALL, "method=gray_world", "metrics=[hazy]", "metrics.hazy.level=0.5", *QUIET)
    (tmp_path / "hazy.py").write_text(HAZY)
    succeeded(tmp_path, "run", "--plugin", "hazy.py", *words, "out=results")
    succeeded(tmp_path, "bundle", "results", "b.zip", "--pictures", "restored")
    status, found = verified(bench, "b.zip", "--plugin", "hazy.py")
    assert (status, found["n_agree"], sum(found["unchecked"].values())) == (0, 0, 2)


HAZY = """
from dataclasses import dataclass
from sucre_bench import Score, metric

@metric(variants={"share": "of all pixels"}, unit="", better="higher", range=(0, 1))
@dataclass(frozen=True)
class Hazy:
    "How many pixels are hazy."

    level: float = 0.3

    def score(self, restored, shown, view, variant):
        yield Score(float((shown[..., 0] > self.level).mean()))
"""


@pytest.fixture(scope="module")
def charted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scores of single patches, of which each has few pixels, and of hues near 0 and near gray."""
    place = tmp_path_factory.mktemp("charted")
    words = (*MADE, "method=gray_world,seathru", "metrics=[psi,de00,hue:all,water]", *QUIET)
    succeeded(place, "run", "-m", *words, "out=results")
    succeeded(place, "bundle", "results", "b.zip", "--pictures", "restored")
    (place / "empty").mkdir()
    return place


def test_rounding_to_8_bits_is_no_difference_of_a_patch(bench, charted: Path):
    status, found = verified(bench, str(charted / "b.zip"), "--data", str(charted / "empty"))
    assert (status, found["differing"], found["unchecked"]) == (0, [], {})
    assert not list((charted / "empty").iterdir()), "made data are kept elsewhere"
    status, found = verified(bench, str(charted / "b.zip"))
    assert (status, found["n_agree"]) == (0, 0), (
        "the true water is in the data, not in the bundle's records"
    )


@pytest.mark.parametrize("bits", [8, 16])
def test_rounding_of_pictures_is_no_difference_and_more_than_that_is(
    bench, tmp_path: Path, bits: int
):
    (tmp_path / "half.py").write_text(HALF)
    words = (*MADE, "method=gray_world,half", "metrics=[psnr,ssim]", f"bits={bits}", *QUIET)
    run = ("run", "-m", "--plugin", "half.py", *words, "out=results", "dataset.root=dive")
    succeeded(tmp_path, *run)
    succeeded(tmp_path, "bundle", "results", "b.zip", "--pictures", "restored")
    _, honest = verified(bench, "b.zip", "--data", "dive")
    assert (honest["differing"], honest["unchecked"], honest["faults"]) == ([], {}, [])

    rewritten(tmp_path / "b.zip", with_table(scaled("psnr", "half", 1.02)))
    _, forged = verified(bench, "b.zip", "--data", "dive")
    assert {(score["metric"], score["method"]) for score in forged["differing"]} == {
        ("psnr", "half")
    }


@pytest.mark.parametrize(("metric", "change"), [("de00", 3.0), ("hue", 30.0)])
def test_a_patch_that_was_flattered_is_found_out(
    bench, charted: Path, tmp_path: Path, metric: str, change: float
):
    shutil.copy(charted / "b.zip", tmp_path / "b.zip")

    def flatter(rows: pd.DataFrame) -> None:
        first = rows[
            (rows["metric"] == metric)
            & rows["region"].str.contains("/")
            & (rows["status"] == "ok")
        ].index[0]
        rows["value"] = rows["value"].where(
            rows.index != first, pd.to_numeric(rows["value"]) + change
        )

    rewritten(tmp_path / "b.zip", with_table(flatter))
    status, found = verified(bench, "b.zip", "--data", str(charted / "empty"))
    assert (status, [one["metric"] for one in found["differing"]]) == (1, [metric])


def test_data_that_are_not_there_are_not_made(bench, bundles: Path):
    for words, said in ((["nothere"], "nothere: "), (["reef=."], "no dataset 'reef'")):
        done = bench("verify", "restored.zip", "--data", *words)
        assert done.returncode == 2
        assert said in done.stderr
    assert not (bundles / "nothere").exists()


def test_references_in_the_bundle_stand_for_the_data(bench, bundles: Path):
    status, found = verified(bench, "all.zip")
    assert (status, found["n_agree"]) == (0, 20)
    status, found = verified(bench, "restored.zip")
    assert (status, found["n_agree"], found["n_common"]) == (0, 12, 4)


def test_without_pictures_no_score_is_called_verified(bench, bundles: Path):
    status, found = verified(bench, "none.zip")
    assert (status, found["n_agree"], sum(found["unchecked"].values())) == (0, 0, 24)
    said = bench("verify", "none.zip").stdout
    assert "verified" not in said.splitlines()[-1]
    assert "bundle --pictures restored" in said


def test_the_published_id_tells_bundles_apart(bench, bundles: Path):
    _, found = verified(bench, "all.zip")
    assert verified(bench, "all.zip", "--id", found["id"].upper())[0] == 0
    assert verified(bench, "restored.zip", "--id", found["id"])[0] == 1


def scaled(
    metric: str, method: str, factor: float, is_common: bool = False
) -> Callable[[pd.DataFrame], None]:
    """A change of the scores of a method by a metric, on own pixels or on common ones."""

    def of(rows: pd.DataFrame) -> None:
        wanted = (rows["metric"] == metric) & (rows["method"] == method)
        wanted &= rows["variant"].str.endswith("@common") == is_common
        rows["value"] = pd.to_numeric(rows["value"]).where(
            ~wanted, pd.to_numeric(rows["value"]) * factor
        )

    return of


def brighter(files: dict[str, bytes]) -> None:
    name = "restored/demo/gray_world/view_000.png"
    image = cv2.imdecode(np.frombuffer(files[name], np.uint8), cv2.IMREAD_COLOR)
    files[name] = cv2.imencode(".png", cv2.convertScaleAbs(image, alpha=1.3))[1].tobytes()


def more_holes(rows: pd.DataFrame) -> None:
    rows.loc[(rows["metric"] == "seconds") & (rows["method"] == "half"), "n_pixels"] = 5


def other_pixels(rows: pd.DataFrame) -> None:
    rows.loc[rows["metric"] == "common_pixels", "code"] = "0123456789abcdef"


# What a forger changes -> fields of the scores that differ, and their values; or a word of the fault.
FORGERIES: dict[str, tuple[Callable[[dict[str, bytes]], None], str, tuple[str, ...]]] = {
    "a score": (
        with_table(scaled("uciqe", "gray_world", 1.002)), "pixels metric method", ("own", "uciqe", "gray_world")
    ),
    "a score on common pixels": (
        with_table(scaled("psnr", "half", 1.002, is_common=True)), "pixels metric method", ("common", "psnr", "half")
    ),
    "a picture": (brighter, "method view", ("gray_world", "view_000.png")),
    "common pixels": (with_table(other_pixels), "", ("common",)),
    "the better direction": (with_table(lambda rows: rows.replace({"better": {"higher": "lower"}})), "", ("psnr",)),
    "fewer holes than the picture has": (with_table(more_holes), "", ("half",)),
}  # fmt: skip


@pytest.mark.parametrize("forged", FORGERIES)
def test_what_a_forger_changes_is_found_out(bench, bundles: Path, folder: Path, forged: str):
    change, fields, expected = FORGERIES[forged]
    rewritten(bundles / "restored.zip", change)
    status, found = verified(bench, "restored.zip", "--data", str(folder / "dive"))
    assert status == 1
    if fields:
        assert {
            tuple(one[field] for field in fields.split()) for one in found["differing"]
        } == {expected}
    else:
        assert any(expected[0] in fault for fault in found["faults"])


def test_a_tolerance_lets_scores_differ(bench, bundles: Path):
    rewritten(bundles / "restored.zip", with_table(scaled("uciqe", "gray_world", 1.1)))
    assert verified(bench, "restored.zip", "--tolerance", "0.2")[0] == 0


def test_data_that_changed_since_are_named(bench, tmp_path: Path):
    write_dive(tmp_path / "dive", ("a.png", "b.png"))
    words = ("dataset=colmap", "dataset.root=dive", "method=gray_world", "metrics=[uciqe]")
    succeeded(tmp_path, "run", *words, *QUIET, "out=results")
    succeeded(tmp_path, "bundle", "results", "b.zip", "--pictures", "restored")
    (tmp_path / "dive").rename(tmp_path / "moved")
    assert verified(bench, "b.zip", "--data", "moved")[0] == 0
    write_image(tmp_path / "moved" / "images" / "b.png", picture(5))
    status, found = verified(bench, "b.zip", "--data", "colmap=moved")
    assert (status, found["differing"]) == (1, [])
    assert any("moved" in fault for fault in found["faults"])


def in_options(**change: Any) -> Callable[[pd.DataFrame], None]:
    def of(rows: pd.DataFrame) -> None:
        rows["options"] = json.dumps({**json.loads(rows["options"][0]), **change})

    return of


@pytest.mark.parametrize("path", ["/etc", "~/private", "../elsewhere"])
def test_a_bundle_opens_no_files_beside_the_data(bench, bundles: Path, folder: Path, path: str):
    elsewhere = in_options(dataset={"name": "colmap", "root": "/", "images": path})
    rewritten(bundles / "restored.zip", with_table(elsewhere))
    status, found = verified(bench, "restored.zip", "--data", str(folder / "dive"))
    assert status == 1
    assert any(path in fault for fault in found["faults"])


ODD: dict[str, Callable[[pd.DataFrame], Any]] = {
    **{f"view {name!r}": lambda rows, name=name: rows.__setitem__("view", name)
       for name in ("..", "/", "../../etc/passwd", "a\x07b", "x" * 400)},
    "no dataset": in_options(dataset=None),
    "unknown dataset": in_options(dataset={"name": "nobody"}),
    "replicate negative": in_options(replicate=-5),
    "pixels": lambda rows: rows.__setitem__("n_pixels", 2**60),
    "metric": lambda rows: rows.__setitem__("metric", "nobody"),
    "no rows": lambda rows: rows[:0],
}  # fmt: skip


@pytest.mark.parametrize("odd", ODD)
def test_odd_words_in_a_table_are_faults_and_no_crash(
    bench, bundles: Path, folder: Path, odd: str
):
    rewritten(bundles / "restored.zip", with_table(ODD[odd]))
    done = bench("verify", "restored.zip", "--data", str(folder / "dive"), "--json")
    assert done.returncode in (1, 2) or json.loads(done.stdout)["unchecked"], (
        "not every score is taken for right"
    )
    assert not (folder / "etc").exists()


def test_plugin_files_that_a_configuration_names_are_not_loaded(
    bench, bundles: Path, tmp_path: Path
):
    (tmp_path / "evil.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\n")

    def name_it(files: dict[str, bytes]) -> None:
        files["config.yaml"] = (
            f"plugins: [{tmp_path / 'evil.py'}]\nx: !!python/object/apply:os.system [id]".encode()
        )

    rewritten(bundles / "all.zip", name_it)
    assert verified(bench, "all.zip")[0] == 0
    assert not (tmp_path / "ran").exists()


def test_a_bundle_is_compared_like_the_folder_it_is_of(bench, bundles: Path, folder: Path):
    """Also on the pixels that all methods fill."""
    tables = {}
    for pixels in ("own", "common"):
        words = ("--metric", "psnr", "--json", "--pixels", pixels)
        tables[pixels] = bench("compare", "none.zip", *words).stdout
        assert tables[pixels] == bench("compare", str(folder / "results"), *words).stdout
    assert tables["own"] != tables["common"]


def test_a_picture_that_is_gone_cannot_be_bundled(bench, folder: Path, tmp_path: Path):
    shutil.copytree(folder / "results", tmp_path / "results")
    (tmp_path / "results/restored/demo/gray_world/view_001.png").unlink()
    done = bench("bundle", "results", "again.zip")
    assert done.returncode == 2
    assert "view_001.png" in done.stderr
    assert not (tmp_path / "again.zip").exists()
