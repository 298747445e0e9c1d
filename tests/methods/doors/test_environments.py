"""Programs in environments of uv, conda and docker: the words that run them, what rows record, what is refused."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from support.messages import names, refused
from support.restoring_programs import restored

from sucre_bench.machine.records import record_of
from sucre_bench.methods.doors import Command

RUN = "python restore.py {input} {output}"
IMAGE = "sha256:" + "0" * 63 + "1"
PACKAGES = "https://conda.anaconda.org/conda-forge/linux-64/numpy-1.26.4-py312.conda#0f1e"
IN_CONDA = (
    f"conda:one@sha256:{hashlib.sha256(f'@EXPLICIT{chr(10)}{PACKAGES}'.encode()).hexdigest()}"
)
QUIET = ("metrics=[redness]", "tracking.uri=off", "report=false", "out=out", "workers=0")
COPY = "import shutil, sys\nshutil.copy(sys.argv[1], sys.argv[2])\n"

# conda and docker as far as these tests need them. What they are told is added to a file beside them.
CONDA = f"""
if sys.argv[1] == "list" and sys.argv[-1] == "gone":
    sys.exit("\\nEnvironmentLocationNotFound: Not a conda environment: /opt/conda/envs/gone\\n")
if sys.argv[1] == "list":
    print("# created-by: conda", "24.1" if sys.argv[-1] == "one" else "25.3")
    print("@EXPLICIT\\n{PACKAGES}")
else:
    os.execv(sys.executable, [sys.executable, *sys.argv[6:]])
"""
DOCKER = f"""
if sys.argv[1] == "run":
    os.execv(sys.executable, [sys.executable, *sys.argv[sys.argv.index("reef@{IMAGE}") + 2 :]])
