"""A table of faults: each command ends with its exit code, and names the place and the remedy in few lines."""

import contextlib
import http.client
import multiprocessing.synchronize
import os
import re
import shlex
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from filelock import FileLock
from support.colmap_folder import write_dive
from support.command_line import forks, run_bounded, run_here
from support.messages import Lines

from sucre_bench.machine import progress
from sucre_bench.machine.cache import waited_lock
from sucre_bench.programs.charts.server import PageServer
from sucre_bench.programs.charts.session import open_session

LONG = "x" * 300
RUN = "run dataset=colmap dataset.root=dive method=gray_world metrics=[coverage] tracking.uri=off report=false"

RUN_SUCRE = RUN.replace("=gray_world", "=sucre")
RUN_COMMAND = RUN.replace("=gray_world", "=command \"method.run='cp {input} {output}'\"")

# A command, its exit code, a pattern of what it says on stderr.
CASES: dict[str, tuple[str, int, str]] = {
    "no results folder's name": (f"{RUN} out=", 2, r"^error: out: .*empty; "),
    "no time for a view": (f"{RUN} view_timeout_s=0", 2, r"view_timeout_s"),
    "a word for overwrite that is none": (
        f"{RUN} overwrite=perhaps",
        2,
        r"overwrite.*(missing|always)",
    ),
    "a file as results folder": (f"{RUN} out=dive/images/a.png", 2, r"a\.png: .*file; "),
    "a water that is not there": (
        f"{RUN_SUCRE} method.water=none.json",
        2,
        r"none\.json: .*; .*method\.water",
    ),
    "a pipe as water": (f"{RUN_SUCRE} method.water=pipe.yaml", 2, r"pipe\.yaml: .*pipe; "),
    "no water in a file": (
        f"{RUN_SUCRE} method.water=empty.json",
        2,
        r"empty\.json: .*\bB\b.*; ",
    ),
    "no water in a folder": (
        f"{RUN_SUCRE} method.water=dive/images",
        2,
        r"dive/images: holds no \.json.*; ",
    ),
    "a pipe as network": (
        "run dataset=colmap dataset.root=dive method=onnx method.model=pipe.onnx",
        2,
        r"pipe\.onnx: .*pipe; .*method\.model",
    ),
    "a pipe as what a command rests on": (
        f"{RUN_COMMAND} method.rests_on=pipe.py",
        2,
        r"pipe\.py: .*pipe; .*method\.rests_on",
    ),
    "a pipe as list of views": (f"{RUN} views=views.txt", 2, r"views\.txt: .*pipe; "),
    "a pipe as reference": ("score dive/images --reference pipe.py", 2, r"pipe\.py: .*pipe; "),
    "a pipe as score table": (f"{RUN} out=piped", 2, r"piped/scores\.parquet: .*pipe; "),
    "a device as bundle": ("verify /dev/zero", 2, r"/dev/zero: .*; "),
    "a device as results": ("compare /dev/zero", 2, r"/dev/zero: .*; "),
    "a variable that is not set": ("prepare '' out", 2, r"PHOTOS.*: is empty; "),
    "an empty root to run": (f"{RUN} dataset.root=", 2, r"^error: dataset\.root: is empty; "),
    "an empty plugin to run": (f"{RUN} --plugin ''", 2, r"--plugin.*: is empty; "),
    "a seed of 77 bits": (f"{RUN} seed=99999999999999999999999", 2, r"seed: is 9+; .*below"),
    "a list as label": (f"{RUN} method.label=[1]", 2, r"method\.label: .*\[1\]; .*text"),
    "a reference to nothing": (f"{RUN} baseline='${{nope}}'", 2, r"baseline: .*'nope'.*; "),
    "an image whose name is no UTF-8": (
        "score latin",
        2,
        r"^error: latin/\\udce9\.png: .*UTF-8; rename",
    ),
    "a folder whose name is no UTF-8": (
        "compare '\udce9'",
        2,
        r"^error: \\udce9: .*UTF-8; rename",
    ),
    "a method twice in an experiment": (
        "run twice.yaml",
        2,
        r"two jobs .* are the same, .*clahe",
    ),
    "a pixel at infinity": (
        "prepare dive/images out --length a.png inf 1 2 2 1",
        2,
        r"--length: inf; ",
    ),
    "a link to itself": ("restore loop out", 2, r"/loop: links to itself; "),
    "a name of six lines": (
        "compare 'a\r\v\f\x85\u2028b'",
        2,
        r"^error: a\\r\\x0b\\x0c\\x85\\u2028b: .*; .*\n$",
    ),
    "a pipe as plugin": ("run --plugin pipe.py method=x", 2, r"pipe\.py: .*; "),
    "a deep experiment": ("run deep.yaml", 2, r"deep\.yaml: cannot be read, .*depth.*; "),
    "a long path to run": (
        f"run dataset=colmap dataset.root={LONG} method=gray_world",
        2,
        LONG,
    ),
    "a long results folder": (f"{RUN} out={LONG}", 2, rf"{LONG}.*; "),
    "a long path to score": (f"score {LONG}", 2, rf"{LONG}.*; "),
    "a long name of a new plugin": (f"new method {LONG}", 2, LONG),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cases")
    write_dive(folder / "dive", ("a.png", "b.png"))
    (folder / "deep.yaml").write_text("[" * 100_000)
    (folder / "empty.json").write_text("{}")
    (folder / "twice.yaml").write_text("hydra: {sweeper: {methods: [clahe, clahe]}}")
    (folder / "latin").mkdir()
    (folder / "latin/\udce9.png").touch()
    (folder / "loop").symlink_to("loop")
    (folder / "piped").mkdir()
    for name in ("pipe.py", "pipe.yaml", "pipe.onnx", "views.txt", "piped/scores.parquet"):
        os.mkfifo(folder / name)
    return folder


@pytest.mark.parametrize(("command", "status", "said"), CASES.values(), ids=CASES)
def test_a_fault_is_one_line_that_names_place_and_remedy(
    place: Path, command: str, status: int, said: str
):
    runs = run_bounded if re.search(r"pipe|/dev/|deep|views\.txt", command) else run_here
    done = runs(place, *shlex.split(command))
    assert done.returncode == status
    assert re.search(said, done.stderr), done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert len(done.errors) <= 2


ESCAPE = "a\x1b[2J\x1b]0;x\x07b.png"


def test_control_characters_of_names_are_written_out_in_every_line(tmp_path: Path):
    write_dive(tmp_path / "dive", ("a.png", "b.png", ESCAPE))
    (tmp_path / "dive" / "images" / ESCAPE).write_bytes(b"no picture")
    faults = {}
    for command in (
        RUN,
        "compare outputs --by view",
        "describe colmap dataset.root=dive --no-sheet",
        "score dive/images",
    ):
        done = run_here(tmp_path, *command.split())
        for text in (done.stdout, done.stderr):
            assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f]", text), command
        faults[command] = done.stdout + done.stderr
    assert r"a\x1b[2J\x1b]0;x" in faults[RUN]


