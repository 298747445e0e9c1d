"""sucre-bench restore: whole pictures for use, of photographs and of a dive."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms, PngImagePlugin
from PIL.ExifTags import IFD
from support.colmap_folder import picture, write_dive, write_image
from support.command_line import Done
from support.photographed_valley import NAMES, POSES, photograph

from sucre_bench import Arrays, View
from sucre_bench.camera import Camera
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.imaging.visible_faults import LIMITS, VisibleFault
from sucre_bench.loading.lens import Lens
from sucre_bench.programs.restore import trust
from sucre_bench.programs.restore.picture_file import bits_of, encoded
from sucre_bench.programs.restore.whole import as_photographed, whole, with_open_water
from sucre_bench.programs.restore.write import Restored

Bench = Callable[..., Done]


def seabed(seed: int) -> np.ndarray:
    values = cv2.resize(picture(seed, 20, 15), (80, 60), interpolation=cv2.INTER_LINEAR)
    return np.asarray(values)


def contents(folder: Path) -> dict[str, bytes]:
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


def test_single_photographs_come_back_under_their_names_and_a_damaged_one_costs_itself(
    tmp_path: Path, bench: Bench
):
    photos, out = tmp_path / "photos", tmp_path / "out"
    write_image(photos / "day\n1/a.JPG", seabed(0))
    write_image(photos / "day\n1/a.png", (seabed(1).astype(np.uint16) << 8) + 7)
    write_image(photos / "day\n1/a.tif", seabed(2))
    (photos / "c.jpg").write_bytes((photos / "day\n1/a.JPG").read_bytes()[:600])
    before = contents(photos)
    done = bench("restore", "photos", "out", "--method", "gray_world")
    assert done.returncode == 1
    assert "c.jpg" in done.stdout
    assert "3 of 4 pictures" in done.stdout
    made = contents(out / "pictures")
    assert sorted(made) == ["day\n1/a.JPG", "day\n1/a.png", "day\n1/a.tif"]
    for name, form in zip(sorted(made), ("JPEG", "PNG", "TIFF"), strict=True):
        with Image.open(out / "pictures" / name) as image:
            assert (image.format, image.size) == (form, (80, 60))
    deep = cv2.imread(str(out / "pictures/day\n1/a.png"), cv2.IMREAD_UNCHANGED)
    assert deep.dtype == np.uint16
    assert len(np.unique(deep)) > 256
    means = cv2.imread(str(out / "pictures/day\n1/a.tif")).mean(axis=(0, 1))
    assert np.ptp(means) < 2, "the photographs are blue, a gray world is not"
    with Image.open(out / "contact-sheet.jpg") as sheet:
        assert sheet.width > 600
    assert contents(photos) == before

    times = {
        name: (out / "pictures" / name).stat().st_mtime_ns
        for name in made
        if name != "day\n1/a.tif"
    }
    (out / "pictures/day\n1/a.tif").unlink()
    assert bench("restore", "photos", "out", "--method", "gray_world").returncode == 1
    assert {name: (out / "pictures" / name).stat().st_mtime_ns for name in times} == times, (
        "nothing is done twice"
    )
    assert contents(out / "pictures") == made


def test_a_dive_is_whole_in_the_formats_of_its_photographs(
    tmp_path: Path, bench: Bench
) -> None:
    """The dive as `prepare` leaves it: undistorted PNG of distorted JPEG, depth with holes, one photograph unplaced."""
    dive, photos = write_dive(tmp_path / "dive", ("a.png", "b.png")), tmp_path / "photos"
    for seed, name in enumerate("abc"):
        gray = np.repeat(picture(seed)[..., :1], 3, axis=-1)  # noise in colours has a cast
        write_image(photos / f"{name}.jpg", gray)
        write_image(dive / "images" / f"{name}.png", gray)
    parameters = {
        "model": "SIMPLE_RADIAL",
        "width": 40,
        "height": 30,
        "params": [48.0, 20.5, 14.5, -0.02],
    }
    (dive / "prepare.json").write_text(
        json.dumps({"photos": str(photos), "cameras": {"1": parameters}})
    )
    done = bench("restore", "dive", "out", "--method", "dive_gray_world", "method.fewest=10")
    assert done.returncode == 0, done.stderr
    assert "3 of 3 pictures" in done.stdout
    assert sorted(contents(tmp_path / "out/pictures")) == ["a.jpg", "b.jpg", "c.jpg"]
    for name in ("a.jpg", "b.jpg"):
        first_column = cv2.imread(str(tmp_path / "out/pictures" / name))[:, 0]
        assert (first_column.max(axis=-1) > 20).mean() > 0.9, (
            "pixels without depth are no holes"
        )
    words = ("--method", "dive_gray_world", "method.fewest=10", "shard.count=2", "workers=0")
    assert bench("restore", "dive", "blocks", *words).returncode == 0
    assert contents(tmp_path / "blocks/pictures") == contents(tmp_path / "out/pictures")


BROKEN = """
from dataclasses import dataclass
from sucre_bench import Restoration, Scene, View, method


