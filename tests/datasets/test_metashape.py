"""The metashape dataset against exports and projects written here, with lenses by the formulas of the manual."""

import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import tifffile
from support.messages import Lines
from support.miniatures import (
    BOTH,
    CAMERAS,
    HEIGHT,
    INNER,
    LENSES,
    POINT,
    SCALE,
    TURN,
    WIDTH,
    Change,
    camera_xml,
    check_both,
    chunk_xml,
    cut,
    disk_depth,
    imaged,
    loader,
    one_line,
    pose_of,
    scene_fault_test,
    seen,
    view_fault_test,
    write_spot,
    write_survey,
)

from sucre_bench.datasets.metashape import Metashape
from sucre_bench.errors import InputError
from sucre_bench.machine.progress import watched_by

WORLD_POINT = SCALE * TURN @ POINT  # the translation, of an earth's radius, is left away


load = loader(Metashape)


@pytest.mark.parametrize("lens", LENSES)
def test_a_known_point_is_seen_where_it_is_in_both_views(tmp_path: Path, lens: str) -> None:
    scene = load(write_survey(tmp_path, lens))
    assert [view.name for view in scene] == ["DSC_0.png", "DSC_1.png"], (
        "aligned, enabled, found without suffix"
    )
    assert scene.has == {"poses", "depth"}
    check_both(*scene, point=WORLD_POINT)
    check_both(*load(tmp_path, image_scale=0.5), point=WORLD_POINT)


def test_depth_maps_in_units_of_the_chunk(tmp_path: Path) -> None:
    write_survey(tmp_path, unit=1.0)
    check_both(*load(tmp_path, depth_units="chunk"), point=WORLD_POINT)
    assert load(tmp_path).data_id != load(tmp_path, depth_units="chunk").data_id


@pytest.mark.parametrize("lens", ["usual", "every term", "fisheye"])
def test_depth_maps_that_match_the_photographs(tmp_path: Path, lens: str) -> None:
    write_survey(tmp_path, lens)
    for number in range(2):
        point = seen(pose_of(*BOTH[number]))
        depth = disk_depth(imaged(point, lens), SCALE * point[2]).astype(np.float16)
        # as Metashape may
        tifffile.imwrite(tmp_path / f"depths/DSC_{number}.tif", depth, compression="deflate")
    check_both(*load(tmp_path, depth_camera="image"), point=WORLD_POINT)


def test_images_that_undistort_photos_wrote(tmp_path: Path) -> None:
    """Their principal point is in the middle, and they may be of another format; depth maps are as they were."""
    write_survey(tmp_path)
    shutil.rmtree(tmp_path / "images")
    for number in range(2):
        x, y, z = seen(pose_of(*BOTH[number]))
        at = np.array([INNER["f"] * x / z + WIDTH / 2, INNER["f"] * y / z + HEIGHT / 2])
        write_spot(tmp_path / f"flat/DSC_{number}.tif", at)
    check_both(*load(tmp_path, undistorted=True, images="flat"), point=WORLD_POINT)


def test_a_rig_puts_the_second_camera_by_its_sensor(tmp_path: Path) -> None:
    offset = np.linalg.inv(pose_of(*BOTH[0])) @ pose_of(*BOTH[1])
    numbers = (
        " ".join(map(repr, part.ravel().tolist())) for part in (offset[:3, :3], offset[:3, 3])
    )
    slave = (
        f'<sensor id="1" label="right" type="frame" master_id="0"><calibration type="frame" class="adjusted">'
        f'<resolution width="{WIDTH}" height="{HEIGHT}"/>'
        + "".join(f"<{name}>{value!r}</{name}>" for name, value in INNER.items())
        + "</calibration><rotation>{}</rotation><location>{}</location></sensor>".format(
            *numbers
        )
    )
    second = camera_xml(1, "DSC_1", 'master_id="0"', posed=False).replace(
        'sensor_id="0"', 'sensor_id="1"'
    )
    write_survey(tmp_path, "pinhole")
    chunk = chunk_xml("pinhole", camera_xml(0, "DSC_0") + second, sensors=slave)
    (tmp_path / "cameras.xml").write_text(f"<document>{chunk}</document>")
    check_both(*load(tmp_path), point=WORLD_POINT)


# -- projects ----------------------------------------------------------------------------------------------


