"""sucre_bench.imaging.chart_patches: the tables against published data, the measuring against painted charts."""

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from support.made_scene import TILTED, painted
from support.messages import names

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.imaging.chart_kinds import KINDS, chart_kind, kind_id
from sucre_bench.imaging.chart_patches import measure
from sucre_bench.imaging.cielab import colour_science
from sucre_bench.loading.charts_file import read_charts
from sucre_bench.scene import Chart


def test_colorchecker_lab_agrees_with_the_spectral_measurement_published_for_the_same_charts() -> (
    None
):
    colour = colour_science()

    published = colour.CCS_COLOURCHECKERS["ColorChecker 2005"]
    XYZ = colour.xyY_to_XYZ(np.array(list(published.data.values())))
    lab = colour.XYZ_to_Lab(XYZ, published.illuminant)
    ours = chart_kind("colorchecker24").patches
    np.testing.assert_allclose(np.array([p.lab for p in ours]), lab, atol=0.06)
    assert [p.name.split("-")[0] for p in ours] == [name.split()[0] for name in published.data]
    assert sum(p.is_chromatic for p in ours) == 18


@pytest.mark.parametrize("name", [*KINDS, "colorchecker_sg"])
@pytest.mark.parametrize("turn", range(4))
def test_a_painted_chart_is_read_back_however_it_lies(name: str, turn: int) -> None:
    kind = chart_kind(name)
    corners = np.roll(TILTED, turn, axis=0)
    readings = measure(painted(kind, corners), Chart("c", name, corners))
    assert [r.patch for r in readings] == list(kind.patches)
    np.testing.assert_allclose(
        [r.rgb for r in readings], [r.patch.srgb for r in readings], atol=1e-6
    )
    assert all(r.coverage == 1 and r.n_pixels > 50 for r in readings)


def test_only_the_inner_half_of_a_patch_is_read() -> None:
    kind = chart_kind("dgk")
    half = measure(painted(kind, TILTED, share=0.5), Chart("c", "dgk", TILTED))
    np.testing.assert_allclose([r.rgb for r in half], [p.srgb for p in kind.patches], atol=1e-6)
    rim = painted(kind, TILTED, share=0.5)
    rim[np.all(rim == 1, axis=-1)] = np.nan
    # 1 is as white as the rim
    assert all(r.coverage == 1 for r in measure(rim, Chart("c", "dgk", TILTED))[1:])


def test_a_hole_is_left_out_and_counted() -> None:
    kind = chart_kind("dgk")
    image = painted(kind, TILTED)
    whole = measure(image, Chart("c", "dgk", TILTED))
    image[np.isclose(image, kind.patches[6].srgb).all(axis=-1)] = np.nan
    image[:, :120, 1] = np.nan  # one channel missing is a hole
    readings = measure(image, Chart("c", "dgk", TILTED))
    red = readings[6]
    assert np.isnan(red.rgb).all()
    assert (red.n_pixels, red.coverage) == (0, 0)
    partly = [(r, w) for r, w in zip(readings, whole, strict=True) if 0 < r.coverage < 1]
    assert partly, "the cut at x = 120 goes through patches"
    for r, w in partly:
        assert r.coverage == pytest.approx(r.n_pixels / w.n_pixels)
        np.testing.assert_allclose(r.rgb, r.patch.srgb, atol=1e-6)


def test_a_patch_smaller_than_a_pixel_is_the_pixel_at_its_centre() -> None:
    corners = np.array([[3, 2], [9, 2], [9, 6], [3, 6]], float)
    image = np.random.default_rng(1).random((9, 12, 3))
    for reading in measure(image, Chart("c", "dgk", corners)):
        x0, y0, x1, y1 = reading.patch.box
        if reading.n_pixels == 1:
            u, v = int(3 + 6 * (x0 + x1) / 2), int(2 + 4 * (y0 + y1) / 2)
            np.testing.assert_array_equal(reading.rgb, image[v, u])
        assert reading.coverage == 1


@pytest.mark.parametrize(
    "corners",
    [TILTED[::-1], TILTED[[0, 2, 1, 3]], TILTED[:3], np.full((4, 2), np.nan), np.zeros((4, 2))],
    ids=["mirrored", "crossed", "three", "nan", "one point"],
)
def test_corners_that_are_no_quadrilateral_are_refused(corners: Array) -> None:
    with pytest.raises(InputError, match="corners"):
        measure(np.ones((9, 9, 3)), Chart("left", "dgk", corners))


