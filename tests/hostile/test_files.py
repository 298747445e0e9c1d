"""One bad file: it is named with its fault, its view fails, the others go on, in little memory."""

import errno
import html
import io
import os
import re
import socket
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image
from support.colmap_folder import HEIGHT, WIDTH, picture, write_dive, write_image
from support.command_line import Done, run_here
from support.messages import Lines

from sucre_bench import results
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import read_array, read_rgb
from sucre_bench.machine import progress


def png_of_size(width: int, height: int) -> bytes:
    """A PNG of a few bytes whose header says a size."""
    data = bytearray(one_pixel(".png"))
    data[16:24] = struct.pack(">II", width, height)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))  # of the header
    return bytes(data)


def tiff_of_size(width: int, height: int) -> bytes:
    """A TIFF of a few bytes whose header says a size."""
    content = io.BytesIO()
    tifffile.imwrite(content, np.zeros((1, 1), np.float32))
    content.seek(0)
    with tifffile.TiffFile(content) as file:
        tags = file.pages.first.tags
        tags["ImageWidth"].overwrite(width)
        tags["ImageLength"].overwrite(height)
    return content.getvalue()


def npz_of_shape(shape: tuple[int, ...]) -> bytes:
    """An .npz of some kilobytes whose array "image" is all zeros, of as many GB as the shape says."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f4", "fortran_order": False, "shape": shape}
    )
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("image.npy", header.getvalue() + bytes(1 << 16))
    data = bytearray(content.getvalue())  # the directory says that the array is whole
    place = data.rindex(b"PK\x01\x02")
    data[place + 24 : place + 28] = struct.pack("<I", 0xFFFFFFF0)
    return bytes(data)


def cut_tiff() -> bytes:
    content = io.BytesIO()
    tifffile.imwrite(content, np.ones((30, 40, 3), np.uint8))
    return content.getvalue()[:8]


def tiff_of_pages(*pages: np.ndarray, reduced: int | None = None) -> bytes:
    """A TIFF of several pictures (H, W, 3). reduced: the page that says of itself that it is a thumbnail."""
    content = io.BytesIO()
    with tifffile.TiffWriter(content) as file:
        for number, page in enumerate(pages):
            file.write(page, photometric="rgb", subfiletype=int(number == reduced))
    return content.getvalue()


def animation(*pictures: np.ndarray) -> bytes:
    """A PNG that shows pictures (H, W, 3) one after the other."""
    content, (first, *others) = io.BytesIO(), map(Image.fromarray, pictures)
    first.save(content, "PNG", save_all=True, append_images=others)
    return content.getvalue()


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def bound_socket(path: Path) -> None:
    # an address has 108 bytes
    with chdir(path.parent), socket.socket(socket.AF_UNIX) as bound:
        bound.bind(path.name)


def written(content: bytes) -> Callable[[Path], None]:
    """Write some content, whatever the file's name says it is."""
    return lambda path: path.write_bytes(content) and None


LONG = "x" * 300


def one_pixel(suffix: str) -> bytes:
    return bytes(cv2.imencode(suffix, np.full((1, 1, 3), 9, np.uint8))[1])


TWO = (picture(1), picture(2))

# Odd files in the place of a view's image or depth map, each with the fault that the message names.
IMAGES: dict[str, tuple[str, Callable[[Path], None], str]] = {
    "a cut TIFF": (".tif", written(cut_tiff()), "cannot be read"),
    "a PNG of a forged size": (".png", written(png_of_size(30000, 30000)), "is 30000x30000"),
    "a PNG of a forged size of the camera's shape": (
        ".png",
        written(png_of_size(40000, 30000)),
        "megapixels",
    ),
    "a TIFF of a forged size": (".tif", written(tiff_of_size(40000, 30000)), "megapixels"),
    "a TIFF of two pages": (".tif", written(tiff_of_pages(*TWO)), "several pictures"),
    "a TIFF that begins with a thumbnail": (
        ".tif",
        written(tiff_of_pages(TWO[0][::2, ::2], TWO[1], reduced=0)),
        "several pictures",
    ),
    "an animation": (".png", written(animation(*TWO)), "several pictures"),
    "one pixel": (".png", written(one_pixel(".png")), "is 1x1"),
    "a device": (".png", device, "is a device"),
    "a pipe": (".png", os.mkfifo, "is a named pipe"),
    "a socket": (".png", bound_socket, "is a socket"),
}
DEPTHS: dict[str, tuple[str, Callable[[Path], None], str]] = {
    "a cut TIFF": (".tif", written(cut_tiff()), "cannot be read"),
    "a PNG of a forged size": (".png", written(png_of_size(30000, 30000)), "is 30000x30000"),
    "a TIFF of a forged size": (".tif", written(tiff_of_size(40000, 30000)), "megapixels"),
    "one pixel": (".png", written(one_pixel(".png")), "uint8"),
    "an archive": (".npy", written(npz_of_shape((30000, 40000))), "cannot be read"),
    "a device": (".png", device, "is a device"),
    "a pipe": (".tif", os.mkfifo, "is a named pipe"),
}


