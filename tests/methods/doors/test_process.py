"""How programs that restore fail, and how they and their children are ended."""

import contextlib
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from support.messages import names
from support.restoring_programs import RGB, program, restored, scene_of

from sucre_bench import InputError
from sucre_bench.methods.doors.process import run_program

# Seconds that a program is given to get as far as its test needs; the next where a busy machine needs more.
LIMITS_S = (0.5, 5, 50)


def is_at_work(pid: int) -> bool:
    with contextlib.suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False


def ends_soon(pid: int) -> bool:
    deadline = time.monotonic() + 300
    while is_at_work(pid):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.parametrize(
    ("source", "named"),
    [
        ("import sys; print('almost'); sys.exit(3)", {"exit", "3", "almost"}),
        ("print('x'); raise ValueError('no net')", {"exit", "1", "ValueError", "net"}),
        ("import os; os.kill(os.getpid(), 9)", {"SIGKILL", "memory"}),
        ("import os; os.abort()", {"SIGABRT"}),
        ("pass", {"image", "{output}"}),
        (
            "import sys; open(sys.argv[2], 'w').write('no image')",
            {"output/view.png", "damaged"},
        ),
        (
            "import sys; open(sys.argv[2], 'wb').write(open(sys.argv[1], 'rb').read()[:60])",
            {"output/view.png", "cut"},
        ),
    ],
)
def test_a_program_that_fails_is_one_line_that_says_how(
    tmp_path: Path, temporary: Path, source: str, named: set[str]
):
    with pytest.raises(InputError) as fault:
        restored(f"{program(tmp_path, source)} {{input}} {{output}}", scene_of("dive/a.png"))
    message = str(fault.value)
    assert named <= names(message)
    assert message.startswith(f"{Path(sys.executable).name}: dive/a.png: ")
    assert str(temporary) not in message
    assert "\n" not in message
    assert not list(temporary.iterdir())


def test_all_that_a_failing_program_printed_is_kept_with_the_traceback(tmp_path: Path):
    source = "import sys; print('first line'); print('on stderr', file=sys.stderr); sys.exit(1)"
    with pytest.raises(InputError) as fault:
        restored(f"{program(tmp_path, source)} {{output}}")
    assert str(fault.value.__cause__) == "first line\non stderr"


def test_an_output_of_another_size_is_told_with_the_programs_name(tmp_path: Path):
    other = tmp_path / "other.npy"
    np.save(other, RGB[:2, :3])
    with pytest.raises(
        InputError, match=r"cp: a\.png: output/view\.npy: .*3x2, .*6x4; .*method\.resize=true"
    ):
        restored(f"cp '{other}' {{output}}", output_suffix=".npy")
    assert restored(f"cp '{other}' {{output}}", output_suffix=".npy", resize=True).info[
        "resized_from"
    ] == [3, 2]


def test_a_program_that_hangs_is_stopped_with_all_its_children(tmp_path: Path):
    source = (
        "import os, signal, subprocess, sys, time; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "child = subprocess.Popen([sys.executable, '-S', '-c', 'import time; time.sleep(3600)'])\n"
        f"open({str(tmp_path / 'new')!r}, 'w').write(f'{{child.pid}} {{os.getpid()}}')\n"
        f"os.rename({str(tmp_path / 'new')!r}, {str(tmp_path / 'pids')!r})\n"
        "time.sleep(3600)\n"
    )
    for limit_s in LIMITS_S:
        with pytest.raises(InputError, match=rf"\b{limit_s:g} s; "):
            restored(f"{program(tmp_path, source)} {{output}}", timeout=limit_s)
        if (tmp_path / "pids").exists():
            break
    for pid in (tmp_path / "pids").read_text().split():
        assert ends_soon(int(pid))


CLEANING_UP = """
import pathlib, signal, sys, time
def clean(*_):
    time.sleep(0.2)
    pathlib.Path(sys.argv[1]).write_text("clean")
    sys.exit()
signal.signal(signal.SIGTERM, clean)
pathlib.Path(sys.argv[2]).touch()
time.sleep(3600)
"""


@pytest.mark.parametrize(
    "way", ["the program ends well", "the program is too late", "its parent is a shell"]
)
def test_children_have_time_to_clean_up_though_their_program_has_none(tmp_path: Path, way: str):
    """As the client of a container has to: the program itself ends at once when told to, or has ended before."""
    (tmp_path / "child.py").write_text(CLEANING_UP)
    child = [
        sys.executable,
        "-S",
        str(tmp_path / "child.py"),
        str(tmp_path / "clean"),
        str(tmp_path / "ready"),
    ]
    wait = f"while not os.path.exists({child[-1]!r}): time.sleep(0.01)\n"
    start = f"import os, subprocess, time\nsubprocess.Popen({child!r})\n{wait}"
    run = {
        "the program ends well": [sys.executable, "-S", "-c", start],
        "the program is too late": [sys.executable, "-S", "-c", f"{start}time.sleep(3600)"],
        "its parent is a shell": ["sh", "-c", f"{shlex.join(child)}; true"],
    }[way]
    for limit_s in LIMITS_S:
        (tmp_path / "ready").unlink(missing_ok=True)
        ended = run_program(run, timeout=None if way == "the program ends well" else limit_s)
        if (tmp_path / "clean").exists():
            break
    assert (tmp_path / "clean").read_text() == "clean"
    assert bool(ended.fault) == (way != "the program ends well")


def test_a_daemon_that_holds_the_pipes_open_does_not_keep_us(tmp_path: Path):
    source = (
        "import shutil, subprocess, sys\n"
        "sleep = [sys.executable, '-S', '-c', 'import time; time.sleep(3600)']\n"
        "print(subprocess.Popen(sleep, start_new_session=True).pid); shutil.copy(sys.argv[1], sys.argv[2])\n"
    )
    daemon = int(restored(f"{program(tmp_path, source)} {{input}} {{output}}").info["said"])
    assert is_at_work(daemon)
    os.kill(daemon, signal.SIGKILL)


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_flood_of_output_neither_blocks_nor_fills_the_memory(tmp_path: Path, stream: str):
    source = f"import sys\nfor _ in range(60): sys.{stream}.write('x' * (1 << 20))\nsys.{stream}.write('\\nlast')\n"
    before = psutil.Process().memory_info().rss
    ended = run_program([sys.executable, "-S", "-c", source], timeout=600)
    assert not ended.fault
    assert ended.last_words == "last"
    assert len(ended.said) <= 1 << 15
    assert psutil.Process().memory_info().rss - before < 30 << 20


def test_ctrl_c_ends_the_program_too(tmp_path: Path):
    pid_file = tmp_path / "pid"
    child = f"import os, time; open({str(pid_file)!r}, 'w').write(str(os.getpid())); time.sleep(3600)"
    ours = f"from sucre_bench.methods.doors.process import run_program as r; r([{sys.executable!r}, '-c', {child!r}])"
    with subprocess.Popen(
        [sys.executable, "-c", ours], stderr=subprocess.PIPE
    ) as bench_process:
        deadline = time.monotonic() + 300
        while not (pid_file.exists() and pid_file.read_text()) and time.monotonic() < deadline:
            time.sleep(0.02)
        bench_process.send_signal(signal.SIGINT)
        _, said = bench_process.communicate(timeout=300)
    assert b"KeyboardInterrupt" in said
    assert ends_soon(int(pid_file.read_text()))
