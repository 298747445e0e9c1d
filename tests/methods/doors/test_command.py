"""Programs that restore: what they are given, what is taken from them, and all the ways in which they fail."""

from __future__ import annotations

import gc
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from onnx.helper import make_node
from support.made_networks import onnx_file
from support.places import ROOT

from sucre_bench import (
    Arrays,
    Camera,
    InputError,
    NotApplicableError,
    Restoration,
    Scene,
    View,
    load_scenes,
    plugins,
    restore,
)
from sucre_bench.engine.restore import measured_restore
from sucre_bench.imaging.encoding import srgb_encode
from sucre_bench.jobs import command as config
from sucre_bench.methods.doors import Command, command
from sucre_bench.methods.doors.process import Ended, run_program

LEVELS = np.arange(4 * 6 * 3, dtype=np.float32).reshape(4, 6, 3) * 3  # no two channels alike, so that a swap shows
RGB = LEVELS / np.float32(255)
DEPTH = np.float32([[0, 0.5, 1, 1.5, 1.75, 1.999]]).repeat(4, axis=0)
PYTHON = f"{sys.executable} -S"


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where temporary folders are made: a place whose name a shell would trip over."""
    folder = tmp_path / "temporary 'files' $(touch pwned)"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def scene_of(*names: str, rgb: np.ndarray = RGB, depth: np.ndarray | None = None, encoding: str = "gamma") -> Scene:
    camera = Camera(np.array([[6.0, 0, 3], [0, 6, 2], [0, 0, 1]]), 6, 4)
    views = [View(name, Arrays(rgb, depth), camera, encoding=encoding) for name in names]  # type: ignore[arg-type]
    return Scene("made", views, frozenset({"depth"} if depth is not None else ()))


def restored(run: str, scene: Scene | None = None, **options: object) -> Restoration:
    scene = scene or scene_of("a.png")
    return restore("command", scene, scene.views[0], run=run, **options)


def program(folder: Path, source: str) -> str:
    """The words that run a Python program of that source."""
    path = folder / "program.py"
    path.write_text(source)
    return f"{PYTHON} '{path}'"


def ends_soon(pid: int) -> bool:
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline:
        if not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
            return True
        time.sleep(0.02)
    return False


# -- what goes in and out ----------------------------------------------------------------------------------


def test_an_8_bit_image_passes_unchanged(temporary: Path):
    np.testing.assert_array_equal(restored("cp {input} {output}").image, RGB)
    assert not list(temporary.iterdir())
    assert not (temporary.parent / "pwned").exists()


def test_16_bits_are_16_bits():
    rgb = np.random.default_rng(0).random((4, 6, 3), dtype=np.float32)
    image = restored("cp {input} {output}", scene_of("a.png", rgb=rgb), bits=16).image
    assert 0 < np.abs(image - rgb).max() < 0.51 / 65535


def test_depth_comes_in_millimetres_or_metres():
    scene = scene_of("a.png", depth=DEPTH)
    image = restored("cp {depth} {output}", scene).image
    np.testing.assert_array_equal(np.rint(image[..., 0] * 65535), np.rint(DEPTH * 1000))
    for suffix in ("npy", "tif"):
        kind = {"depth_format": suffix, "output_suffix": f".{suffix}"}
        np.testing.assert_array_equal(restored("cp {depth} {output}", scene, **kind).image[..., 1], DEPTH)


def test_distance_is_from_the_cameras_centre():
    scene = scene_of("a.png", depth=DEPTH / 2)
    image = restored("cp {distance} {output}", scene, depth_format="npy", output_suffix=".npy").image
    right, below = 2.5 / 6, 1.5 / 6  # the last pixel's ray, from K
    assert image[3, 5, 0] == pytest.approx(DEPTH[3, 5] / 2 * np.sqrt(1 + right**2 + below**2))


def test_a_view_without_depth_is_skipped_only_by_a_command_that_asks_for_it():
    assert restored("cp {input} {output}").valid.all()
    for per in ("view", "scene"):
        with pytest.raises(NotApplicableError, match=r"a.png: has no depth map, which the command needs"):
            restored("cp {depth} {output}", per=per)


def test_a_depth_that_millimetres_cannot_say_is_an_error_and_metres_are_the_remedy():
    scene = scene_of("a.png", "b.png", depth=DEPTH * 40)
    for per in ("view", "scene"):
        with pytest.raises(InputError, match=r"a.png: depth up to 80.0 m does not fit .* method.depth_format=npy"):
            restored("cp {input} {depth} {output}", scene, per=per)


def test_a_program_is_given_the_encoding_it_asks_for_and_its_answer_is_taken_back():
    scene = scene_of("a.png", encoding="linear")
    seen = restored("cp {input} {output}", scene, encoding="gamma", bits=16).image
    np.testing.assert_allclose(seen, RGB, atol=1e-4)
    raw = restore("command", scene_of("a.png"), scene_of("a.png").views[0], run="cp {input} {output}", bits=16)
    linear = restored("cp {input} {output}", scene, bits=16).image
    np.testing.assert_array_equal(raw.image, linear)
    as_gamma = np.rint(srgb_encode(RGB) * 255) / 255  # 8 bits of encoded light, decoded again
    np.testing.assert_allclose(
        srgb_encode(restored("cp {input} {output}", scene, encoding="gamma").image), as_gamma, atol=1e-5
    )


def test_name_size_braces_and_environment_reach_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OF_THE_USER", "there")
    source = (
        "import json, os, shutil, sys\n"
        "shutil.copy(sys.argv[1], sys.argv[2])\n"
        "print(json.dumps([*sys.argv[3:], os.environ['OF_THE_USER'], sys.stdin.read(), os.getcwd()]))\n"
    )
    run = f"{program(tmp_path, source)} {{input}} {{output}} --size={{width}}x{{height}} '{{name}} {{{{}}}}' '$HOME;*'"
    said = json.loads(restored(run, scene_of("left/a b.png")).info["said"])
    assert said == ["--size=6x4", "left/a b.png {}", "$HOME;*", "there", "", str(Path.cwd())]


def test_a_program_may_choose_kind_and_name_of_its_output_and_tell_the_water(tmp_path: Path):
    source = (
        "import pathlib, shutil, sys\n"
        "out = pathlib.Path(sys.argv[2])\n"
        "shutil.copy(sys.argv[1], out.with_name(out.stem + '_restored.PNG'))\n"
        "out.with_name(out.stem + '_restored.json').write_text('{\"B\": [0.1, 0.2, 0.3]}')\n"
    )
    result = restored(f"{program(tmp_path, source)} {{input}} {{output}}", pattern="{stem}_restored")
    np.testing.assert_array_equal(result.image, RGB)
    assert result.water is not None
    np.testing.assert_array_equal(result.water.veiling_light, [0.1, 0.2, 0.3])


def test_its_time_and_memory_are_those_of_the_program_and_its_children(tmp_path: Path):
    ballast = np.ones(300 << 20, dtype=np.uint8)  # of this process: none of the program's
    child = "held = bytearray(150 << 20); import time; time.sleep(0.5)"
    source = (
        "import shutil, subprocess, sys\n"
        f"held = bytearray(50 << 20); subprocess.run([sys.executable, '-S', '-c', {child!r}])\n"
        "shutil.copy(sys.argv[1], sys.argv[2])\n"
    )
    info = restored(f"{program(tmp_path, source)} {{input}} {{output}}").info
    assert 200 < info["peak_mb"] < 200 + 60
    assert 0.5 < info["seconds"] < 5
    assert ballast[0] == 1


# -- all the views of a scene at once ----------------------------------------------------------------------


BATCH = """
import pathlib, shutil, sys
given, wanted = map(pathlib.Path, sys.argv[1:3])
files = sorted(p.relative_to(given).as_posix() for p in given.rglob("*") if p.is_file())
with open(sys.argv[3], "a") as log:
    log.write(" ".join(files) + chr(10))