# -- kinds from elsewhere ----------------------------------------------------------------------------------------


def test_colorchecker_sg_has_the_colorcheckers_24_colours_inside_a_rim_of_gray() -> None:
    sg = chart_kind("colorchecker_sg")
    assert [sg.patches[k].name for k in (0, 13, 126, 139)] == ["A1", "N1", "A10", "N10"]
    lab = {patch.name: np.array(patch.lab) for patch in sg.patches}
    rim = [p for p in sg.patches if p.name[0] in "AN" or p.name[1:] in ("1", "10")]
    assert len(rim) == 44
    assert not any(p.is_chromatic for p in rim)
    classic = [np.array(patch.lab) for patch in chart_kind("colorchecker24").patches]
    for k in range(18):  # E2 to J4 are the Classic's three rows of colours, in other dyes
        row, column = divmod(k, 6)
        own = lab[f"{'EFGHIJ'[column]}{row + 2}"]
        assert own[1:] @ classic[k][1:] > 0.85 * np.hypot(*own[1:]) * np.hypot(
            *classic[k][1:]
        ), "of one hue"


OWN = """# illuminant: {illuminant}
# frame: 120 x 80
name,x0,y0,x1,y1,L,a,b
white,0,0,60,40,100,0,0
red,60,0,120,40,53.24,80.09,67.20
blue,0,40,60,80,32.30,79.19,-107.86
gray,60,40,120,80,53.39,0,0
"""


def test_a_chart_of_ones_own_is_read_under_its_illuminant(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    # sRGB's primaries under its own white (Lindbloom)
    path.write_text(OWN.format(illuminant="D65"))
    kind = chart_kind(str(path))
    assert (kind.width, kind.height, [p.name for p in kind.patches]) == (
        120,
        80,
        ["white", "red", "blue", "gray"],
    )
    assert [p.is_chromatic for p in kind.patches] == [False, True, True, False]
    assert kind.patches[1].box == (0.5, 0, 1, 0.5)
    expected = [(1, 1, 1), (1, 0, 0), (0, 0, 1), (0.5, 0.5, 0.5)]
    np.testing.assert_allclose([p.srgb for p in kind.patches], expected, atol=5e-3)
    # under D50, as in ICC profiles
    np.testing.assert_allclose(kind.patches[1].lab, (54.29, 80.80, 69.89), atol=0.05)
    same = kind_id(str(path))
    path.write_text(OWN.format(illuminant="D50"))
    assert kind_id(str(path)) != same
    assert chart_kind(str(path)).patches[1].lab == (53.24, 80.09, 67.20)


def test_given_srgb_is_taken_and_the_loader_finds_the_file_beside_its_own(
    tmp_path: Path,
) -> None:
    own = "name,x0,y0,x1,y1,L,a,b,R,G,B\nteal,0,0,9,9,50,-20,-20,0,51,255\n"
    (tmp_path / "own.csv").write_text("# illuminant: D50\n# frame: 9 x 9\n" + own)
    entry = {"images": {"a.png": {"c": {"kind": "own.csv", "corners": TILTED.tolist()}}}}
    (tmp_path / "charts.json").write_text(json.dumps(entry))
    (chart,) = read_charts(tmp_path / "charts.json", {"a.png": (420, 300)})["a.png"]
    assert chart_kind(chart.kind).patches[0].srgb == (0, 0.2, 1)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (("# illuminant: {illuminant}\n", ""), "illuminant"),
        (("{illuminant}", "D51"), "'D51'"),
        (("60,0,120,40", "60,0,130,40"), "5"),
        (("32.30", "dark"), "'dark'"),
        (("32.30", "nan"), "'nan'"),
        (("120 x 80", "1.2.3 x 4"), "illuminant"),
        (("blue,", '"blue,'), "line"),
        ((",L,a,b", ",X,Y,Z"), "'L'"),
    ],
)
def test_no_description_is_refused_by_line(
    tmp_path: Path, change: tuple[str, str], named: str
) -> None:
    path = tmp_path / "own.csv"
    path.write_text(OWN.replace(*change).replace("{illuminant}", "D65"))
    with pytest.raises(InputError, match=r"own\.csv: ") as fault:
        chart_kind(str(path))
    assert named in names(fault.value)


