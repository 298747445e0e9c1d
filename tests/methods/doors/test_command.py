"""Commands: those that cannot work, from the command line, and as the documentation shows them."""

import os
import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from onnx.helper import make_node
from support.made_networks import onnx_file
from support.messages import refused
from support.places import ROOT
from support.restoring_programs import restored, scene_of

from sucre_bench import InputError, load_scenes
from sucre_bench.engine.job import measured_restore
from sucre_bench.errors import MissingFileError
from sucre_bench.jobs import compose_jobs as config
from sucre_bench.methods.doors import Command

# -- commands that cannot work ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"run": ""}, {"method.run", "empty"}),
        (
            {"run": "no_such_program {output}"},
            {"method.run", "'no_such_program'", "executable"},
        ),
        ({"run": "/etc/passwd {output}"}, {"method.run", "'/etc/passwd'", "executable"}),
        ({"run": "cp 'a {output}"}, {"method.run", "quotation"}),
        ({"run": "cp {imput} {output}"}, {"method.run", "'{imput}'", "'input'"}),
        ({"run": "cp {input} there"}, {"method.run", "{output}"}),
        (
            {"run": "cp {name} {output}", "per": "scene"},
            {"method.run", "{name}", "method.per=view"},
        ),
        ({"run": "cp {output}", "pattern": "out"}, {"method.pattern", "'out'", "{stem}"}),
        (
            {"run": "cp {output}", "output_suffix": "png"},
            {"method.output_suffix", "'png'", ".png"},
        ),
        ({"run": "cp {output}", "bits": 12}, {"method.bits", "12"}),
        ({"run": "cp {output}", "timeout": 0.0}, {"method.timeout", "0.0", "None"}),
    ],
)
def test_a_command_that_cannot_work_is_refused_at_once(options: dict, named: set[str]):
    with refused(*named):
        Command(**options)


def test_a_program_that_rests_on_nothing_is_a_missing_file(tmp_path: Path):
    with refused(str(tmp_path / "nowhere"), "method.rests_on", error=MissingFileError):
        Command(run="cp {input} {output}", rests_on=tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("content", "said"),
    [("#!/no/such/interpreter\n", "No such file"), ("no first line\n", "Exec format")],
)
def test_a_script_that_nothing_runs_is_named(tmp_path: Path, content: str, said: str):
    script = tmp_path / "restore"
    script.write_text(content)
    script.chmod(0o755)
    with pytest.raises(InputError, match=rf"restore: .*{said}"):
        restored(f"'{script}' {{output}}")


def test_a_view_whose_name_leads_out_of_the_folder_is_refused_in_a_batch():
    with pytest.raises(InputError, match=r"\.\./a\.png: "):
        restored("cp -r {input} {output}", scene_of("../a.png"), per="scene")


@pytest.mark.parametrize(
    "name", [";exit 3;.png", "$(exit 3).png", "`exit 3`.png", "a\nexit 3.png"]
)
def test_a_name_that_a_shell_would_obey_is_refused_within_code(name: str):
    scene = scene_of(name)
    for code in ("cp {input} {output}; echo {name}", "echo {name}", "echo\t{name}", "{name}"):
        with pytest.raises(InputError, match=r"may obey; .*\{name\}"):
            restored(f"sh -c '{code}' {{input}} {{output}}", scene)
    assert (
        restored("cp {input} {output} --suffix={name}", scene).image.shape == scene[0].rgb.shape
    )


# -- from the command line -------------------------------------------------------------------------------


# -- what the documentation shows ------------------------------------------------------------------------


DOORS = ROOT / "docs" / "doors.md"


# Programs that the documentation runs: each copies its input to its output, the way it was told to.
STAND_INS = {
    "matlab": "import re, shutil, sys\n"
    "shutil.copy(*re.fullmatch(r\"restore\\('(.*)', '(.*)'\\)\", sys.argv[2]).groups())",
    "docker": "import shutil, sys\nshutil.copytree(*sys.argv[-2:], dirs_exist_ok=True)",
    "uv": "import os, sys\nos.execv(sys.executable, [sys.executable, *sys.argv[sys.argv.index('--') + 2:]])",
    "theirs.txt": "",
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
    found = re.findall(
        rf"```{language}\n(.*?)```", DOORS.read_text(encoding="utf-8"), re.DOTALL
    )
    return [block.replace("\\\n", "") for block in found]


@pytest.mark.skipif(not DOORS.is_file(), reason="the documentation is not beside the tests")
def test_the_examples_of_the_documentation_restore(
    tmp_path: Path, toys: str, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    for name, source in STAND_INS.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"#!{sys.executable}\n{source}\n")
        (tmp_path / name).chmod(0o755)
    (script,) = [block for block in blocks("sh") if block.startswith("#!/bin/sh")]
    (tmp_path / "restore.sh").write_text(script)
    (tmp_path / "restore.sh").chmod(0o755)
    onnx_file(tmp_path / "physicalnn.onnx", [make_node("Identity", ["x"], ["y"])])
    (scene,) = load_scenes("toy")
    folders = [
        "renders/rgb_clear_clamp/train",
        "renders/rgb/train",
        "model/test/render",
        "model/test/with_water",
    ]
    for folder in (*folders, "named", "pictures"):
        (tmp_path / folder).mkdir(parents=True)
        for view in scene:
            np.save(tmp_path / folder / view.name.replace(".png", ".npy"), view.rgb)

    (told,) = blocks("json")
    for folder in ("renders", "model/test"):
        (tmp_path / folder / "rendering.json").write_text(told)
    lines = [
        line
        for block in blocks("sh")
        for line in block.splitlines()
        if line.startswith("sucre-bench run")
    ]
    assert len(lines) >= 8
    for line in lines:
        overrides = [
            w for w in shlex.split(line)[2:] if not w.startswith(("dataset", "metrics"))
        ]
        (job,) = config.jobs(["dataset=toy", "metrics=[redness]", *overrides], False).jobs
        image = measured_restore(job.method.make(), scene, scene.views[1]).restoration.image
        np.testing.assert_allclose(image, scene.views[1].rgb, atol=0.51 / 255, err_msg=line)
