"""A table of faults: each command ends with its exit code, and names the place and the remedy in few lines."""

import multiprocessing.synchronize
import os
import re
import shlex
import socket
import threading
from pathlib import Path

import pytest
from filelock import FileLock
from support.colmap_folder import write_dive
from support.command_line import forks, run_bounded, run_here
from support.messages import Lines

from sucre_bench.machine import progress
from sucre_bench.machine.cache import waited_lock

LONG = "x" * 300
RUN = "run dataset=colmap dataset.root=dive method=gray_world metrics=[coverage] tracking.uri=off report=false"

RUN_SUCRE = RUN.replace("=gray_world", "=sucre")
RUN_COMMAND = RUN.replace("=gray_world", "=command \"method.run='cp {input} {output}'\"")

# A command that ends with exit code 2, and a pattern of what it says on stderr.
CASES: dict[str, tuple[str, str]] = {
    "no results folder's name": (f"{RUN} out=", r"^error: out: .*empty; "),
    "no time for a view": (f"{RUN} view_timeout_s=0", r"view_timeout_s"),
    "a file as results folder": (f"{RUN} out=dive/images/a.png", r"a\.png: .*file; "),
    "a water that is not there": (
        f"{RUN_SUCRE} method.water=none.json",
        r"none\.json: .*; .*method\.water",
    ),
    "a pipe as water": (f"{RUN_SUCRE} method.water=pipe.yaml", r"pipe\.yaml: .*pipe; "),
    "no water in a file": (
        f"{RUN_SUCRE} method.water=empty.json",
        r"empty\.json: .*\bB\b.*; ",
    ),
    "no water in a folder": (
        f"{RUN_SUCRE} method.water=dive/images",
        r"dive/images: holds no \.json.*; ",
    ),
    "a pipe as network": (
        "run dataset=colmap dataset.root=dive method=onnx method.model=pipe.onnx",
        r"pipe\.onnx: .*pipe; .*method\.model",
    ),
    "a pipe as what a command rests on": (
        f"{RUN_COMMAND} method.rests_on=pipe.py",
        r"pipe\.py: .*pipe; .*method\.rests_on",
    ),
    "a pipe as list of views": (f"{RUN} views=views.txt", r"views\.txt: .*pipe; "),
    "a pipe as reference": ("score dive/images --reference pipe.py", r"pipe\.py: .*pipe; "),
    "a pipe as score table": (f"{RUN} out=piped", r"piped/scores\.parquet: .*pipe; "),
    "a device as bundle": ("verify /dev/zero", r"/dev/zero: .*; "),
    "a device as results": ("compare /dev/zero", r"/dev/zero: .*; "),
    "a variable that is not set": ("prepare '' out", r"PHOTOS.*: is empty; "),
    "an empty root to run": (f"{RUN} dataset.root=", r"^error: dataset\.root: is empty; "),
    "an empty plugin to run": (f"{RUN} --plugin ''", r"--plugin.*: is empty; "),
    "a seed of 77 bits": (f"{RUN} seed=99999999999999999999999", r"seed: is 9+; .*below"),
    "a list as label": (f"{RUN} method.label=[1]", r"method\.label: .*\[1\]; .*text"),
    "a reference to nothing": (f"{RUN} baseline='${{nope}}'", r"baseline: .*'nope'.*; "),
    "an image whose name is no UTF-8": (
        "score latin",
        r"^error: latin/\\udce9\.png: .*UTF-8; rename",
    ),
    "a folder whose name is no UTF-8": (
        "compare '\udce9'",
        r"^error: \\udce9: .*UTF-8; rename",
    ),
    "a method twice in an experiment": (
        "run twice.yaml",
        r"two jobs .* are the same, .*clahe",
    ),
    "a pixel at infinity": (
        "prepare dive/images out --length a.png inf 1 2 2 1",
        r"--length: inf; ",
    ),
    "a link to itself": ("restore loop out", r"/loop: links to itself; "),
    "a name of six lines": (
        "compare 'a\r\v\f\x85\u2028b'",
        r"^error: a\\r\\x0b\\x0c\\x85\\u2028b: .*; .*\n$",
    ),
    "a pipe as plugin": ("run --plugin pipe.py method=x", r"pipe\.py: .*; "),
    "a deep experiment": ("run deep.yaml", r"deep\.yaml: .*YAML.*depth.*; "),
    "a long path to run": (
        f"run dataset=colmap dataset.root={LONG} method=gray_world",
        LONG,
    ),
    "a long results folder": (f"{RUN} out={LONG}", rf"{LONG}.*; "),
    "a long path to score": (f"score {LONG}", rf"{LONG}.*; "),
    "a long name of a new plugin": (f"new method {LONG}", LONG),
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


@pytest.mark.parametrize(("command", "said"), CASES.values(), ids=CASES)
def test_a_fault_is_one_line_that_names_place_and_remedy(place: Path, command: str, said: str):
    runs = run_bounded if re.search(r"pipe|/dev/|deep|views\.txt", command) else run_here
    done = runs(place, *shlex.split(command))
    assert done.returncode == 2
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