@contextmanager
def in_little_memory() -> Iterator[None]:
    """What is within needs less than 500 MB."""
    Path("/proc/self/clear_refs").write_text("5")
    before = peak_mb()
    yield
    assert peak_mb() - before < 500


def peak_mb() -> float:
    (kilobytes,) = re.findall(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())
    return int(kilobytes) / 1024


def run(folder: Path, *more: str) -> Done:
    words = (
        "dataset=colmap",
        "dataset.root=dive",
        "metrics=[coverage]",
        "tracking.uri=off",
        "report=false",
    )
    return run_here(folder, "run", *words, "out=results", *more)


def test_a_file_that_is_none_costs_its_view_alone(tmp_path: Path):
    names = {f"image{n}{suffix}": said for n, (suffix, _, said) in enumerate(IMAGES.values())}
    deep = {f"depth{n}.png": said for n, (_, _, said) in enumerate(DEPTHS.values())}
    missing = f"{LONG}.png"
    dive = write_dive(tmp_path / "dive", ["a.png", *names, *deep, "c.png"])
    model = dive / "sparse" / "images.txt"
    model.write_text(
        model.read_text().replace("c.png", f"c.png\n\n99 1 0 0 0 0 0 0 1 {missing}")
    )
    for name, (_, spoil, _) in zip(names, IMAGES.values(), strict=True):
        (dive / "images" / name).unlink()
        spoil(dive / "images" / name)
    for name, (suffix, spoil, _) in zip(deep, DEPTHS.values(), strict=True):
        path = dive / "depths" / f"depth_{Path(name).stem}.png"
        path.unlink()
        spoil(path.with_suffix(suffix))
    with in_little_memory():
        done = run(tmp_path, "-m", "method=stitching,gray_world", "report=true")
    page = html.unescape((tmp_path / "results" / "report" / "index.html").read_text())
    rows = results.read(tmp_path / "results")
    rows = rows[(rows["metric"] == "seconds")]
    # gray_world needs no depth map; stitching does, and the image of the long name has none.
    rows = rows[
        rows["method"]
        == rows["view"].map(lambda view: "gray_world" if view == missing else "stitching")
    ]
    rows = rows.set_index("view")
    for name, said in {**names, **deep, missing: os.strerror(errno.ENAMETOOLONG)}.items():
        assert rows.loc[name, "status"] == "failed", name
        assert said in rows.loc[name, "reason"]
        assert Path(name).stem in rows.loc[name, "reason"]
        assert "plugin" not in rows.loc[name, "reason"]
        shown = rows.loc[name, "reason"].partition("; ")[0].rpartition("/")[2]
        assert shown in done.stdout
        assert shown in page
    assert rows.loc[["a.png", "c.png"], "status"].tolist() == ["ok", "ok"]
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr


@pytest.mark.parametrize("reduced", [1, None])
def test_a_thumbnail_after_the_picture_is_passed_over(tmp_path: Path, reduced: int | None):
    (tmp_path / "a.tif").write_bytes(tiff_of_pages(TWO[0], TWO[1][::2, ::2], reduced=reduced))
    np.testing.assert_allclose(read_rgb(tmp_path / "a.tif"), TWO[0] / 255, atol=1e-6)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_transparent_pixels_keep_their_colours_and_are_said_once(tmp_path: Path, suffix: str):
    with progress.watched_by(lines := Lines()):
        for name in ("a", "b"):
            path = (tmp_path / name).with_suffix(suffix)
            Image.fromarray(with_alpha(np.uint8)).save(path)
            np.testing.assert_allclose(read_rgb(path), TWO[0] / 255, atol=1e-6)
    (line,) = lines.lines
    assert "6 pixels" in line


