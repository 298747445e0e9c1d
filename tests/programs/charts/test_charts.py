"""Marking charts: the detector, the order of patches, the geometry, the file, and the page's server over HTTP."""

import json
import re
import socket
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from support.colmap_folder import write_image, write_model
from support.made_scene import TILTED, make_camera, make_pose, painted
from support.messages import refused

import sucre_bench as sb
from sucre_bench.arrays import Array
from sucre_bench.commands.data import charts
from sucre_bench.errors import InputError
from sucre_bench.imaging.chart_kinds import KINDS, chart_kind
from sucre_bench.imaging.chart_patches import image_from_chart, reading_order
from sucre_bench.loading.view_files import Files
from sucre_bench.programs.charts.charts_json import ChartsFile
from sucre_bench.programs.charts.proposals import Proposal, detect, propose
from sucre_bench.programs.charts.server import PageServer
from sucre_bench.programs.charts.session import Session
from sucre_bench.scene import Arrays, Chart, View

# A DGK chart of 60 x 40 cm in the world, standing on nothing: its corners in metres, slanted, 3 m along z.
BOARD = np.array([[-0.3, -0.2, 3.0], [0.29, -0.2, 3.1], [0.29, 0.2, 3.1], [-0.3, 0.2, 3.0]])


def board_view(
    name: str,
    position: tuple[float, float, float],
    *,
    yaw: float = 0.0,
    wall_m: float | None = None,
    mark: bool = False,
) -> View:
    """The board on its own plane, which fills the image, in water; wall_m: something flat before it at this depth."""
    camera, pose = make_camera(240, 180, 260), make_pose(position, yaw)
    normal = np.cross(BOARD[1] - BOARD[0], BOARD[3] - BOARD[0])
    u, v = np.meshgrid(np.arange(240) + 0.5, np.arange(180) + 0.5)
    rays = np.stack([u, v, np.ones_like(u)], -1) @ np.linalg.inv(camera.K).T
    world_from_cam = np.linalg.inv(pose)
    depth = (
        normal @ (BOARD[0] - world_from_cam[:3, 3]) / (rays @ world_from_cam[:3, :3].T @ normal)
    )
    corners = true_corners(camera, pose)
    rgb = 0.1 + painted(chart_kind("dgk"), corners, (180, 240)) * np.array([0.2, 0.6, 0.7])
    if wall_m is not None:
        depth = np.full_like(depth, wall_m)
    marked = (Chart("left", "dgk", corners),) if mark else ()
    return View(
        name, Arrays(rgb.astype(np.float32), depth.astype(np.float32)), camera, pose, marked
    )


def true_corners(camera: Any, pose: Array) -> Array:
    """In float64, by homogeneous coordinates."""
    homogeneous = np.c_[BOARD, np.ones(4)] @ (camera.K @ pose[:3]).T
    return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])


# -- the order of patches ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("turn", [1, 2, 3])
def test_a_chart_begun_at_the_wrong_corner_is_told_which_is_right(kind: str, turn: int) -> None:
    shown = 0.2 + painted(chart_kind(kind), TILTED) * np.array([0.05, 0.4, 0.5])
    right = Chart("c", kind, TILTED)
    assert reading_order(shown, right).fault == ""
    wrong = replace(right, corners=np.roll(TILTED, turn, axis=0))
    order = reading_order(shown, wrong)
    np.testing.assert_array_equal(np.roll(wrong.corners, -order.turn, axis=0), TILTED)
    assert order.turn == turn
    assert len(re.findall(r"(?:top|bottom) (?:left|right)", order.fault)) == 2


# -- the detector ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("turn", [0, 1])
def test_a_colorchecker_in_water_is_found_to_a_tenth_of_a_patch(turn: int) -> None:
    shown = np.rot90(0.1 + colorchecker() * np.array([0.3, 0.6, 0.7]), turn)
    (found,) = detect(shown, "colorchecker24")
    expected = LYING if not turn else np.stack([LYING[:, 1], 800 - LYING[:, 0]], axis=1)
    np.testing.assert_allclose(found.corners, expected, atol=7)
    assert reading_order(shown, found).fault == ""
    assert detect(shown, "dgk") == []


LYING = np.array([[200.0, 150], [620, 140], [640, 420], [190, 430]])


