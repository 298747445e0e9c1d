"""Images restored elsewhere: which one is a view's, and what its values mean."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image
from support.made_networks import Trap
from support.messages import refused
from support.restoring_programs import LEVELS as LEVELS_OF_FLOATS, RGB, scene_of

from sucre_bench import (
    InputError,
    NotApplicableError,
    Restoration,
    restore,
)
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.methods.doors import Precomputed
from sucre_bench.methods.doors.precomputed import SUFFIXES, ImageFolder

LEVELS = LEVELS_OF_FLOATS.astype(np.uint8)


def restored(folder: Path, **options: object) -> Restoration:
    scene = scene_of("a.png")
    return restore("precomputed", scene, scene.views[0], folder=folder, **options)


def find_image(folder: Path, name: str, names: list[str], pattern: str = "{stem}") -> Path:
    return ImageFolder(folder, pattern).find(name, names)


def touch(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


# -- which file is a view's --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "there", "pattern", "expected"),
    [
        ("left/a.png", ["left/a.jpg", "right/a.jpg"], "{stem}", "left/a.jpg"),
        ("left/a.png", ["deep/er/a.TIF", "b.png"], "{stem}", "deep/er/a.TIF"),
        ("a.png", ["x/a.png", "a.txt", "ab.png"], "{stem}", "x/a.png"),
        (
            "left/a.png",
            ["left/restored_a.webp", "left/a.png"],
            "restored_{stem}",
            "left/restored_a.webp",
        ),
        ("a.jpg", ["a_out.npy"], "{stem}_out", "a_out.npy"),
        ("a.jpg", ["a.png", "a.npz"], "{stem}.npz", "a.npz"),
        ("a.jpg", ["a.jpg.png", "a.png"], "{name}.png", "a.jpg.png"),
        ("a.jpg", ["a.jpg", "a.png"], "{name}", "a.jpg"),
        ("left/a.png", ["left/out/a.png", "a.png"], "{parent}/out/{stem}", "left/out/a.png"),
        ("a.png", ["out/a.png"], "{parent}/out/{stem}", "out/a.png"),
        ("frame.001.png", ["frame.001.jpg", "frame.002.jpg"], "{stem}", "frame.001.jpg"),
    ],
)
def test_the_image_of_a_view_is_found_by_name(
    tmp_path: Path, name: str, there: list[str], pattern: str, expected: str
):
    touch(tmp_path, *there)
    assert (
        find_image(tmp_path, name, [name], pattern).relative_to(tmp_path).as_posix() == expected
    )


@pytest.mark.parametrize(
    ("views", "there", "named"),
    [
        (["a.png"], ["a.png", "a.npy"], {"a.npy", "a.png", "'{stem}.png'"}),
        (["a.png"], ["x/a.png", "y/a.png"], {"a.png", "y/a.png"}),
        (
            ["left/a.png", "right/a.png"],
            ["a.png"],
            {"left/a.png", "right/a.png", "sub-folders"},
        ),
        (["a.png", "a.jpg"], ["a.png"], {"a.png", "a.jpg"}),
        (["../a.png"], ["a.png"], {"../a.png", "path"}),
        (["/a.png"], ["a.png"], {"/a.png", "path"}),
    ],
)
def test_an_image_is_never_guessed(
    tmp_path: Path, views: list[str], there: list[str], named: set[str]
):
    touch(tmp_path, *there)
    with refused(*named):
        find_image(tmp_path, views[0], views)


def test_a_view_without_an_image_is_skipped_and_told_the_nearest_name(tmp_path: Path):
    touch(tmp_path, "GOPR0013.png", "GOPR0456.png")
    with pytest.raises(NotApplicableError) as fault:
        find_image(tmp_path, "GOPR0012.JPG", ["GOPR0012.JPG"])
    assert re.search(
        rf"{re.escape(str(tmp_path))} .*GOPR0012.* 2 .*GOPR0013$", str(fault.value)
    )
    # no other view's either
    touch(tmp_path, "right/a.png")
    with pytest.raises(NotApplicableError, match=r" left/a or a "):
        find_image(tmp_path, "left/a.png", ["left/a.png", "right/a.png"])
    with pytest.raises(NotApplicableError, match="no images"):
        find_image(tmp_path / "GOPR0013.png", "a.png", ["a.png"])


def test_a_folder_that_has_changed_is_seen_by_the_next_restoration(tmp_path: Path):
    write(tmp_path / "b.png", LEVELS)
    with pytest.raises(NotApplicableError):
        restored(tmp_path)
    write(tmp_path / "a.png", LEVELS)
    np.testing.assert_allclose(restored(tmp_path).image, RGB, atol=1e-6)


def test_a_link_out_of_the_folder_is_refused(tmp_path: Path):
    touch(tmp_path, "elsewhere/a.png", "folder/b.png")
    (tmp_path / "folder" / "a.png").symlink_to(tmp_path / "elsewhere" / "a.png")
    with pytest.raises(InputError, match=r"folder/a\.png: "):
        find_image(tmp_path / "folder", "a.png", ["a.png"])
    with pytest.raises(InputError, match=r"elsewhere/a"):
        find_image(tmp_path / "folder", "a.png", ["a.png"], "../elsewhere/{stem}")


@pytest.mark.parametrize(
    ("pattern", "named"),
    [
        ("{step}", {"'{step}'", "'stem'"}),
        ("restored", {"'restored'", "{stem}"}),
        ("{stem", {"{{", "}}"}),
        ("{stem!r}", {"'{stem!r}'", "format", "{stem}"}),
        ("{stem:>9}", {"'{stem:>9}'", "format", "{stem}"}),
        ("{}", {"'{}'", "placeholder"}),
        ("{stem.__class__}", {"'{stem.__class__}'", "placeholder"}),
    ],
)
def test_a_pattern_that_cannot_work_is_refused_at_once(
    tmp_path: Path, pattern: str, named: set[str]
):
    with refused("method.pattern", *named):
        Precomputed(tmp_path, pattern=pattern)


# -- what the values mean ----------------------------------------------------------------------------------


def write(path: Path, levels: np.ndarray) -> None:
    """With other libraries than the reader's, where there are some. levels: RGB or RGBA."""
    if path.suffix == ".npy":
        np.save(path, levels / np.float32(255))
    elif path.suffix == ".npz":
        np.savez(path, image=levels / np.float32(255), confidence=np.zeros(3))
    elif path.suffix == ".webp":
        Image.fromarray(levels).save(path, lossless=True, exact=True)
    else:
        Image.fromarray(levels).save(path)