def with_alpha(dtype: type) -> np.ndarray:
    """A picture (H, W, 4); the first three rows of its first two columns are transparent."""
    most = np.iinfo(dtype).max
    alpha = np.full((HEIGHT, WIDTH, 1), most, dtype)
    alpha[:3, :2] = 0
    return np.dstack([TWO[0].astype(dtype) * (most // 255), alpha])


@pytest.mark.parametrize(
    ("compression", "channels"), [("packbits", [0, 1, 2, 3]), ("raw", [0, 3])]
)
def test_colours_below_transparency_are_those_stored(
    tmp_path: Path, compression: str, channels: list[int]
) -> None:
    values = np.ascontiguousarray(with_alpha(np.uint8)[..., channels])
    Image.fromarray(values).save(tmp_path / "a.tif", compression=compression)
    expected = np.broadcast_to(values[..., :-1], (HEIGHT, WIDTH, 3))
    np.testing.assert_array_equal(np.rint(read_rgb(tmp_path / "a.tif") * 255), expected)


@pytest.mark.parametrize("n", [3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_planes_of_a_tiff_are_its_channels(
    tmp_path: Path, n: int, dtype: type, compression: str | None
) -> None:
    planes = np.moveaxis(with_alpha(dtype)[..., :n], -1, 0)
    how = {"planarconfig": "separate", "extrasamples": ["unassalpha"][: n - 3]}
    tifffile.imwrite(
        tmp_path / "a.tif", planes, photometric="rgb", compression=compression, **how
    )
    np.testing.assert_allclose(read_rgb(tmp_path / "a.tif"), TWO[0] / 255, atol=1e-6)


def test_transparency_that_no_decoder_reads_as_stored_is_refused(tmp_path: Path) -> None:
    """LZW needs another package, and OpenCV multiplies by alpha."""
    path = tmp_path / "a.tif"
    Image.fromarray(with_alpha(np.uint8)).save(path, compression="tiff_lzw")
    with pytest.raises(InputError, match=r"a\.tif: .*save it without"):
        read_rgb(path)


@pytest.mark.parametrize(("factor", "notes"), [(16, 1), (257, 0)])
def test_images_that_use_12_of_16_bits_are_said(tmp_path: Path, factor: int, notes: int):
    assert cv2.imwrite(str(tmp_path / "a.png"), TWO[0].astype(np.uint16) * factor)
    with progress.watched_by(lines := Lines()):
        read_rgb(tmp_path / "a.png")
    assert len(lines.lines) == notes


PRECOMPUTED: dict[str, tuple[str, bytes, str]] = {
    "an .npz of 4.8 GB": (".npz", npz_of_shape((30000, 40000, 1)), "megapixels|cannot be read"),
    "a PNG of a forged size": (".png", png_of_size(30000, 30000), "is 30000x30000"),
    "a TIFF of a forged size": (".tif", tiff_of_size(40000, 30000), "megapixels"),
    "one pixel": (".png", one_pixel(".png"), "is 1x1"),
    "an object": (
        ".npy",
        b"\x93NUMPY\x01\x00v\x00{'descr': '|O', 'fortran_order': False, 'shape': (1,), }"
        + b" " * 60,
        "cannot be read",
    ),
}


def test_restorations_of_others_are_held_against_the_view_before_they_are_decoded(
    tmp_path: Path,
):
    names = [f"v{number}.png" for number in range(len(PRECOMPUTED))]
    write_dive(tmp_path / "dive", ["a.png", *names])
    (tmp_path / "restored").mkdir()
    write_image(tmp_path / "restored" / "a.png", picture(0))
    for name, (suffix, content, _) in zip(names, PRECOMPUTED.values(), strict=True):
        (tmp_path / "restored" / name).with_suffix(suffix).write_bytes(content)
    with in_little_memory():
        words = ("method=precomputed", "method.folder=restored", "method.resize=true")
        done = run(tmp_path, *words)
    rows = results.read(tmp_path / "results")
    rows = rows[rows["metric"] == "seconds"].set_index("view")
    for name, (_, _, said) in zip(names, PRECOMPUTED.values(), strict=True):
        assert rows.loc[name, "status"] == "failed", name
        assert re.search(said, rows.loc[name, "reason"])
    assert rows.loc["a.png", "status"] == "ok"
    assert "Traceback" not in done.stdout + done.stderr


def test_the_limit_of_pixels_is_raised_as_the_message_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    write_dive(tmp_path / "dive", ["a.png"])
    monkeypatch.setenv("SUCRE_BENCH_MAX_MEGAPIXELS", "0.001")  # the images have 1,200 pixels
    done = run(tmp_path, "method=gray_world")
    found = re.search(r"set (\w+)=(\w+) before the command", done.stdout)
    assert done.returncode == 1
    assert found, done.stdout
    monkeypatch.setenv(found[1], found[2])
    assert run(tmp_path, "method=gray_world").returncode == 0


def test_an_array_is_read_in_any_order_and_version(tmp_path: Path):
    for number, array in enumerate(
        (np.arange(6).reshape(2, 3), np.asfortranarray(np.arange(6.0).reshape(2, 3)))
    ):
        np.save(tmp_path / f"{number}.npy", array)
        np.testing.assert_array_equal(read_array(tmp_path / f"{number}.npy"), array)
        np.savez_compressed(tmp_path / f"{number}.npz", other=1, image=array)
        np.testing.assert_array_equal(
            read_array(tmp_path / f"{number}.npz", lambda _: "image"), array
        )
    with pytest.raises(InputError, match=r"0.npz: cannot be read"):
        read_array(tmp_path / "0.npz", lambda _: "no such name")


assert (WIDTH, HEIGHT) == (40, 30)  # what the forged sizes are held against