def colorchecker() -> Array:
    """A chart in a black frame, on gray."""
    chart = painted(chart_kind("colorchecker24"), LYING, (600, 800))
    is_outside = (chart == 1).all(-1)
    scene = np.where(is_outside[..., None], 0.35, chart)
    corners = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]) * [1.12, 1.12, 1] - [
        0.06,
        0.06,
        0,
    ]
    frame = corners @ image_from_chart(LYING).T
    around = np.rint(frame[:, :2] / frame[:, 2:]).astype(int)
    is_framed = cv2.fillConvexPoly(np.zeros((600, 800), np.uint8), around, 1) > 0
    scene[is_framed & is_outside] = 0.03
    return scene


# -- the geometry ------------------------------------------------------------------------------------------------


def test_a_chart_that_is_not_seen_whole_is_not_proposed() -> None:
    marked = board_view("a.png", (0.2, 0.05, -0.3), yaw=0.08, mark=True)
    others = [
        board_view("hidden.png", (0.4, 0, -0.8), wall_m=1.5),
        board_view("cut.png", (1.2, 0, 0)),
        board_view("behind.png", (0, 0, 5)),
        board_view("far.png", (0, 0, -40)),
        replace(
            board_view("no-depth.png", (0.1, 0, 0)),
            pixels=Arrays(np.zeros((180, 240, 3), np.float32)),
        ),
        replace(board_view("no-pose.png", (0.1, 0, 0)), cam_from_world=None),
    ]
    assert list(propose([(marked, marked.charts[0])], others)) == []


# -- the file ----------------------------------------------------------------------------------------------------


def test_the_file_keeps_what_it_holds_and_is_read_by_the_loader(tmp_path: Path) -> None:
    path, sizes = tmp_path / "charts.json", {"a.png": (420, 300), "b.png": (420, 300)}
    old = {
        "note": "by hand",
        "kind": "colorchecker24",
        "images": {"a.png": {"one": TILTED.tolist()}},
    }
    path.write_text(json.dumps(old))
    file = ChartsFile(path, sizes)
    file.propose([_proposal("b.png", "one")])
    file.turn_down("b.png", "two")
    file.propose([_proposal("b.png", "two")])
    file.confirm("b.png", [file.chart("b.png", "three", "dgk", TILTED.tolist())])
    file.save()
    content = json.loads(path.read_text())
    assert (content["note"], content["images"]["a.png"]) == (
        "by hand",
        {"one": TILTED.tolist()},
    )
    again = ChartsFile(path, sizes)
    assert [(c.name, c.kind) for c in again.confirmed("b.png")] == [("three", "dgk")]
    assert [p.chart.name for p in again.proposed("b.png")] == ["one"], "two was turned down"
    assert again.confirmed("a.png")[0].kind == "colorchecker24"


def _proposal(view: str, name: str) -> Any:
    return Proposal(view, Chart(name, "dgk", TILTED), "a.png")


# -- the page's server -------------------------------------------------------------------------------------------


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PageServer]:
    views = [
        board_view("a <b>.png", (0, 0, 0)),
        board_view("b.png", (0.4, -0.1, -0.8), yaw=-0.1),
    ]
    file = ChartsFile(tmp_path / "charts.json", {view.name: (240, 180) for view in views})
    with PageServer(Session(views, file, "dgk")) as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def get(url: str, body: Any = None, raw: bool = False, **headers: str) -> tuple[int, bytes]:
    data = None if body is None else (body if raw else json.dumps(body)).encode()
    request = urllib.request.Request(url, data, {"Content-Type": "application/json", **headers})
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(request, timeout=300) as reply:
            return reply.status, reply.read()
    except urllib.error.HTTPError as fault:
        with fault:
            return fault.code, fault.read()


def test_four_corners_are_checked_saved_and_carried_over(
    server: PageServer, tmp_path: Path
) -> None:
    view = server.session.views[0]
    corners = true_corners(view.camera, view.cam_from_world).tolist()

    def checked(corners: list[list[float]]) -> dict[str, Any]:
        body = {"number": 0, "kind": "dgk", "corners": corners}
        return dict(json.loads(get(server.url + "check", body)[1]))

    seen = checked(corners)
    assert seen["fault"] == ""
    assert seen["patches"][6]["expected"] == "#eb1c24"
    assert re.search("bottom right .*top left", checked(corners[2:] + corners[:2])["fault"])
    chart = {"name": "left", "kind": "dgk", "corners": corners}
    status, state = get(server.url + "save", {"number": 0, "charts": [chart]})
    assert status == 200
    (proposed,) = json.loads(state)["views"][1]["proposed"]
    assert (proposed["name"], proposed["from"]) == ("left", "a <b>.png")
    content = json.loads((tmp_path / "charts.json").read_text())
    np.testing.assert_allclose(content["images"]["a <b>.png"]["left"], corners, atol=0.006)
    get(server.url + "save", {"number": 1, "charts": [], "turned_down": ["left"]})
    assert json.loads(get(server.url + "state")[1])["views"][1]["proposed"] == [], (
        "not proposed again"
    )