def tell(folder: Path, about: dict[str, object]) -> None:
    """Write beside the image of a view what is known about it."""
    (folder / "a.json").write_text(json.dumps(about))


@pytest.mark.parametrize("suffix", [s for s in SUFFIXES if s not in (".jpg", ".jpeg")])
def test_red_is_red_in_every_kind_of_file(tmp_path: Path, suffix: str):
    write(tmp_path / f"a{suffix}", LEVELS)
    np.testing.assert_allclose(restored(tmp_path).image, RGB, atol=1e-6)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".webp", ".npy"])
def test_transparent_pixels_are_holes_and_others_keep_their_colour(tmp_path: Path, suffix: str):
    # a reader that multiplies by it halves the colours
    alpha = np.full((4, 6, 1), 128, np.uint8)
    alpha[0, :2] = 0
    write(tmp_path / f"a{suffix}", np.concatenate([LEVELS, alpha], axis=2))
    image = restored(tmp_path).image
    assert np.isnan(image[0, :2]).all()
    np.testing.assert_allclose(image[1:], RGB[1:], atol=1e-6)
    np.testing.assert_allclose(restored(tmp_path, holes="none").image, RGB, atol=1e-6)


@pytest.mark.parametrize("photometric", ["rgb", "minisblack"])  # the latter stores a row a page
def test_sixteen_bits_and_floats_lose_nothing(tmp_path: Path, photometric: str):
    values = np.random.default_rng(0).random((4, 6, 3)) * 1.4 - 0.2
    tifffile.imwrite(tmp_path / "a.tif", values.astype(np.float32), photometric=photometric)
    np.testing.assert_array_equal(restored(tmp_path).image, values.astype(np.float32))
    (tmp_path / "a.tif").unlink()
    whole = (values.clip(0, 1) * 65535).astype(np.uint16)
    cv2.imwrite(str(tmp_path / "a.png"), whole[..., ::-1])
    np.testing.assert_allclose(restored(tmp_path).image, whole / 65535, atol=1e-7)


