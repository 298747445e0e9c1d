"""Which public variant gives a published table's numbers: `sucre-bench score IMAGES --like TABLE.csv`."""

import functools
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.command_line import Done
from support.messages import names
from support.places import published

Bench = Callable[..., Done]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two methods' pictures of two scenes, 71x90 pixels."""
    rng = np.random.default_rng(0)
    for k, method in enumerate(("ours", "theirs")):
        (tmp_path / "images" / method).mkdir(parents=True)
        for n in range(2):
            smooth = cv2.GaussianBlur(rng.random((71, 90, 3)), (0, 0), 3 + k)
            picture = ((smooth - smooth.min()) / np.ptp(smooth) * 255).astype(np.uint8)
            cv2.imwrite(str(tmp_path / "images" / method / f"{n}.png"), picture)
    return tmp_path / "images"


FEW = ("--metrics", "uciqe:hue,uciqe:matlab")  # every form takes a second


@pytest.fixture
def scores(bench: Bench, folder: Path) -> Callable[[str], dict[str, float]]:
    """The value of "name:variant" for each picture."""

    def of(metric: str) -> dict[str, float]:
        rows = json.loads(bench("score", str(folder), "--metrics", metric, "--json").stdout)
        return {row["view"]: row["value"] for row in rows}

    return of


@pytest.fixture
def like(bench: Bench, folder: Path, tmp_path: Path) -> Bench:
    """A command that compares the images with a table, whose headers and rows are given."""

    def compared(
        headers: str, rows: Sequence[Sequence[object]], *words: str, images: Path = folder
    ) -> Done:
        lines = [headers, *(",".join(str(cell) for cell in row) for row in rows)]
        (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
        return bench("score", str(images), "--like", str(tmp_path / "t.csv"), "--json", *words)

    return compared


def matches(done: Done) -> dict[str, list[dict[str, object]]]:
    """The variants by the column they were compared with, the nearest first."""
    assert done.returncode == 0, done.stderr
    found: dict[str, list[dict[str, object]]] = {}
    for record in json.loads(done.stdout):
        found.setdefault(record["column"], []).append(record)
    return found


@pytest.mark.parametrize("variant", ["getuiqm1", "block8@256-bilinear"])
def test_the_variant_behind_rounded_numbers_is_named(
    like: Bench, scores: Callable[[str], dict[str, float]], variant: str
) -> None:
    rows = [(name, f"{value:.3f}") for name, value in scores(f"uiqm:{variant}").items()]
    found = matches(like("Image,UIQM ↑", rows))["UIQM ↑"]
    assert found[0]["variant"] == variant
    assert [record["fits"] for record in found] == [True] + [False] * (len(found) - 1)
    assert found[0]["largest"] <= 0.0005
    others = [record["mean"] for record in found[1:]]
    assert others == sorted(others), "the nearest first"


def test_a_row_a_method_is_the_mean_of_its_folder(
    like: Bench, scores: Callable[[str], dict[str, float]]
) -> None:
    values = scores("uciqe:hue")
    ours, theirs = (
        np.mean([v for name, v in values.items() if name.startswith(m)])
        for m in ("ours", "theirs")
    )
    (found,) = matches(
        like("Method,Venue,UCIQE", [("Ours", "TIP", ours), ("Theirs", "", theirs)], *FEW)
    ).values()
    assert (found[0]["variant"], found[0]["compared"]) == ("hue", 2)
    assert found[0]["largest"] < 1e-9


def test_a_column_that_needs_references_asks_for_them(like: Bench) -> None:
    done = like("image,PSNR (dB)", [("ours/0.png", 20), ("ours/1.png", 21)])
    assert done.returncode == 2
    assert "column 'PSNR (dB)' needs reference; give --reference" in done.stderr


def test_u45s_table_is_that_of_matlab_and_its_first_output(bench: Bench) -> None:
    place = published("u45_published")
    done = bench("score", str(place / "RED"), "--like", str(place / "published.csv"), "--json")
    best = {column: found[0] for column, found in matches(done).items()}
    first = "matlab-first-output"
    expected = {
        "uciqe": "matlab",
        "uiqm": first,
        "uicm": first,
        "uiconm": "matlab",
        "uism": "matlab",
    }
    assert {column: one["variant"] for column, one in best.items()} == expected
    assert all(one["fits"] for one in best.values())


@pytest.mark.parametrize(
    "text",
    [
        "image,PSNR/SSIM\n0001,{0:.3f}/0.5\n0002,{1:.3f}/0.5\n",
        "image;avg_psnr (dB);ssim_value\n1;{0:.3f} ± 0.1;0.5\n2;{1:.3f} ± 0.1;0.5\n",
        "# Results\n\n| Name | PSNR ↑ (SSIM ↑) |\n|--|--:|\n| 01 | **{0:.3f}** (0.5) |\n| 02 | {1:.3f} (0.5) |\n",
        "| Metric | 1.png | 2.png |\n|---|---|---|\n| PSNR | {0:.3f} | {1:.3f} |\n| SSIM | 0.5 | 0.5 |\n",
        "\\begin{{tabular}}{{lcc}}\n\\toprule\nName & PSNR$\\uparrow$ & SSIM \\\\ \\midrule\n"
        "1 & \\textbf{{{0:.3f}}} & 0.5 \\\\\n2 & {1:.3f} & 0.5 \\\\ \\bottomrule\n\\end{{tabular}}\n",
    ],
)
def test_tables_of_other_shapes_are_read(bench: Bench, tmp_path: Path, text: str) -> None:
    """The first number of a cell is that of the first metric, whatever Python's hash seed is."""
    rng, values = np.random.default_rng(3), []
    for n in (1, 2):
        truth = rng.integers(0, 200, (20, 30, 3)).astype(np.uint8)
        picture = truth + rng.integers(0, 50, truth.shape).astype(np.uint8)
        for name, image in (("out", picture), ("truth", truth)):
            (tmp_path / name).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / name / f"{n}.png"), image)
        values.append(np.mean((truth.astype(float) - picture) ** 2))
    psnr = [10 * np.log10(255**2 / value) for value in values]
    (tmp_path / "t.md").write_text(text.format(*psnr))
    few = ("--metrics", "psnr:unmasked,ssim:gaussian-unmasked")  # to try every form takes 1 s
    done = bench("score", "out", "--reference", "truth", "--like", "t.md", "--json", *few)
    best = {}
    for record in json.loads(done.stdout):
        best.setdefault(record["metric"], (record["fits"], record["compared"]))
    assert best == {"psnr": (True, 2), "ssim": (False, 2)}