def test_the_image_comes_at_its_own_size_and_brighter_when_asked(server: PageServer) -> None:
    plain, bright = (
        cv2.imdecode(
            np.frombuffer(get(f"{server.url}image?view=0&bright={b}")[1], np.uint8),
            cv2.IMREAD_COLOR,
        )
        for b in "01"
    )
    assert plain.shape == (180, 240, 3)
    assert np.percentile(bright[..., 2], 99) > 3 * np.percentile(plain[..., 2], 99), (
        "water leaves little red"
    )


def test_only_this_machines_page_is_answered(server: PageServer) -> None:
    assert server.server_address[0] == "127.0.0.1"
    assert get(server.url)[0] == 200
    assert get(f"http://127.0.0.1:{server.server_port}/")[0] == 403
    assert get(f"http://127.0.0.1:{server.server_port}/guess/state")[0] == 403
    assert get(server.url + "state", Host="evil.example")[0] == 403
    assert (
        get(server.url + "save", {"number": 0, "charts": []}, Origin="http://evil.example")[0]
        == 403
    )
    assert get(server.url + "image?view=7")[0] == 422
    assert get(server.url + "../../charts.json")[0] == 404
    assert get(server.url + "save", {"number": 0, "charts": [], "path": "/tmp/x"})[0] == 400
    assert get(server.url + "check", "[" * 100_000, raw=True)[0] == 400, "nested too deeply"
    status, said = get(
        server.url + "check",
        {"number": 0, "kind": "/etc/secret.csv", "corners": TILTED.tolist()},
    )
    assert (status, b"is not the page's" in said) == (422, True)


REQUESTS = {
    "no address": b"GET http://[ HTTP/1.1\r\nHost: x\r\n\r\n",
    "no length": b"POST /%b/save HTTP/1.1\r\nHost: %h\r\nContent-Type: application/json\r\n\r\n",
    "a negative length": b"POST /%b/save HTTP/1.1\r\nHost: %h\r\nContent-Length: -1\r\n\r\n",
    "a length of 5,000 digits": b"POST /%b/save HTTP/1.1\r\nHost: %h\r\nContent-Length: "
    + b"9" * 5000
    + b"\r\n\r\n",
    "a length in other digits": b"POST /%b/save HTTP/1.1\r\nHost: %h\r\nContent-Length: \xb2\r\n\r\n",
}


@pytest.mark.parametrize("request_", REQUESTS.values(), ids=REQUESTS)
def test_what_is_no_request_of_the_page_is_refused_and_the_server_goes_on(
    server: PageServer, capsys: pytest.CaptureFixture[str], request_: bytes
) -> None:
    host = f"127.0.0.1:{server.server_port}".encode()
    with socket.create_connection(server.server_address, timeout=300) as connection:
        connection.sendall(request_.replace(b"%b", server.token.encode()).replace(b"%h", host))
        answer = connection.recv(1000)
    assert re.match(rb"HTTP/1.. 4\d\d ", answer), answer
    assert get(server.url + "state")[0] == 200
    assert "Traceback" not in capsys.readouterr().err


def test_the_page_takes_nothing_from_elsewhere(server: PageServer) -> None:
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    with opener.open(server.url, timeout=300) as reply:
        page = reply.read().decode()
    assert "default-src 'none'" in reply.headers["Content-Security-Policy"]
    script = get(server.url + "page.js")[1].decode()
    assert not any(word in page + script for word in ("http:", "https:", "innerHTML", "eval("))


def test_a_wrong_chart_is_refused_and_nothing_is_written(
    server: PageServer, tmp_path: Path
) -> None:
    for corners in (
        TILTED[::-1].tolist(),
        [[0, 0]] * 4,
        "x",
        [[-5, 0], [9, 0], [9, 9], [0, 9]],
    ):
        chart = {"name": "c", "kind": "dgk", "corners": corners}
        assert get(server.url + "save", {"number": 0, "charts": [chart]})[0] == 422
    assert not (tmp_path / "charts.json").exists()


# -- the command -------------------------------------------------------------------------------------------------