@method(needs={"depth"}, cites="nobody")
@dataclass(frozen=True)
class Broken:
    \"\"\"Fail.\"\"\"

    def restore(self, scene: Scene, view: View) -> Restoration:
        raise ValueError("no light at all")


@method(needs={"depth"}, cites="nobody")
@dataclass(frozen=True)
class Unsure:
    \"\"\"Say what it does not know.\"\"\"

    def restore(self, scene: Scene, view: View) -> Restoration:
        return Restoration(view.rgb, info={"limits": ["far ground is hazy", f"{view.name} is odd"]})


@method(needs={"depth"}, cites="nobody")
@dataclass(frozen=True)
class Green:
    \"\"\"Make one view green.\"\"\"

    solver: str = "exact"

    def restore(self, scene: Scene, view: View) -> Restoration:
        image = view.rgb * ((0.2, 1, 0.2) if view.name == "b.png" else 1)
        judged = [{"drift": 1, "drift_of_photograph": 2}]
        water = {"beta": [0.1, 0.1, 0.1], "judged": judged}
        return Restoration(image, info={"solver": self.solver, **water})
"""


def test_a_method_that_fails_is_named_with_the_one_that_replaced_it(
    tmp_path: Path, bench: Bench
) -> None:
    write_dive(tmp_path / "dive", ("a.png", "b.png"))
    (tmp_path / "broken.py").write_text(BROKEN)
    words = ("--plugin", "broken.py", "--method", "broken", "--single-view", "gray_world")
    done = bench("restore", "dive", "out", *words)
    assert done.returncode == 1
    assert sorted(contents(tmp_path / "out/pictures")) == ["a.png", "b.png"]
    assert all(
        text in done.stdout
        for text in ("broken", "2 photographs", "gray_world", "no light at all")
    )
    assert "without a place" not in done.stdout
    done = bench("restore", "dive", "unsure", "--plugin", "broken.py", "--method", "unsure")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("far ground is hazy") == 1, "once for the dive"
    assert "is odd" not in done.stdout


def test_a_ruined_picture_of_a_dive_gives_way_to_balanced_colours(
    tmp_path: Path, bench: Bench
) -> None:
    write_dive(tmp_path / "dive", ("a.png", "b.png", "c.png"))
    (tmp_path / "broken.py").write_text(BROKEN)
    words = ("--plugin", "broken.py", "--method", "green", "--single-view", "underwater")
    for _ in range(2):  # the second finds all done
        done = bench("restore", "dive", "out", *words)
        assert done.returncode == 0, done.stderr
        assert "no good picture of 1 photograph" in done.stdout
        made, photograph = (
            cv2.imread(str(tmp_path / folder / "b.png"))
            for folder in ("out/pictures", "dive/images")
        )
        assert np.abs(made.astype(int) - photograph).max() <= 1
    why = (tmp_path / "out/pictures.csv").read_text().splitlines()[2]
    assert "b.png" in why
    assert "cast" in why
    assert "do not use" not in why
    # its water, which others show as if it were measured, is not
    csv = (tmp_path / "out/pictures.csv").read_text()
    assert csv.count("water ruins 1 other picture") == 2
    # what shows the photograph's colours is balanced already
    kept = bench("restore", "dive", "out", *words, "green.solver=none")
    assert "no good picture" not in kept.stdout
    assert "do not use  b.png" in kept.stdout
    # where half are ruined, nobody knows which half
    write_dive(tmp_path / "two", ("a.png", "b.png"))
    assert "no good picture of 2 photographs" in bench("restore", "two", "both", *words).stdout


def test_out_of_other_photographs_is_refused_and_other_options_write_again(
    tmp_path: Path, bench: Bench
) -> None:
    for folder in ("photos", "more"):
        write_image(tmp_path / folder / "a.jpg", seabed(len(folder)))
    assert bench("restore", "photos", "out", "--method", "gray_world").returncode == 0
    first = contents(tmp_path / "out/pictures")
    assert bench("restore", "more", "out", "--method", "gray_world").returncode == 2
    assert contents(tmp_path / "out/pictures") == first
    words = ("restore", "photos", "out", "--method", "gray_world")
    assert bench(*words, "--quality", "40").returncode == 0
    assert len(contents(tmp_path / "out/pictures")["a.jpg"]) < len(first["a.jpg"])
    assert bench(*words, "+method.display=white-50").returncode == 0
    shown = cv2.imread(str(tmp_path / "out/pictures/a.jpg"))
    assert (shown > 250).mean() > 0.3, "an option of the method counts for single photographs"


@pytest.mark.parametrize(
    ("word", "named"),
    [
        *((word, word) for word in ("out=here", "first=1", "workers=-1", "workers=abc")),
        *(
            (word, word)
            for word in ("shard.count=0", "shard.count=-2", "shard.count=1,2", "shard.count=x")
        ),
        ("sucre.fill=true", "sucre.fill"),
        ("method.fil=true", "method.fil"),
        ("gray_world.fil=true", "gray_world.fil"),
    ],
)
def test_a_word_that_is_no_option_or_no_value_of_one_is_refused(
    tmp_path: Path, bench: Bench, word: str, named: str
) -> None:
    write_image(tmp_path / "photos/a.jpg", seabed(0))
    done = bench("restore", "photos", "out", "--method", "gray_world", word)
    (line,) = done.errors
    assert (done.returncode, named in line, "shard.index" in line) == (2, True, False)
    assert not (tmp_path / "out").exists()


def test_photographs_that_overlap_are_prepared_and_restored_together(
    tmp_path: Path, bench: Bench
) -> None:
    names = NAMES[:4]
    for name, pose in zip(names, POSES[:4], strict=True):
        write_image(tmp_path / "photos" / name, photograph(pose))
    words = ("restore", "photos", "out", "--method", "dive_gray_world", "--original-geometry")
    done = bench(*words)
    assert done.returncode == 0, done.stderr
    assert "4 of 4 pictures" in done.stdout
    assert sorted(contents(tmp_path / "out/pictures")) == sorted(names)
    for name in names:  # edges lie where the distorting camera saw them
        before, after = (
            cv2.imread(str(tmp_path / folder / name), 0)
            for folder in ("photos", "out/pictures")
        )
        (x, y), _ = cv2.phaseCorrelate(
            *(cv2.Laplacian(one.astype(np.float32), cv2.CV_32F) for one in (before, after))
        )
        assert np.hypot(x, y) < 0.3
    first = (tmp_path / "out/pictures" / NAMES[0]).stat().st_mtime_ns
    assert bench(*words).returncode == 0
    assert (tmp_path / "out/pictures" / NAMES[0]).stat().st_mtime_ns == first, (
        "nothing is done twice"
    )

    corners = [[10, 10], [60, 10], [60, 50], [10, 50]]
    images = tmp_path / "out/work/dive/images"
    image = next(images.rglob("*.png")).relative_to(images).as_posix()
    chart = json.dumps({"images": {image: {"chart": corners}}})
    (tmp_path / "out/work/dive/charts.json").write_text(chart)
    restored = contents(tmp_path / "out/work/results/restored")
    assert bench(*words).returncode == 0
    assert contents(tmp_path / "out/work/results/restored") == restored
    assert (tmp_path / "out/pictures" / NAMES[0]).stat().st_mtime_ns == first, (
        "a chart changes no picture"
    )

    write_image(tmp_path / "more/a.png", seabed(1))
    write_image(tmp_path / "more/b.png", seabed(1))
    before = contents(tmp_path / "out")
    done = bench("restore", "more", "out", "--method", "dive_gray_world")
    assert done.returncode == 2
    assert contents(tmp_path / "out") == before, (
        "other photographs are refused before they are prepared"
    )


PICTURE = np.random.default_rng(1).integers(0, 65535, (24, 36, 3), dtype=np.uint16)
PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
XMP = b'<x:xmpmeta xmlns:x="adobe:ns:meta/">reef</x:xmpmeta>'
LATITUDE = (17.0, 30.0, 12.5)


def exif() -> Image.Exif:
    made = Image.Exif()
    made[271], made[274] = "Nikon", 6
    made[IFD.Exif], made[IFD.GPSInfo] = {37500: b"maker note"}, {1: "S", 2: LATITUDE}
    return made


def noted(kind: str) -> bytes:
    file, image = io.BytesIO(), Image.fromarray(np.zeros((24, 36, 3), np.uint8))
    text = PngImagePlugin.PngInfo()
    text.add_itxt("XML:com.adobe.xmp", XMP.decode())
    tags, more = Image.Exif(), {"pnginfo": text} if kind == "PNG" else {"xmp": XMP}
    tags.load(exif().tobytes())
    if kind == "TIFF":
        tags[700], more = XMP, {}
    image.save(
        file,
        kind,
        exif=tags if kind == "TIFF" else exif().tobytes(),
        icc_profile=PROFILE,
        **more,
    )
    return file.getvalue()


@pytest.mark.parametrize(
    ("kind", "bits"),
    [("JPEG", 8), ("PNG", 8), ("PNG", 16), ("WEBP", 8), ("TIFF", 8), ("TIFF", 16)],
)
def test_exif_gps_xmp_and_profile_are_kept_and_every_level_where_the_format_can(
    tmp_path: Path, kind: str, bits: int
) -> None:
    """Pixels stay as they lie in the file: viewers turn the picture by its orientation."""
    picture = PICTURE if bits == 16 else (PICTURE >> 8).astype(np.uint8)
    file = tmp_path / f"a.{kind.lower()}"
    made = encoded(picture, noted(kind), 95)
    file.write_bytes(made)
    if kind in ("PNG", "TIFF"):
        assert (np.rint(read_rgb(file) * (2**bits - 1)) == picture).all()
    with Image.open(file) as image:
        tags = image.getexif()
        assert (image.format, tags[271], tags[274]) == (kind, "Nikon", 6)
        assert tuple(map(float, tags.get_ifd(0x8825)[2])) == LATITUDE
        assert tags.get_ifd(0x8769)[37500] == b"maker note"
        assert image.info["icc_profile"] == PROFILE
        assert XMP in made
        assert kind != "TIFF" or struct.pack("<HH", 37500, 7) in made, (
            "bytes of no type, as the photograph's"
        )


def test_a_tiff_of_16_bits_stays_one(tmp_path: Path) -> None:
    file = tmp_path / "a.tif"
    iptc = b"\x1c\x02\x19\x00\x04reef\x00\x00\x00"
    # GeoTIFF's size of a pixel
    tags = [
        (700, 1, len(XMP), XMP, True),
        (33550, 12, 3, (0.5, 0.5, 0.0), True),
    ]
    # keywords, as exiftool writes them
    tags.append((33723, 4, 3, struct.unpack("<3I", iptc), True))
    tifffile.imwrite(
        file, PICTURE, photometric="rgb", compression="zlib", iccprofile=PROFILE, extratags=tags
    )
    assert bits_of(file) == 16
    content = encoded(PICTURE[::-1], file.read_bytes(), 95)
    assert iptc in content
    with tifffile.TiffFile(io.BytesIO(content)) as made:
        page = made.pages.first
        assert (page.asarray() == PICTURE[::-1]).all()
        assert (page.iccprofile, page.tags[33550].value) == (PROFILE, (0.5, 0.5, 0.0))
        assert page.tags[700].value == XMP


def test_the_preview_of_the_photograph_goes() -> None:
    """File managers would show the colours of before."""
    small, tags, photograph = Image.new("RGB", (18, 12)), io.BytesIO(), io.BytesIO()
    # EXIF is a TIFF of two directories, and the second is the preview
    small.save(tags, "TIFF", tiffinfo={271: "GoP"}, save_all=True, append_images=[small])
    small.save(photograph, "JPEG", exif=b"Exif\x00\x00" + tags.getvalue())
    made = encoded((PICTURE >> 8).astype(np.uint8), photograph.getvalue(), 95)
    before, after = (
        Image.open(io.BytesIO(file)).getexif() for file in (photograph.getvalue(), made)
    )
    assert before[271] == after[271] == "GoP"
    assert before.get_ifd(IFD.IFD1)
    assert not after.get_ifd(IFD.IFD1)


def test_holes_show_the_photograph_in_the_colours_at_the_rim() -> None:
    y, x = np.mgrid[:90, :120] / 120
    photograph = np.stack(
        [0.2 + 0.1 * x, 0.4 + 0.1 * y, 0.5 + 0.1 * np.sin(9 * x)], axis=-1
    ).astype(np.float32)
    restored = photograph + np.array([0.2, -0.1, -0.2], np.float32)
    known = np.ones((90, 120), bool)
    known[30:60, 50:] = False
    made = whole(np.where(known[..., None], restored, 0), known, photograph)
    assert (made[known] == restored[known]).all()
    # no step at the rim, and the photograph's detail
    np.testing.assert_allclose(made, restored, atol=0.002)


def test_holes_have_the_contrast_of_restored_ground_around() -> None:
    ground = np.random.default_rng(0).uniform(0.1, 0.9, (120, 160, 3)).astype(np.float32)
    # water that takes contrast, most in red, and adds a veil
    photograph = np.array([0.2, 0.3, 0.35], np.float32) + ground * np.array(
        [0.1, 0.3, 0.4], np.float32
    )
    known = np.ones((120, 160), bool)
    known[:30] = False
    known[70:90, 40:80] = False
    made = whole(np.where(known[..., None], ground, 0), known, photograph)
    assert np.abs(made - ground)[~known].mean() < 0.03
    assert np.abs(photograph - ground)[~known].mean() > 0.15


def test_without_any_colour_the_photograph_is_left() -> None:
    photograph = np.full((8, 9, 3), 0.3, np.float32)
    assert (
        whole(np.zeros_like(photograph), np.zeros((8, 9), bool), photograph) == photograph
    ).all()


ROW, COLUMN = np.mgrid[:300, :400]
IS_GROUND = ROW > 120
OPEN_WATER = np.array([0.1, 0.5, 0.6])
CHANGE = np.array([0.3, -0.1, -0.2], np.float32)


def ground_below(water: np.ndarray) -> np.ndarray:
    """A photograph of rough ground below water of these colours (3,) or (H, W, 3)."""
    noise = np.random.default_rng(0).standard_normal((300, 400, 1))
    photograph = np.where(IS_GROUND[..., None], [0.3, 0.4, 0.4] + 0.1 * noise, water)
    return cv2.GaussianBlur(photograph.astype(np.float32), (0, 0), 1.5).clip(0, 1)


def test_open_water_stays_as_photographed_and_holes_in_the_ground_do_not() -> None:
    photograph = ground_below(OPEN_WATER)
    measured = IS_GROUND & ((COLUMN - 200) ** 2 + (ROW - 220) ** 2 > 30**2)
    picture = photograph + CHANGE
    false = (COLUMN - 200) ** 2 + (
        ROW - 40
    ) ** 2 < 8**2  # 50 cells of depth that stands in the water
    made = with_open_water(picture, measured | false, photograph)
    assert (
        made[measured] == picture[measured]
    ).mean() > 0.98  # a cell of the rim may be mostly water
    np.testing.assert_allclose(made[:80], photograph[:80], atol=0.02)
    np.testing.assert_allclose(made[140:], picture[140:], atol=0.02)


@pytest.mark.parametrize(("open_px", "reach_px"), [(0, 60), (150, 25)])
def test_murk_above_the_ground_does_not_take_its_change(open_px: int, reach_px: int) -> None:
    # Murk may be an overhang, unless it joins open water: a reef's change may reach less far into it there.
    murk = [0.4, 0.45, 0.45]  # more red than ground has
    photograph = ground_below(np.where((open_px > COLUMN)[..., None], OPEN_WATER, murk))
    made = with_open_water(photograph + CHANGE, IS_GROUND, photograph)
    np.testing.assert_allclose(made[140:], photograph[140:] + CHANGE, atol=0.02)
    above = slice(0, 120 - reach_px)
    assert np.abs(made[above] - photograph[above]).max() < 0.03


@pytest.mark.parametrize("kind", LIMITS)
def test_every_fault_that_the_eye_sees_stands_beside_its_picture(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    fault = VisibleFault(kind, 0.5, LIMITS[kind])
    monkeypatch.setattr(trust, "faults_of_dive", lambda looks: [(fault,) for _ in looks])
    view = View("a.png", Arrays(np.full((8, 9, 3), 0.3, np.float32)))
    image = tmp_path / "pictures/a.png"
    write_image(image, np.zeros((8, 9, 3), np.uint8))
    measured = {
        "beta": [0.1] * 3,
        "solver": "exact",
        "judged": [{"held_out": 0.5, "drift": 2.0, "drift_of_photograph": 3.0}],
        "below_zero": [],
    }
    one = Restored(
        "a.png",
        image,
        view,
        image,
        None,
        None,
        "sucre_plus",
        1.0,
        (),
        measured,
        is_of_dive=True,
    )
    (assessed,) = trust.assess([one], tmp_path, False, {})
    assert assessed.trust is not trust.Trust.GOOD
    assert len(assessed.reasons) == 1
    assert assessed.reasons[0] in (tmp_path / "pictures.csv").read_text()


def test_a_picture_comes_back_as_the_camera_saw_it() -> None:
    lens = Lens(
        Camera(np.array([[200.0, 0, 118], [0, 205, 92], [0, 0, 1]]), 240, 180),
        "perspective",
        (-0.15,),
    )
    noise = np.random.default_rng(0).random((12, 16, 3)).astype(np.float32)
    photograph = cv2.resize(noise, (240, 180), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    straight = lens.resampled(photograph, lens.pinhole)
    assert np.abs(straight - photograph).mean() > 0.02  # the lens distorts
    back, shown = as_photographed(lens, straight, np.ones((180, 240), bool))
    assert 0.5 < shown.mean() < 1  # a pinhole image looks at less
    assert np.abs(back - photograph)[shown].max() < 0.03
    assert np.abs(back - photograph)[shown].mean() < 0.002