def test_gray_is_repeated_and_black_is_a_hole_only_when_asked(tmp_path: Path):
    gray = LEVELS[..., 1].copy()
    gray[0, 0] = 0
    Image.fromarray(gray).save(tmp_path / "a.png")
    np.testing.assert_allclose(
        restored(tmp_path).image, np.repeat(gray[..., None] / 255, 3, axis=2), atol=1e-6
    )
    image = restored(tmp_path, holes="black").image
    assert np.isnan(image[0, 0]).all()
    assert np.isfinite(image).sum() == 23 * 3


@pytest.mark.parametrize(
    ("view", "files", "expected"),
    [
        ("gamma", "view", RGB),
        ("linear", "view", RGB),
        ("gamma", "linear", srgb_encode(RGB)),
        ("linear", "gamma", srgb_decode(RGB)),
        ("linear", "linear", RGB),
    ],
)
def test_files_of_another_encoding_are_brought_to_the_views(
    tmp_path: Path, view: str, files: str, expected
):
    write(tmp_path / "a.png", LEVELS)
    scene = scene_of("a.png", encoding=view)
    image = restore("precomputed", scene, scene.views[0], folder=tmp_path, encoding=files).image
    np.testing.assert_allclose(image, expected, atol=1e-6)


def test_another_size_is_resized_where_it_is_asked_for_and_told(tmp_path: Path):
    wide = np.tile(np.linspace(0, 252, 12).astype(np.uint8)[None, :, None], (8, 1, 3))
    Image.fromarray(wide).save(tmp_path / "a.png")
    result = restored(tmp_path, resize=True)
    assert result.info["resized_from"] == [12, 8]
    by_area = wide.reshape(4, 2, 6, 2, 3).mean(axis=(1, 3)) / 255
    np.testing.assert_allclose(result.image, by_area, atol=1e-6)


def test_another_shape_is_an_error_in_any_case(tmp_path: Path):
    write(tmp_path / "a.png", LEVELS[:, :4])
    with pytest.raises(InputError, match=r"4x4, .*6x4, (?!.*method\.resize)"):
        restored(tmp_path, resize=True)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (RGB * 255, {"2", "white", "1"}),
        (RGB[..., :2], {"4x6x2", "3"}),
        (LEVELS.astype(np.int32), {"int32", "8", "16", "floats"}),
        (np.full_like(RGB, np.nan), {"pixel", "method.holes"}),
    ],
)
def test_an_array_that_is_no_restored_image_is_named(
    tmp_path: Path, content: np.ndarray, named: set[str]
):
    np.save(tmp_path / "a.npy", content)
    with refused("a.npy", *named):
        restored(tmp_path)


# -- what comes with it ------------------------------------------------------------------------------------


def test_a_water_beside_the_image_enters_and_what_it_does_not_say_is_nan(tmp_path: Path):
    write(tmp_path / "a.png", LEVELS)
    assert restored(tmp_path).water is None
    tell(tmp_path, {"B": [0.1, 0.4, 0.5], "beta": [0.5, 0.1, 0.1], "by": "somebody"})
    water = restored(tmp_path).water
    np.testing.assert_array_equal(water.veiling_light, [0.1, 0.4, 0.5])
    np.testing.assert_array_equal(water.attenuation, [0.5, 0.1, 0.1])
    assert np.isnan(water.backscatter).all()
    tell(tmp_path, {"by": "somebody"})
    assert restored(tmp_path).water is None