def test_bytes_that_wrap_around_are_a_form(ask: Bench, pairs: tuple[str, str]) -> None:
    published = np.mean(published_psnr(*pairs, wraps=True))
    found = matches(ask("--like", f"psnr={published:.4f}", "--json"))
    assert found["psnr"][0]["variant"] == "wrapped@64-bilinear"


# -- bad input ---------------------------------------------------------------------------------------------------


def test_fewer_rows_and_rows_of_other_images_are_warnings(
    like: Bench, scores: Callable[[str], dict[str, float]]
) -> None:
    values = scores("uciqe:hue")
    rows = [(name, values[name], 0.5) for name in ("ours/0.png", "theirs/1.png")]
    done = like(
        "image,uciqe,LPIPS", [*rows, ("ours/9.png", 1, 0.5), ("ours/1", "-", 0.5)], *FEW
    )
    assert done.returncode == 0
    assert re.search("not read.*: LPIPS", done.stderr)
    assert re.search(r"\b1 row\b", done.stderr)
    assert "ours/9.png" in done.stderr
    assert re.search(r"\b1 image\b.*: theirs/0\.png", done.stderr)
    assert re.search("'uciqe' .*1 row: ours/1", done.stderr)
    assert matches(done)["uciqe"][0]["variant"] == "hue"


@pytest.mark.parametrize(
    ("headers", "rows", "named"),
    [
        ("image,uciqe", [("a.png", 1), ("b.png", 2)], {"none", "4", "ours/0.png"}),
        ("uciqe,uiqm", [(1, 2), (3, 4)], {"none", "4", "ours/0.png"}),
        ("image,sharpness", [("ours/0.png", 1)], {"metric", "image", "sharpness"}),
        ("image,psi", [("ours/0.png", 1)], {"'psi'", "charts"}),
        ("image,uciqe", [("ours/0.png", "high")], {"number"}),
        ("image,uciqe", [], {"rows", "headers"}),
        ("image,uciqe", [("ours/0.png", 1), ("ours/0.png", 2)], {"several", "ours/0.png"}),
    ],
)
def test_a_table_that_cannot_be_compared_is_one_line(
    like: Bench, tmp_path: Path, headers: str, rows: list[tuple[object, ...]], named: set[str]
) -> None:
    done = like(headers, rows)
    assert done.returncode == 2
    (line,) = done.errors
    assert line.startswith(f"error: {tmp_path / 't.csv'}: ")
    assert named <= names(line)


# -- an author's question ------------------------------------------------------------------------------------------