def marked(*words: str) -> str:
    """What the command says; its errors are raised."""
    result = CliRunner().invoke(charts, words, catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


def two_views() -> list[View]:
    """The chart is marked in the first."""
    return [board_view("a.png", (0, 0, 0), mark=True), board_view("b.png", (0.4, -0.1, -0.8))]


def write_scene(root: Path) -> None:
    """Two views of the board as the colmap dataset reads them."""
    views = two_views()
    (root / "depths").mkdir()
    for view in views:
        write_image(root / "images" / view.name, np.rint(view.rgb * 255).astype(np.uint8))
        np.save(root / "depths" / f"depth_{view.name[0]}.npy", view.depth)
    K = make_camera(240, 180, 260).K
    write_model(
        root / "sparse",
        [(view.name, (1, 0, 0, 0, *view.cam_from_world[:3, 3].tolist()), 1) for view in views],
        [f"1 PINHOLE 240 180 {K[0, 0]} {K[1, 1]} {K[0, 2]} {K[1, 2]}"],
    )
    (chart,) = views[0].charts
    marked = {"a.png": {chart.name: chart.corners.tolist()}}
    (root / "charts.json").write_text(json.dumps({"images": marked}))


def test_accepted_proposals_are_charts_of_the_scene(tmp_path: Path) -> None:
    write_scene(tmp_path)
    said = marked(str(tmp_path / "images" / "b.png"), "--accept")
    assert "1 proposal accepted, 0 left" in said
    view = next(sb.load_scenes("colmap", root=tmp_path))["b.png"]
    (chart,) = view.charts
    np.testing.assert_allclose(
        chart.corners, true_corners(view.camera, view.cam_from_world), atol=0.05
    )


def test_charts_are_found_in_photos_without_a_camera(tmp_path: Path) -> None:
    write_image(tmp_path / "a.png", np.rint(255 * colorchecker()).astype(np.uint8))
    words = ("--kind", "colorchecker24", "--accept")
    said = marked("dataset=photos", f"dataset.root={tmp_path}", *words)
    assert "1 proposal accepted, 0 left" in said
    (view,) = next(sb.load_scenes("photos", root=tmp_path))
    np.testing.assert_allclose(view.charts[0].corners, LYING, atol=7)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["dataset=demo", "--kind", "nosuch.csv"], "nosuch.csv"),
        (["nowhere/images/a.png"], "nowhere/images/a.png"),
        ([], "view"),
        (["dataset=demo", "dataset.width=64", "dataset.height=48"], "'demo'"),
    ],
)
def test_what_cannot_be_marked_is_said(words: list[str], named: str) -> None:
    with refused(named):
        marked(*words)


def test_a_charts_file_that_its_loader_does_not_look_for_is_not_made(tmp_path: Path) -> None:
    """Of SQUID it lies in the folder of an image set, and its root is that of many."""
    for folder in ("set", "D5/Raw"):
        write_image(tmp_path / folder / "LFT_1.png", np.full((60, 80, 3), 90, np.uint8))
    with pytest.raises(InputError, match=r"'seathru' .*charts\.json"):
        marked("dataset=seathru", f"dataset.root={tmp_path}", "--accept")
    assert not list(tmp_path.rglob("charts.json"))


@pytest.mark.parametrize(
    ("word", "named"),
    [
        ("dataset.undistort=true", "undistort"),
        ("dataset.image_scale=0.5", "image_scale"),
        ("degrade.noise=0.1", "degrade"),
    ],
)
def test_corners_are_not_marked_in_changed_images(
    tmp_path: Path, word: str, named: str
) -> None:
    write_scene(tmp_path)
    with refused("corners", named):
        marked("dataset=colmap", f"dataset.root={tmp_path}", word, "--accept")


def test_a_view_that_cannot_be_read_does_not_end_the_others(tmp_path: Path) -> None:
    views = two_views()
    bad = replace(views[1], name="bad.png", pixels=Files(tmp_path / "bad.png", (240, 180)))
    names = ("a.png", "b.png", "bad.png")
    file = ChartsFile(tmp_path / "charts.json", dict.fromkeys(names, (240, 180)))
    file.confirm("a.png", views[0].charts)
    session = Session([bad], file, "dgk", views)
    session.prepare()
    file.propose([replace(file.proposed("b.png")[0], view="bad.png")])
    accepted, doubtful = session.accept()
    assert [proposal.view for proposal in accepted] == ["b.png"]
    assert [
        (proposal.view, str(tmp_path / "bad.png") in fault) for proposal, fault in doubtful
    ] == [("bad.png", True)]
    assert "b.png" in json.loads((tmp_path / "charts.json").read_text())["images"]