def archive(path: Path, content: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("doc.xml", f'<?xml version="1.0" encoding="UTF-8"?>\n{content}')


def write_project(root: Path, suffix: str) -> Path:
    """Photographs of one name in the folders port and starboard, which only the project's paths tell apart."""
    write_survey(root)
    (root / "cameras.xml").unlink()
    paths = ("../../../images/port/D.jpg", "C:\\dive\\images\\starboard\\D.jpg")
    for number, side in enumerate(("port", "starboard")):
        (root / "images" / side).mkdir()
        (root / f"images/DSC_{number}.png").rename(root / "images" / side / "D.png")
    photos = "".join(
        f'<camera camera_id="{i}"><photo path="{path}"/></camera>'
        for i, path in enumerate(paths)
    )
    frame = f"<cameras>{photos}</cameras></frame>"
    if suffix == ".psz":
        chunk = chunk_xml("usual", CAMERAS, frames=f'<frames><frame id="0">{frame}</frames>')
        archive(
            root / "dive.psz",
            f'<document version="1.2.0"><chunks active_id="0">{chunk}</chunks></document>',
        )
        return root
    (root / "dive.psx").write_text(
        '<document version="1.2.0" path="{projectname}.files/project.zip"/>'
    )
    listed = '<chunk id="0" path="0/chunk.zip"/><chunk id="3" path="3/chunk.zip"/>'
    archive(
        root / "dive.files/project.zip",
        f'<document><chunks active_id="3">{listed}</chunks></document>',
    )
    archive(
        root / "dive.files/0/chunk.zip", '<chunk label="Other"><sensors/><cameras/></chunk>'
    )
    frames = '<frames next_id="1"><frame id="0" path="0/frame.zip"/></frames>'
    archive(root / "dive.files/3/chunk.zip", chunk_xml("usual", CAMERAS, frames=frames))
    archive(root / "dive.files/3/0/frame.zip", f'<frame version="1.2.0">{frame}')
    return root


@pytest.mark.parametrize("suffix", [".psx", ".psz"])
def test_a_project_knows_which_of_two_photographs_is_meant(tmp_path: Path, suffix: str) -> None:
    scene = load(write_project(tmp_path, suffix))
    assert [view.name for view in scene] == ["port/D.png", "starboard/D.png"]
    check_both(*scene, point=WORLD_POINT)


def test_a_chunk_is_chosen_by_its_label(tmp_path: Path) -> None:
    write_project(tmp_path, ".psx")
    assert len(load(tmp_path, chunk="Dive 1")) == 2
    with pytest.raises(InputError, match=r"\b0 cameras"):
        load(tmp_path, chunk="Other")
    with pytest.raises(InputError, match=r"'dive 1'.*'Dive 1'"):
        load(tmp_path, chunk="dive 1")


def test_groups_tell_photographs_of_one_name_apart(tmp_path: Path) -> None:
    write_survey(tmp_path)
    for number, side in enumerate(("port", "starboard")):
        (tmp_path / "images" / side).mkdir()
        (tmp_path / "depths" / side).mkdir()
        (tmp_path / f"images/DSC_{number}.png").rename(tmp_path / "images" / side / "D.png")
        (tmp_path / f"depths/DSC_{number}.tif").rename(tmp_path / "depths" / side / "D.tif")
    grouped = "".join(
        f'<group id="{i}" label="{side}">{camera_xml(i, "D")}</group>'
        for i, side in enumerate(("port", "starboard"))
    )
    (tmp_path / "cameras.xml").write_text(f"<document>{chunk_xml('usual', grouped)}</document>")
    scene = load(tmp_path)
    assert [view.name for view in scene] == ["port/D.png", "starboard/D.png"]
    check_both(*scene, point=WORLD_POINT)


def test_each_component_is_a_scene(tmp_path: Path) -> None:
    write_survey(tmp_path)
    text = (tmp_path / "cameras.xml").read_text()
    text = text.replace("</components>", '<component id="1" label="Component 2"/></components>')
    text = text.replace(
        '<camera id="1" sensor_id="0" component_id="0"',
        '<camera id="1" sensor_id="0" component_id="1"',
    )
    (tmp_path / "cameras.xml").write_text(text)
    said = Lines()
    with watched_by(said):
        one, two = Metashape(root=tmp_path).scenes()
    assert (one.name, two.name) == (
        f"{tmp_path.name}/Component 1",
        f"{tmp_path.name}/Component 2",
    )
    assert any("Component 2 " in text for text in said.lines), (
        "its lengths are not metres, which is said"
    )
    assert any("2 of 5 cameras" in text for text in said.lines)


# -- faults ------------------------------------------------------------------------------------------------


def text(old: str, new: str) -> Change:
    def change(root: Path) -> None:
        content = (root / "cameras.xml").read_text()
        assert old in content
        (root / "cameras.xml").write_text(content.replace(old, new))

    return change


SCENE: dict[str, tuple[Change, list[str]]] = {
    "two documents": (
        lambda root: shutil.copy(root / "cameras.xml", root / "b.xml"),
        ["b.xml, cameras.xml are there"],
    ),
    "nothing aligned": (text("<transform>", "<other>"), ["cameras.xml"]),
    "a damaged pose": (
        text(" 0.0 0.0 0.0 1.0</transform>", "</transform>"),
        ["cameras.xml", "reshape"],
    ),
    "a scaled pose": (
        text("0.0 0.0 0.0 1.0</transform>", "0.0 0.0 0.0 2.0</transform>"),
        ["DSC_0.JPG", "not rigid"],
    ),
    "a number that is none": (
        text("<f>150.0</f>", "<f>wide</f>"),
        ["cameras.xml: ", "Export Cameras"],
    ),
    "no focal length": (text("<f>150.0</f>", "<f>-1</f>"), ["sensor 'GoPro'", "f = -1"]),
    "a spherical sensor": (
        text('type="frame"', 'type="spherical"'),
        ["sensor 'GoPro' is spherical"],
    ),
    "one image twice": (
        text('label="DSC_1"', 'label="dsc_0"'),
        ["cameras.xml", "'dsc_0'", "DSC_0.png"],
    ),
    "no image folder": (
        lambda root: shutil.rmtree(root / "images"),
        ["images: ", "folder", "dataset.images"],
    ),
    "no images": (
        lambda root: [path.unlink() for path in root.glob("images/*")],
        ["images: no image", "'DSC_0.JPG' of cameras.xml"],
    ),
    "others' depth maps": (
        lambda root: [
            path.rename(path.with_name(f"x{path.name}")) for path in root.glob("depths/*")
        ],
        ["depths: ", "depth map"],
    ),
}


test_a_fault_of_the_scene_is_one_line_about_the_file = scene_fault_test(
    write_survey, load, SCENE
)


@pytest.mark.parametrize("name", ["project.zip", "3/chunk.zip", "3/0/frame.zip"])
@pytest.mark.parametrize("damage", [Path.unlink, cut])
def test_a_damaged_project_is_refused(tmp_path: Path, name: str, damage: Change) -> None:
    path = write_project(tmp_path, ".psx") / "dive.files" / name
    damage(path)
    with one_line(str(path), "Export Cameras"):
        load(tmp_path)


@pytest.mark.parametrize(
    "path", ["/etc/x.zip", "../../../out.zip", "C:\\out.zip", "a/../../../.."]
)
@pytest.mark.parametrize(
    "name", ["dive.psx", "dive.files/project.zip", "dive.files/3/chunk.zip"]
)
def test_a_project_names_no_part_outside_of_its_folder(
    tmp_path: Path, name: str, path: str
) -> None:
    root = write_project(tmp_path / "survey", ".psx")
    if name == "dive.psx":
        (root / name).write_text(f'<document path="{path}"/>')
    elif "chunk" in name:
        archive(
            root / name,
            chunk_xml(
                "usual", CAMERAS, frames=f'<frames><frame id="0" path="{path}"/></frames>'
            ),
        )
    else:
        archive(
            root / name,
            f'<document><chunks active_id="3"><chunk id="3" path="{path}"/></chunks></document>',
        )
    with one_line("dive.psx: ", f"'{path}'", f"outside of {root}"):
        load(root)


def test_xml_of_more_than_256_mebibytes_is_not_read(tmp_path: Path) -> None:
    with (write_survey(tmp_path) / "cameras.xml").open("r+b") as file:
        file.truncate((256 << 20) + 1)  # a hole, which takes no room
    with pytest.raises(InputError, match=r"cameras\.xml: .*256 MiB"):
        load(tmp_path)
    archive(tmp_path / "dive.psz", "<document/>")
    content = bytearray((tmp_path / "dive.psz").read_bytes())
    at = content.index(b"PK\1\2") + 24  # the size of doc.xml, unpacked
    content[at : at + 4] = ((256 << 20) + 1).to_bytes(4, "little")
    (tmp_path / "dive.psz").write_bytes(content)
    with pytest.raises(InputError, match=r"dive\.psz: .*doc\.xml .*256 MiB"):
        load(tmp_path, document="dive.psz")


@pytest.mark.parametrize("label", ["a/../../x", "C:/dive/x", "/x", "./.x/../x"])
def test_a_camera_without_image_is_called_by_a_path_that_cannot_leave(
    tmp_path: Path, label: str
) -> None:
    write_survey(tmp_path, cameras=camera_xml(0, label) + camera_xml(1, "DSC_1"))
    (tmp_path / "depths/DSC_0.tif").unlink()
    bad = next(view for view in load(tmp_path) if view.name != "DSC_1.png")
    assert not {"..", "/", "C:"} & set(Path(bad.name).parts)
    with pytest.raises(InputError, match=r"cameras\.xml"):
        _ = bad.rgb


def test_data_id_tells_which_lens_depth_maps_are_of(tmp_path: Path) -> None:
    """Images that Undistort Photos wrote have a centred camera; depth maps are resampled from the sensor's."""
    write_survey(tmp_path, "pinhole")
    before = load(tmp_path, undistorted=True)
    text("<cx>4.0", "<cx>9.0")(tmp_path)
    after = load(tmp_path, undistorted=True)
    assert not np.array_equal(before.views[0].depth, after.views[0].depth)
    assert before.data_id != after.data_id


def two_in_folders(root: Path) -> None:
    (root / "images/DSC_0.png").unlink()
    for folder in "ab":
        write_spot(root / f"images/{folder}/DSC_0.tif", np.ones(2))


VIEW: dict[str, tuple[str, Change, list[str]]] = {
    "image twice": ("rgb", two_in_folders, ["a/DSC_0.tif and b/DSC_0.tif"]),
    "depth twice": (
        "depth",
        lambda root: np.save(root / "depths/DSC_0.npy", np.ones((60, 80))),
        ["depths/DSC_0.npy", "keep one"],
    ),
}


test_a_fault_of_one_view_leaves_the_other = view_fault_test(write_survey, load, VIEW)