def write_spectra(
    path: Path, header: str, nm: Iterable[int], patches: dict[str, list[float]]
) -> None:
    rows = [
        f"{name},0,{k},9,{k + 1},{','.join(map(str, of_one))}"
        for k, (name, of_one) in enumerate(patches.items())
    ]
    top = f"{header}# frame: 9 x 24\nname,x0,y0,x1,y1,{','.join(map(str, nm))}"
    path.write_text("\n".join([top, *rows]))


def test_measured_reflectances_give_the_colours_that_are_published_of_them(
    tmp_path: Path,
) -> None:
    colour = colour_science()
    spectra, published = (
        table["BabelColor Average"]
        for table in (colour.SDS_COLOURCHECKERS, colour.CCS_COLOURCHECKERS)
    )
    path, nm = tmp_path / "own.csv", range(380, 740, 10)
    write_spectra(
        path,
        "# illuminant: D50\n",
        nm,
        {name: spectra[name].values.tolist() for name in spectra},
    )
    lab = np.array([patch.lab for patch in chart_kind(str(path)).patches])
    xyY = np.array([published.data[name] for name in spectra])
    np.testing.assert_allclose(
        lab, colour.XYZ_to_Lab(colour.xyY_to_XYZ(xyY), published.illuminant), atol=0.8
    )


def test_a_camera_and_an_illuminant_of_ones_own_say_how_a_reflectance_looks(
    tmp_path: Path,
) -> None:
    half = [0.5] * 4
    (tmp_path / "lamp.csv").write_text("wavelength,power\n400,1\n700,4\n")
    # A camera whose red is all that is over 600 nm, and so on; the second patch reflects that alone.
    edges = {
        400: (0, 0, 1),
        499: (0, 0, 1),
        500: (0, 1, 0),
        599: (0, 1, 0),
        600: (1, 0, 0),
        700: (1, 0, 0),
    }
    (tmp_path / "camera.csv").write_text(
        "nm,R,G,B\n" + "\n".join(f"{n},{r},{g},{b}" for n, (r, g, b) in edges.items())
    )
    path = tmp_path / "own.csv"
    write_spectra(
        path,
        "# illuminant: lamp.csv\n# camera: camera.csv\n",
        (400, 599, 600, 700),
        {"a": half, "b": [0, 0, 1, 1]},
    )
    gray, red = chart_kind(str(path)).patches
    np.testing.assert_allclose(gray.lab, (76.07, 0, 0), atol=0.01)  # a gray under any light
    np.testing.assert_allclose(gray.srgb, [188 / 255] * 3, atol=2e-3)
    np.testing.assert_allclose(red.srgb, (1, 0, 0), atol=1e-6)
    assert red.measured == red.srgb
    same = kind_id(str(path))
    (tmp_path / "lamp.csv").write_text("wavelength,power\n400,1\n700,2\n")
    assert kind_id(str(path)) != same


@pytest.mark.parametrize(
    ("lamp", "nm", "value", "named"),
    [
        ("D65", (400, 650), 0.5, "400"),
        ("D65", (400, 700), 50, "4"),
        ("D65", (400, 700), -0.1, "4"),
        ("short.csv", (400, 700), 0.5, "450"),
        ("words.csv", (400, 700), 0.5, "table"),
        ("wide.csv", (400, 700), 0.5, "columns"),
        ("none.csv", (400, 700), 0.5, "file"),
        ("D51", (400, 700), 0.5, "'D51'"),
    ],
)
def test_reflectances_are_refused_by_what_they_lack(
    tmp_path: Path, lamp: str, nm: tuple[int, int], value: float, named: str
) -> None:
    (tmp_path / "short.csv").write_text("wavelength,power\n450,1\n700,4\n")
    (tmp_path / "words.csv").write_text("wavelength,power\n400,bright\n700,4\n")
    (tmp_path / "wide.csv").write_text("wavelength,power\n400,1,2\n700,4,3\n")
    write_spectra(tmp_path / "own.csv", f"# illuminant: {lamp}\n", nm, {"a": [value, value]})
    with pytest.raises(InputError, match=r"own\.csv: ") as fault:
        chart_kind(str(tmp_path / "own.csv"))
    assert named in names(fault.value)
