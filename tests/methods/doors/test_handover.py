"""What programs that restore are given, and what is taken from them."""

import gc
import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
from support.restoring_programs import DEPTH, RGB, program, restored, scene_of

from sucre_bench import Arrays, InputError, NotApplicableError, Scene, View, restore
from sucre_bench.imaging.encoding import srgb_encode
from sucre_bench.methods.doors import command
from sucre_bench.methods.doors.process import Ended, run_program

# -- what goes in and out --------------------------------------------------------------------------------


def test_depth_comes_in_millimetres_or_metres():
    scene = scene_of("a.png", depth=DEPTH)
    image = restored("cp {depth} {output}", scene).image
    np.testing.assert_array_equal(np.rint(image[..., 0] * 65535), np.rint(DEPTH * 1000))
    for suffix in ("npy", "tif"):
        kind = {"depth_format": suffix, "output_suffix": f".{suffix}"}
        np.testing.assert_array_equal(
            restored("cp {depth} {output}", scene, **kind).image[..., 1], DEPTH
        )


def test_distance_is_from_the_cameras_centre():
    scene = scene_of("a.png", depth=DEPTH / 2)
    image = restored(
        "cp {distance} {output}", scene, depth_format="npy", output_suffix=".npy"
    ).image
    # the last pixel's ray, from K
    right = 2.5 / 6
    below = 1.5 / 6
    assert image[3, 5, 0] == pytest.approx(DEPTH[3, 5] / 2 * np.sqrt(1 + right**2 + below**2))


def test_a_view_without_depth_is_skipped_only_by_a_command_that_asks_for_it():
    assert restored("cp {input} {output}").valid.all()
    with pytest.raises(NotApplicableError, match=r"a\.png: .*depth"):
        restored("cp {depth} {output}")


def test_a_depth_that_millimetres_cannot_say_is_an_error_and_metres_are_the_remedy():
    scene = scene_of("a.png", "b.png", depth=DEPTH * 40)
    with pytest.raises(InputError, match=r"a\.png: .*80\.0 m .* method\.depth_format=npy"):
        restored("cp {input} {depth} {output}", scene)


def test_a_program_is_given_the_encoding_it_asks_for_and_its_answer_is_taken_back():
    scene = scene_of("a.png", encoding="linear")
    seen = restored("cp {input} {output}", scene, encoding="gamma", bits=16).image
    np.testing.assert_allclose(seen, RGB, atol=1e-4)
    stored = scene_of("a.png")
    raw = restore("command", stored, stored.views[0], run="cp {input} {output}", bits=16)
    linear = restored("cp {input} {output}", scene, bits=16).image
    np.testing.assert_array_equal(raw.image, linear)
    as_gamma = np.rint(srgb_encode(RGB) * 255) / 255  # 8 bits of encoded light, decoded again
    np.testing.assert_allclose(
        srgb_encode(restored("cp {input} {output}", scene, encoding="gamma").image),
        as_gamma,
        atol=1e-5,
    )


def test_name_size_braces_and_environment_reach_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
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
    result = restored(
        f"{program(tmp_path, source)} {{input}} {{output}}", pattern="{stem}_restored"
    )
    np.testing.assert_array_equal(result.image, RGB)
    np.testing.assert_array_equal(result.water.veiling_light, [0.1, 0.2, 0.3])


def test_its_time_and_memory_are_those_of_the_program_and_its_children(tmp_path: Path):
    ballast = np.ones(300 << 20, dtype=np.uint8)  # of this process: none of the program's
    for held_s in (0.5, 5, 50):  # its memory is sampled; a busy machine may be late
        child = f"held = bytearray(150 << 20); import time; time.sleep({held_s})"
        source = (
            "import shutil, subprocess, sys\n"
            f"held = bytearray(50 << 20); subprocess.run([sys.executable, '-S', '-c', {child!r}])\n"
            "shutil.copy(sys.argv[1], sys.argv[2])\n"
        )
        started = time.perf_counter()
        info = restored(f"{program(tmp_path, source)} {{input}} {{output}}").info
        assert held_s < info["seconds"] < time.perf_counter() - started
        if info["peak_mb"] > 200:
            break
    assert 200 < info["peak_mb"] < 200 + 60
    assert ballast[0] == 1


# -- all the views of a scene at once --------------------------------------------------------------------


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
    monkeypatch.setattr(
        command, "run_program", lambda *given: runs.append(run_program(*given)) or runs[-1]
    )
    names = ["left/a.jpg", "right/a.png", "b.png", "b.jpg", "missing.png"]
    views = [View(name, Arrays(RGB / (k + 1))) for k, name in enumerate(names)]
    scene = Scene("made", views, frozenset())
    run = f"{program(tmp_path, BATCH)} {{input}} {{output}} '{tmp_path / 'log'}'"
    results = [
        restore("command", scene, view, run=run, per="scene", bits=16) for view in views[:4]
    ]
    for k, result in enumerate(results):
        np.testing.assert_allclose(result.image, RGB / (k + 1), atol=1e-5)
    with pytest.raises(InputError, match=r"missing\.png: (?!.*exit code)"):
        restore("command", scene, views[4], run=run, per="scene", bits=16)
    assert (
        tmp_path / "log"
    ).read_text() == "b.jpg.png b.png.png left/a.png missing.png right/a.png\n"
    assert [result.info["seconds"] for result in results] == [runs[0].seconds / 5] * 4
    assert results[0].info["said"] == "did 5"
    (kept,) = temporary.iterdir()
    assert [folder.name for folder in kept.iterdir()] == ["output"]
    for name in ("c.png", "d.png"):  # two more batches need the room
        other = scene_of(name)
        restore("command", other, other.views[0], run=run, per="scene")
    gc.collect()
    assert not kept.exists()


def test_a_batch_that_fails_gives_what_it_wrote_and_the_reason_for_what_it_did_not(
    tmp_path: Path,
):
    scene = scene_of("a.png", "missing.png")
    options = {
        "run": f"{program(tmp_path, BATCH)} {{input}} {{output}} '{tmp_path / 'log'}' 3",
        "per": "scene",
    }
    result = restore("command", scene, scene.views[0], **options)
    np.testing.assert_array_equal(result.image, RGB)
    assert re.search("exit code 3, .*did 2", result.info["fault"])
    with pytest.raises(InputError, match=r"missing\.png: .*exit code 3, .*did 2"):
        restore("command", scene, scene.views[1], **options)
    assert (tmp_path / "log").read_text().count("\n") == 1


def test_views_that_lack_what_a_batch_needs_do_not_keep_the_others(tmp_path: Path):
    with_depth = scene_of("a.png", depth=DEPTH).views[0]
    scene = Scene("made", [with_depth, scene_of("b.png").views[0], scene_of("far.png", depth=DEPTH * 40).views[0]],
                  frozenset({"depth"}))  # fmt: skip
    run = f"{program(tmp_path, BATCH)} {{input}} {{output}} '{tmp_path / 'log'}' 0 {{depth}}"
    np.testing.assert_array_equal(
        restore("command", scene, with_depth, run=run, per="scene").image, RGB
    )
    with pytest.raises(NotApplicableError, match=r"b\.png: .*depth"):
        restore("command", scene, scene.views[1], run=run, per="scene")
    with pytest.raises(InputError, match=r"far\.png: .*80\.0 m"):
        restore("command", scene, scene.views[2], run=run, per="scene")
    assert (tmp_path / "log").read_text() == "a.png\n"