def _hold(path: Path, held: multiprocessing.synchronize.Event) -> None:
    with FileLock(path):
        held.set()
        threading.Event().wait()


def test_who_waits_for_a_lock_says_so_and_goes_on_when_its_holder_is_gone(tmp_path: Path):
    context = forks()
    held, lines = context.Event(), Lines()
    holder = context.Process(target=_hold, args=(tmp_path / "lock", held), daemon=True)
    holder.start()
    assert held.wait(300)

    def kill_when_said() -> None:
        lines.has_one.wait(300)
        holder.kill()

    helper = threading.Thread(target=kill_when_said)
    helper.start()
    with progress.watched_by(lines), waited_lock(tmp_path / "lock"):
        pass
    helper.join()
    holder.join()
    assert str(tmp_path / "lock") in lines.lines[0]
    assert "wait for it" in lines.lines[0]


def test_a_port_in_use_is_said_and_the_remedy_works(place: Path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        done = run_here(place, "charts", "dive/images/a.png", "--no-browser", "--port", port)
    assert done.returncode == 2
    assert f"--port {port}: " in done.stderr
    assert re.search(r"\b0\b", done.stderr)
    assert len(done.errors) == 1


@contextlib.contextmanager
def serving(place: Path) -> Iterator[PageServer]:
    with contextlib.chdir(place):
        session = open_session(("dive/images/a.png",), "dgk", "colmap")
    with PageServer(session) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


REQUESTS = {
    "no address": b"GET http://[ HTTP/1.1\r\nHost: x\r\n\r\n",
    "no length": b"POST /%b/save HTTP/1.1\r\nHost: %h\r\nContent-Type: application/json\r\n\r\n",
    "a negative length": b"POST /%b/save HTTP/1.1\r\nHost: %h\r\nContent-Length: -1\r\n\r\n",
    "a length of 5,000 digits": b"POST /%b/save HTTP/1.1\r\nHost: %h\r\nContent-Length: "
    + b"9" * 5000
    + b"\r\n\r\n",
    "a length in other digits": "POST /%b/save HTTP/1.1\r\nHost: %h\r\nContent-Length: ²\r\n\r\n".encode(
        "latin-1"
    ),
}


def test_the_charts_server_refuses_what_is_no_request_of_its_page_and_goes_on(
    place: Path, capsys: pytest.CaptureFixture[str]
):
    with serving(place) as server:
        host = f"127.0.0.1:{server.server_port}".encode()
        for name, request in REQUESTS.items():
            with socket.create_connection(
                ("127.0.0.1", server.server_port), timeout=300
            ) as connection:
                connection.sendall(
                    request.replace(b"%b", server.token.encode()).replace(b"%h", host)
                )
                answer = connection.recv(1000)
            assert re.match(rb"HTTP/1.. 4\d\d ", answer), (name, answer)
        page = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=300)
        page.request("GET", urlsplit(server.url).path + "state")
        assert page.getresponse().status == 200
        page.close()
    assert "Traceback" not in capsys.readouterr().err