for file in files:
    if "missing" not in file:
        shutil.copy(given / file, wanted / file)
print("did", len(files))
sys.exit(int(sys.argv[4]) if len(sys.argv) > 4 else 0)
"""


def test_a_batch_is_one_process_for_all_views_of_a_scene(
    tmp_path: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
):
    runs: list[Ended] = []
    monkeypatch.setattr(command, "run_program", lambda *given: runs.append(run_program(*given)) or runs[-1])
    names = ["left/a.jpg", "right/a.png", "b.png", "b.jpg", "missing.png"]
    views = [View(name, Arrays(RGB / (k + 1))) for k, name in enumerate(names)]
    scene = Scene("made", views, frozenset())
    run = f"{program(tmp_path, BATCH)} {{input}} {{output}} '{tmp_path / 'log'}'"
    results = [restore("command", scene, view, run=run, per="scene", bits=16) for view in views[:4]]
    for k, result in enumerate(results):
        np.testing.assert_allclose(result.image, RGB / (k + 1), atol=1e-5)
    with pytest.raises(InputError, match=r"missing.png: ended well, but wrote no image"):
        restore("command", scene, views[4], run=run, per="scene", bits=16)
    assert (tmp_path / "log").read_text() == "b.jpg.png b.png.png left/a.png missing.png right/a.png\n"
    assert [result.info["seconds"] for result in results] == [runs[0].seconds / 5] * 4
    assert results[0].info["said"] == "did 5"
    (kept,) = temporary.iterdir()
    assert [folder.name for folder in kept.iterdir()] == ["output"]
    for name in ("c.png", "d.png"):  # two more batches need the room
        other = scene_of(name)
        restore("command", other, other.views[0], run=run, per="scene")
    gc.collect()
    assert not kept.exists()


def test_a_batch_that_fails_gives_what_it_wrote_and_the_reason_for_what_it_did_not(tmp_path: Path):
    scene = scene_of("a.png", "missing.png")
    options = {"run": f"{program(tmp_path, BATCH)} {{input}} {{output}} '{tmp_path / 'log'}' 3", "per": "scene"}
    result = restore("command", scene, scene.views[0], **options)
    np.testing.assert_array_equal(result.image, RGB)
    assert result.info["fault"] == "ended with exit code 3, saying: did 2"
    with pytest.raises(InputError, match=r"missing.png: ended with exit code 3, saying: did 2, but wrote no image"):
        restore("command", scene, scene.views[1], **options)
    assert (tmp_path / "log").read_text().count("\n") == 1


def test_views_that_lack_what_a_batch_needs_do_not_keep_the_others(tmp_path: Path):
    with_depth = scene_of("a.png", depth=DEPTH).views[0]
    scene = Scene("made", [with_depth, scene_of("b.png").views[0], scene_of("far.png", depth=DEPTH * 40).views[0]],
                  frozenset({"depth"}))  # fmt: skip
    run = f"{program(tmp_path, BATCH)} {{input}} {{output}} '{tmp_path / 'log'}' 0 {{depth}}"
    np.testing.assert_array_equal(restore("command", scene, with_depth, run=run, per="scene").image, RGB)
    with pytest.raises(NotApplicableError, match=r"b.png: has no depth map"):
        restore("command", scene, scene.views[1], run=run, per="scene")
    with pytest.raises(InputError, match=r"far.png: depth up to 80.0 m"):
        restore("command", scene, scene.views[2], run=run, per="scene")
    assert (tmp_path / "log").read_text() == "a.png far.png\n"


# -- how programs fail -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("import sys; print('so far so good'); sys.exit(3)", "ended with exit code 3, saying: so far so good; mend"),
        ("print('x'); raise ValueError('no net')", "ended with exit code 1, saying: ValueError: no net; mend"),
        ("import os; os.kill(os.getpid(), 9)", "was killed by SIGKILL, for want of memory perhaps"),
        ("import os; os.abort()", "was killed by SIGABRT"),
        ("pass", "ended well, but wrote no image; the program is to write to {output}"),
        ("import sys; open(sys.argv[2], 'w').write('no image')", "output/view.png: cannot be read, damaged"),
        ("import sys; open(sys.argv[2], 'wb').write(open(sys.argv[1], 'rb').read()[:60])", "cannot be read, cut short"),
    ],
)
def test_a_program_that_fails_is_one_line_that_says_how(tmp_path: Path, temporary: Path, source: str, said: str):
    with pytest.raises(InputError) as fault:
        restored(f"{program(tmp_path, source)} {{input}} {{output}}", scene_of("dive/a.png"))
    message = str(fault.value)
    assert said in message
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
    with pytest.raises(InputError, match=r"cp: a.png: output/view.npy: is 3x2, the view is 6x4; .*method.resize=true"):
        restored(f"cp '{other}' {{output}}", output_suffix=".npy")
    assert restored(f"cp '{other}' {{output}}", output_suffix=".npy", resize=True).info["resized_from"] == [3, 2]


@pytest.mark.parametrize("stubborn", ["", "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"])
def test_a_program_that_hangs_is_stopped_with_all_its_children(tmp_path: Path, stubborn: str):
    source = (
        f"{stubborn}import os, subprocess, sys, time\n"
        "child = subprocess.Popen([sys.executable, '-S', '-c', 'import time; time.sleep(60)'])\n"
        f"open({str(tmp_path / 'pids')!r}, 'w').write(f'{{child.pid}} {{os.getpid()}}')\n"
        "time.sleep(60)\n"
    )
    started = time.monotonic()
    with pytest.raises(InputError, match=r"was stopped after 0.5 s; mend"):
        restored(f"{program(tmp_path, source)} {{output}}", timeout=0.5)
    assert time.monotonic() - started < 8
    for pid in (tmp_path / "pids").read_text().split():
        assert ends_soon(int(pid))


def test_children_that_outlive_their_program_are_ended_and_do_not_keep_us(tmp_path: Path):
    source = (
        "import shutil, subprocess, sys\n"
        "child = subprocess.Popen([sys.executable, '-S', '-c', 'import time; time.sleep(60)'])\n"
        "print(child.pid); shutil.copy(sys.argv[1], sys.argv[2])\n"
    )
    started = time.monotonic()
    result = restored(f"{program(tmp_path, source)} {{input}} {{output}}")
    assert time.monotonic() - started < 3  # which only those are given that have not ended
    assert ends_soon(int(result.info["said"]))


CLEANING_UP = """
import pathlib, signal, sys, time
def clean(*_):
    time.sleep(0.5)
    pathlib.Path(sys.argv[1]).write_text("clean")
    sys.exit()