@pytest.fixture
def pairs(tmp_path: Path) -> tuple[str, str]:
    """Four outputs of 64x64 pixels, 0_ours.png and so on, and their references of 128x96, 0.jpg and so on."""
    rng = np.random.default_rng(5)
    for name in ("out", "truth"):
        (tmp_path / name).mkdir()
    for n in range(4):
        smooth = cv2.GaussianBlur(rng.random((96, 128, 3)), (0, 0), 4)
        truth = ((smooth - smooth.min()) / np.ptp(smooth) * 255).astype(np.uint8)
        cv2.imwrite(
            str(tmp_path / "truth" / f"{n}.jpg"), truth, [cv2.IMWRITE_JPEG_QUALITY, 100]
        )
        small = cv2.resize(truth, (64, 64)).astype(int) + rng.integers(-30, 30, 3)
        cv2.imwrite(
            str(tmp_path / "out" / f"{n}_ours.png"), small.clip(0, 255).astype(np.uint8)
        )
    return str(tmp_path / "out"), str(tmp_path / "truth")


@pytest.fixture
def ask(bench: Bench, pairs: tuple[str, str]) -> Bench:
    """A command that scores the pairs."""
    return functools.partial(bench, "score", pairs[0], "--reference", pairs[1])


def published_psnr(
    out: str, truth: str, gray: bool = False, crop: int = 0, wraps: bool = False
) -> list[float]:
    """By the formula, of OpenCV's bilinear 64x64 pixels. wraps: of uint8, as many programs do."""
    values = []
    for n in range(4):
        reference = cv2.resize(cv2.imread(f"{truth}/{n}.jpg"), (64, 64))
        picture = cv2.imread(f"{out}/{n}_ours.png")
        if gray:
            picture, reference = (
                cv2.cvtColor(x, cv2.COLOR_BGR2GRAY) for x in (picture, reference)
            )
        error = (picture if wraps else picture.astype(float)) - reference
        error = error[crop : 64 - crop, crop : 64 - crop]
        values.append(10 * np.log10(255**2 / np.mean(error**2)))
    return values


def test_one_number_gets_a_sentence_with_colours_size_and_rgb(
    ask: Bench, pairs: tuple[str, str]
) -> None:
    gray, rgb = np.mean(published_psnr(*pairs, gray=True)), np.mean(published_psnr(*pairs))
    done = ask("--like", f"psnr={gray:.2f}")
    sentence = next(line for line in done.stdout.splitlines() if line.startswith("Your"))
    for words in (
        f"Your {gray:.2f} is",
        "gray PSNR",
        "at 64x64 (psnr:luma@64-bilinear)",
        "no named set",
        f"in RGB it is {rgb:.2f}",
    ):
        assert words in sentence


def test_one_form_answers_all_numbers(ask: Bench, pairs: tuple[str, str]) -> None:
    """SSIM is tried at the size that fits PSNR: here a number that another size gives too."""
    rgb = published_psnr(*pairs)
    ssim = json.loads(ask("--metrics", "ssim:gaussian-unmasked@64-bilinear", "--json").stdout)
    published = f"psnr={np.mean(rgb):.3f},ssim={np.mean([row['value'] for row in ssim]):.3f}"
    said = [
        line for line in ask("--like", published).stdout.splitlines() if line.startswith("Your")
    ]
    assert ["@64-bilinear)" in line for line in said] == [True, True], said


@pytest.mark.parametrize(
    ("name", "crop", "form", "words"),
    [
        (
            "result\\{n}.png",
            0,
            "unmasked@64-bilinear",
            ("--metrics", "psnr:unmasked@64-bilinear"),
        ),
        # cropped edges are found where no usual form fits
        ("{n}", 4, "unmasked@64-bilinear@crop4", ()),
    ],
)
def test_a_paper_may_name_other_suffixes_and_folders(
    ask: Bench,
    pairs: tuple[str, str],
    tmp_path: Path,
    name: str,
    crop: int,
    form: str,
    words: tuple[str, ...],
):
    values = published_psnr(*pairs, crop=crop)
    rows = [f"{name.format(n=n)};{value:.3f}" for n, value in enumerate(values)]
    (tmp_path / "t.csv").write_text("image;PSNR\n" + "\n".join(rows) + "\n")
    best = matches(ask("--like", str(tmp_path / "t.csv"), "--json", *words))["PSNR"][0]
    assert (best["variant"], best["compared"], best["fits"]) == (form, 4, True)


@pytest.mark.parametrize("is_percent", [False, True])
def test_percent_and_commas_are_read(ask: Bench, is_percent: bool):
    words = ("--json", "--metrics", "ssim:uniform7-unmasked@64")
    mean = np.mean([row["value"] for row in json.loads(ask(*words).stdout)])
    text = f"{100 * mean:.1f}" if is_percent else f"{mean:.3f}".replace(".", ",")
    done = ask(*words, "--like", f"ssim={text}")
    assert [one["fits"] for one in matches(done)["ssim"]] == [True]
    assert ("as percent" in done.stderr) == is_percent