"""


@pytest.fixture
def tools(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with stand-ins of conda and docker and a program; `told` there is what they were told, line by line."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    (tmp_path / "bin").mkdir()
    log = f"print(*sys.argv[1:], file=open({str(tmp_path / 'told')!r}, 'a'))"
    for name, source in (("conda", CONDA), ("docker", DOCKER)):
        (tmp_path / "bin" / name).write_text(
            f"#!{sys.executable}\nimport os, sys\n{log}\n{source}"
        )
        (tmp_path / "bin" / name).chmod(0o755)
    (tmp_path / "restore.py").write_text(COPY)
    return tmp_path


def test_conda_and_docker_run_the_program_with_its_files_in_reach(tools: Path):
    in_conda = restored(RUN, env="conda:one")
    assert in_conda.info["environment"] == IN_CONDA
    in_docker = restored(RUN, env=f"docker:reef@{IMAGE}", rests_on=tools / "restore.py")
    assert in_docker.info["environment"] == f"docker:reef@{IMAGE}"
    told = (tools / "told").read_text().splitlines()
    (conda,) = [line for line in told if line.startswith("run --no-capture-output")]
    (docker,) = [line for line in told if line.startswith("run --rm")]
    assert conda.startswith("run --no-capture-output --name one python restore.py /")
    place = conda.split()[-1].rpartition("/output/")[0].rpartition("/")[0]
    mounted = docker.split("--volume ")[1].split(":")[0]
    assert mounted.startswith(place)
    assert docker.startswith(
        f"run --rm --init --user {os.getuid()}:{os.getgid()} --env HOME=/tmp "
    )
    assert (
        f"--volume {mounted}:{mounted} --volume {tools}/restore.py:{tools}/restore.py:ro reef@{IMAGE} "
        in docker
    )
    assert docker.endswith(
        f" python restore.py {mounted}/input/view.png {mounted}/output/view.png"
    )


def test_an_environment_that_cannot_be_made_fails_alone_and_rows_have_the_others_with_a_digest(
    bench, toys: str, tools: Path
):
    words = ("method=command", f"method.run='{RUN}'", "method.env=conda:one,conda:gone")
    done = bench("run", "-m", "--plugin", toys, "dataset=toy", *QUIET, *words)
    assert done.returncode == 1
    rows = pd.read_parquet(tools / "out" / "scores.parquet")
    of = dict(iter(rows.groupby(rows["method"].str.contains("gone"))))
    assert set(of[False]["status"]) == {"ok"}
    gone = of[True]
    assert set(gone["status"]) == {"failed"}
    assert {"Not", "/opt/conda/envs/gone", "method.env=conda:gone"} <= names(
        gone["reason"].iloc[0]
    )
    assert {json.loads(text)["env"] for text in of[False]["options"]} == {IN_CONDA}
    assert IN_CONDA in (tools / "out" / "config.yaml").read_text()


@pytest.mark.parametrize(
    ("env", "named"),
    [
        ("nix:reef", {"method.env=nix:reef", "uv:FILE", "conda:NAME"}),
        ("conda:", {"conda:NAME"}),
        ("uv:nowhere.txt", {"nowhere.txt", "method.env", "uv:FILE"}),
        ("docker:reef:1.2", {"digest", "docker:reef@sha256", "inspect"}),
        ("docker:localhost:5000/reef:1", {"digest", "docker:localhost:5000/reef@sha256"}),
        ("docker:reef@sha256:12", {"digest", "docker:reef@sha256", "inspect"}),
        (f"conda:one@{IMAGE}", {IMAGE, "method.env=conda:one"}),
    ],
)
def test_an_environment_that_says_too_little_or_has_changed_is_refused(
    env: str, named: set[str], tools: Path
):
    (tools / "bin" / "uv").symlink_to(sys.executable)
    with refused(*named):
        Command(run=RUN, env=env)


# Two programs that cannot live in one environment: each wants another numpy, and names it in what it prints.
NEEDS = {"old": "numpy==1.26.4", "new": "numpy==2.2.1"}


@pytest.fixture
def conflicting(tmp_path: Path) -> Path:
    """A folder with two files of requirements; skips where uv is absent, or cannot get the packages."""
    if shutil.which("uv") is None:
        pytest.skip("uv is not installed")
    for name, requirement in NEEDS.items():
        (tmp_path / f"{name}.txt").write_text(f"{requirement}\n")
        words = [
            "uv",
            "run",
            "--isolated",
            "--no-project",
            "--with-requirements",
            f"{name}.txt",
            "--",
            "python",
            "-V",
        ]
        made = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=300)
        if made.returncode:
            pytest.skip(f"uv cannot get {requirement}: {made.stderr.splitlines()[-1]}")
    return tmp_path


def test_two_methods_with_conflicting_packages_run_in_one_sweep(
    bench, toys: str, conflicting: Path
):
    (conflicting / "restore.py").write_text(
        f"import numpy\nprint('numpy==' + numpy.__version__)\n{COPY}"
    )
    (conflicting / "never.txt").write_text("numpy==99.1\n")
    words = (
        "method=command",
        f"method.run='{RUN}'",
        "method.env=uv:old.txt,uv:new.txt,uv:never.txt",
    )
    done = bench("run", "-m", "--plugin", toys, "dataset=toy", "views=[v0.png]", *QUIET, *words)
    assert done.returncode == 1
    rows = (
        pd.read_parquet(conflicting / "out" / "scores.parquet")
        .query("metric == 'seconds'")
        .set_index("method")
    )
    for name, requirement in NEEDS.items():
        (method,) = [label for label in rows.index if name in label]
        digest = hashlib.sha256(f"{requirement}\n".encode()).hexdigest()
        assert (
            json.loads(rows.loc[method, "options"])["env"] == f"uv:{name}.txt@sha256:{digest}"
        )
        (picture,) = conflicting.glob(f"out/restored/toy/*{name}*/v0.png")
        assert record_of(picture)["said"] == requirement
    (never,) = [label for label in rows.index if "never" in label]
    assert rows.loc[never, "status"] == "failed"
    assert "numpy==99.1" in rows.loc[never, "reason"]