signal.signal(signal.SIGTERM, clean)
pathlib.Path(sys.argv[2]).touch()
time.sleep(60)
"""


@pytest.mark.parametrize("way", ["the program ends well", "the program is too late", "its parent is a shell"])
def test_children_have_time_to_clean_up_though_their_program_has_none(tmp_path: Path, way: str):
    """As the client of a container has to: the program itself ends at once when told to, or has ended before."""
    (tmp_path / "child.py").write_text(CLEANING_UP)
    child = [sys.executable, "-S", str(tmp_path / "child.py"), str(tmp_path / "clean"), str(tmp_path / "ready")]
    wait = f"while not os.path.exists({child[-1]!r}): time.sleep(0.01)\n"
    start = f"import os, subprocess, time\nsubprocess.Popen({child!r})\n{wait}"
    run = {
        "the program ends well": [sys.executable, "-S", "-c", start],
        "the program is too late": [sys.executable, "-S", "-c", f"{start}time.sleep(60)"],
        "its parent is a shell": ["sh", "-c", f"{shlex.join(child)}; true"],
    }[way]
    started = time.monotonic()
    ended = run_program(run, timeout=1.0)
    assert (tmp_path / "clean").read_text() == "clean"
    assert bool(ended.fault) == (way != "the program ends well")
    assert time.monotonic() - started < 1 + 3 + 1


def test_a_child_that_will_not_end_is_killed_after_its_time_to_clean_up(tmp_path: Path):
    child = (
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('deaf', flush=True); time.sleep(60)"
    )
    source = (
        "import subprocess, sys\n"
        f"child = subprocess.Popen([sys.executable, '-S', '-c', {child!r}], stdout=subprocess.PIPE)\n"
        "child.stdout.readline(); print(child.pid)\n"
    )
    ended = run_program([sys.executable, "-S", "-c", source])
    assert ended.seconds < 2  # its own, without what it left behind
    assert ends_soon(int(ended.said))


def test_a_daemon_that_holds_the_pipes_open_does_not_keep_us(tmp_path: Path):
    source = (
        "import shutil, subprocess, sys\n"
        "sleep = [sys.executable, '-S', '-c', 'import time; time.sleep(20)']\n"
        "print(subprocess.Popen(sleep, start_new_session=True).pid); shutil.copy(sys.argv[1], sys.argv[2])\n"
    )
    started = time.monotonic()
    result = restored(f"{program(tmp_path, source)} {{input}} {{output}}")
    os.kill(int(result.info["said"]), signal.SIGKILL)
    assert time.monotonic() - started < 10


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_a_flood_of_output_neither_blocks_nor_fills_the_memory(tmp_path: Path, stream: str):
    source = f"import sys\nfor _ in range(60): sys.{stream}.write('x' * (1 << 20))\nsys.{stream}.write('\\nlast')\n"
    before = psutil.Process().memory_info().rss
    ended = run_program([sys.executable, "-S", "-c", source], timeout=30)
    assert not ended.fault
    assert ended.last_words == "last"
    assert len(ended.said) <= 1 << 15
    assert psutil.Process().memory_info().rss - before < 30 << 20


def test_output_that_is_no_text_does_no_harm():
    source = "import os, sys; os.write(2, b'\\xff\\x1b[31mred\\x1b[0m\\x00'); sys.exit(1)"
    ended = run_program([sys.executable, "-S", "-c", source])
    assert "red" in ended.last_words
    assert ended.last_words.isprintable()


def test_ctrl_c_ends_the_program_too(tmp_path: Path):
    pid_file = tmp_path / "pid"
    child = f"import os, time; open({str(pid_file)!r}, 'w').write(str(os.getpid())); time.sleep(60)"
    ours = f"from sucre_bench.methods.doors.process import run_program as r; r([{sys.executable!r}, '-c', {child!r}])"
    with subprocess.Popen([sys.executable, "-c", ours], stderr=subprocess.PIPE) as bench_process:
        deadline = time.monotonic() + 20
        while not (pid_file.exists() and pid_file.read_text()) and time.monotonic() < deadline:
            time.sleep(0.02)
        bench_process.send_signal(signal.SIGINT)
        _, said = bench_process.communicate(timeout=20)
    assert b"KeyboardInterrupt" in said
    assert ends_soon(int(pid_file.read_text()))


# -- commands that cannot work -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"run": ""}, "command.run: is empty"),
        ({"run": "no_such_program {output}"}, "'no_such_program' is not found or not executable"),
        ({"run": "/etc/passwd {output}"}, "'/etc/passwd' is not found or not executable"),
        ({"run": "cp 'a {output}"}, "command.run: No closing quotation"),
        ({"run": "cp {imput} {output}"}, "no placeholder '{imput}'; did you mean 'input'"),
        ({"run": "cp {} {output}"}, "no placeholder"),
        ({"run": "cp {input:02d} {output}"}, "'{input:02d}': no format or conversion is allowed; write {input}"),
        ({"run": "cp { {output}"}, "for braces"),
        ({"run": "cp {input} there"}, "without {output}"),
        ({"run": "cp {name} {output}", "per": "scene"}, "{name} is of one view; use it with per=view"),
        ({"run": "cp {output}", "pattern": "out"}, "command.pattern: 'out' is the same for every view"),
        ({"run": "cp {output}", "output_suffix": "png"}, "command.output_suffix: 'png' is not one of .png, "),
        ({"run": "cp {output}", "bits": 12}, "command.bits: 12"),
        ({"run": "cp {output}", "timeout": 0.0}, "command.timeout: 0.0 must be positive"),
        ({"run": "cp {output}", "rests_on": Path("nowhere")}, "nowhere: no such file or folder"),
    ],
)
def test_a_command_that_cannot_work_is_refused_at_once(options: dict, said: str):
    with pytest.raises(InputError) as fault:
        Command(**options)
    assert said in str(fault.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [("#!/no/such/interpreter\n", "or what runs it is not"), ("no first line\n", "cannot be started, Exec format")],
)
def test_a_script_that_nothing_runs_is_named(tmp_path: Path, content: str, said: str):
    script = tmp_path / "restore"
    script.write_text(content)
    script.chmod(0o755)
    with pytest.raises(InputError, match=f"restore: .*{said}"):
        restored(f"'{script}' {{output}}")


def test_a_view_whose_name_leads_out_of_the_folder_is_refused_in_a_batch():
    with pytest.raises(InputError, match=r"\.\./a.png: is no path inside a folder"):
        restored("cp -r {input} {output}", scene_of("../a.png"), per="scene")


# -- from the command line ---------------------------------------------------------------------------------


def test_the_command_line_takes_a_command_in_two_kinds_of_quotes(bench, toys: str, tmp_path: Path):
    (tmp_path / "restore.py").write_text("import shutil, sys\nshutil.copy(sys.argv[1], sys.argv[2])\n")
    run = ("run", "--plugin", toys, "dataset=toy", "metrics=[redness]", "tracking.uri=off", "report=false", "out=out")
    chosen = ("method=command", f"method.run='{PYTHON} restore.py {{input}} {{output}}'", "method.rests_on=restore.py")
    done = bench(*run, *chosen)
    assert done.returncode == 0, done.stderr
    import pandas as pd

    rows = pd.read_parquet(tmp_path / "out" / "scores.parquet")
    assert rows["status"].eq("ok").all()
    pictures = [tmp_path / "out/restored/toy/command" / f"v{k}.png" for k in range(3)]
    made = [picture.stat().st_mtime_ns for picture in pictures]
    assert bench(*run, *chosen).returncode == 0
    assert [picture.stat().st_mtime_ns for picture in pictures] == made
    (tmp_path / "restore.py").write_text("import sys\nsys.exit('the net is torn')\n")
    done = bench(*run, *chosen)
    assert done.returncode == 1
    assert "ended with exit code 1, saying: the net is torn" in done.stderr


def test_a_mistyped_program_stops_a_run_before_it_starts(bench, toys: str):
    done = bench("run", "--plugin", toys, "dataset=toy", "method=command", "method.run='no_such {input} {output}'")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "command.run: 'no_such' is not found" in done.stderr


# -- what the documentation shows --------------------------------------------------------------------------


DOORS = ROOT / "docs" / "doors.md"

# Programs that the documentation runs: each copies its input to its output, the way it was told to.
STAND_INS = {
    "matlab": "import re, shutil, sys\n"
    "shutil.copy(*re.fullmatch(r\"restore\\('(.*)', '(.*)'\\)\", sys.argv[2]).groups())",
    "docker": "import shutil, sys\nfirst, second = [a.split(':')[0] for a in sys.argv if ':/' in a]\n"
    "assert sys.argv[-2:] == ['/in', '/out']\nshutil.copytree(first, second, dirs_exist_ok=True)",
    "conda": "import os, sys\nos.execvp(sys.executable, [sys.executable, *sys.argv[sys.argv.index('python') + 1:]])",
    "envs/theirs/bin/python": "import os, sys\nos.execv(sys.executable, [sys.executable, *sys.argv[1:]])",
    "envs/deepseecolor/bin/python": "import os, sys\nos.execv(sys.executable, [sys.executable, *sys.argv[1:]])",
    # What its README and --help say: depth maps paired with images by order, results called NAME-corrected.png.
    "DeepSeeColor/deepseecolor.py": "import argparse, os, shutil\n"
    "import cv2\n"
    "parser = argparse.ArgumentParser()\n"
    "for name in ('images', 'depth', 'output'): parser.add_argument('--' + name, required=True)\n"
    "for name in ('height', 'width', 'seed'): parser.add_argument('--' + name, type=int)\n"
    "parser.add_argument('--depth_16u', action='store_true')\n"
    "given = parser.parse_args()\n"
    "images, maps = sorted(os.listdir(given.images)), sorted(os.listdir(given.depth))\n"
    "assert len(images) == len(maps) and given.depth_16u\n"
    "for image, depth in zip(images, maps):\n"
    "    millimetres = cv2.imread(os.path.join(given.depth, depth), cv2.IMREAD_UNCHANGED)\n"
    "    assert millimetres.dtype == 'uint16' and (millimetres == 2000).all()\n"
    "    target = image.rstrip('.png') + '-corrected.png'\n"
    "    shutil.copy(os.path.join(given.images, image), os.path.join(given.output, target))",
    "restore.py": "import shutil, sys\nassert sys.argv[1::2] == ['--in', '--out']\nshutil.copy(*sys.argv[2::2])",
}


def blocks(language: str) -> list[str]:
    found = re.findall(rf"```{language}\n(.*?)```", DOORS.read_text(encoding="utf-8"), re.DOTALL)
    return [block.replace("\\\n", "") for block in found]


@pytest.mark.skipif(not DOORS.is_file(), reason="the documentation is not beside the tests")
def test_the_examples_of_the_documentation_restore(tmp_path: Path, toys: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    for name, source in STAND_INS.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"#!{sys.executable}\n{source}\n")
        (tmp_path / name).chmod(0o755)
    (script,) = [block for block in blocks("sh") if block.startswith("#!/bin/sh")]
    (tmp_path / "restore.sh").write_text(script)
    (tmp_path / "restore.sh").chmod(0o755)
    (plugin,) = [block for block in blocks("python") if "class KnownWater" in block]
    (tmp_path / "known_water.py").write_text(plugin)
    plugins.load_file(tmp_path / "known_water.py")
    onnx_file(tmp_path / "physicalnn.onnx", [make_node("Identity", ["x"], ["y"])])
    (scene,) = load_scenes("toy")
    for folder in ("renders/train/rgb_clear_clamp", "model/train/render", "named"):
        (tmp_path / folder).mkdir(parents=True)
        for view in scene:
            np.save(tmp_path / folder / view.name.replace(".png", ".npy"), view.rgb)

    lines = [line for block in blocks("sh") for line in block.splitlines() if line.startswith("sucre-bench run")]
    assert len(lines) == 11
    for line in lines:
        words = [w for w in shlex.split(line)[2:] if w not in ("--plugin", "known_water.py")]
        overrides = [w for w in words if not w.startswith("dataset")]
        (job,) = config.jobs(["dataset=toy", "metrics=[redness]", *overrides], False).jobs
        image = measured_restore(job.method.make(), scene, scene.views[1]).restoration.image
        water = np.exp([0.5 * 2, 0.1 * 2, 0.08 * 2]) if "known_water" in line else 1
        np.testing.assert_allclose(image, scene.views[1].rgb * water, atol=0.51 / 255, err_msg=line)