@pytest.mark.parametrize(
    ("view", "files", "told", "expected"),
    [
        ("gamma", "view", None, "gamma"),
        ("linear", "view", None, "linear"),
        ("linear", "gamma", None, "gamma"),
        ("gamma", "view", "linear", "linear"),
        ("linear", "gamma", "linear", "linear"),
    ],
)
def test_a_water_explains_the_intensities_that_it_names_or_those_of_the_files(
    tmp_path: Path, view: str, files: str, told: str | None, expected: str
):
    write(tmp_path / "a.png", LEVELS)
    tell(tmp_path, {"B": [0.1, 0.4, 0.5]} | ({"encoding": told} if told else {}))
    scene = scene_of("a.png", encoding=view)
    water = Precomputed(tmp_path, encoding=files).restore(scene, scene.views[0]).water
    assert water.encoding == expected
    np.testing.assert_array_equal(water.veiling_light, [0.1, 0.4, 0.5])


def test_what_a_run_keeps_comes_in_again(bench, toys: str, tmp_path: Path):
    """The bench's own results are such a folder, and a view without an image is a row that says so."""
    run = (
        "run",
        "--plugin",
        toys,
        "dataset=toy",
        "metrics=[redness]",
        "tracking.uri=off",
        "report=false",
    )
    assert (
        bench(*run, "method=gain", "method.gain=0.5", "save=full", "out=first").returncode == 0
    )
    (tmp_path / "first/restored/toy/gain/v1.npz").unlink()
    again = (
        "method=precomputed",
        "method.folder=first/restored/toy/gain",
        "method.pattern='{stem}.npz'",
    )
    done = bench(*run, *again, "out=second")
    assert done.returncode == 0, done.stderr
    import pandas as pd

    columns = ["view", "status", "value", "seconds"]
    first, second = (
        pd.read_parquet(tmp_path / out / "scores.parquet") for out in ("first", "second")
    )
    first = first[first["metric"] == "redness"]
    assert second.loc[second["view"] == "v1.png", "status"].eq("skipped").all()
    assert (
        second.loc[second["view"] == "v1.png", "reason"]
        .str.contains("no image in .* is named v1.npz")
        .all()
    )
    second = second[second["metric"] == "redness"]
    both = first[columns].merge(second[columns], on="view", suffixes=("", "_again"))
    both = both[both["status_again"] == "ok"]
    assert set(both["view"]) == {"v0.png", "v2.png"}
    np.testing.assert_allclose(both["value_again"], both["value"])
    assert both["seconds_again"].isna().all()


def test_resizing_makes_no_colour_up_where_there_is_none(tmp_path: Path):
    small = RGB[:2, :3].copy()
    small[0, 0] = np.nan
    np.save(tmp_path / "a.npy", small)
    image = restored(tmp_path, resize=True).image
    assert np.isnan(image[:2, :2]).all()
    assert np.isfinite(image[:, 5]).all()
    assert np.nanmax(image) <= np.nanmax(small)


@pytest.mark.parametrize("told", ["raw", ["gamma"], 2])
def test_an_encoding_that_is_none_is_named(tmp_path: Path, told: object):
    write(tmp_path / "a.png", LEVELS)
    tell(tmp_path, {"B": [0.1, 0.4, 0.5], "encoding": told})
    with pytest.raises(InputError, match=r"a\.json: encoding .*gamma, linear or view"):
        restored(tmp_path)


@pytest.mark.parametrize("save", [np.save, np.savez])
def test_an_array_of_objects_runs_nothing(tmp_path: Path, save: Callable[..., None]):
    save(
        tmp_path / ("a.npy" if save is np.save else "a.npz"),
        np.array([Trap(tmp_path / "sprung")], dtype=object),
    )
    with refused("read"):
        restored(tmp_path)
    assert not (tmp_path / "sprung").exists()
