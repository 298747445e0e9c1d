"""What `make setup` promises beside installing: it follows the settings of the user's pip, and destroys nothing."""

import os
import re
import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
with_uv = pytest.mark.skipif(
    find_spec("uv") is None, reason="this environment was made without uv"
)


def run(*command: str | Path, **environment: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a command in an environment without any setting of this machine's pip or uv."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("PIP_", "UV_"))
    }
    variables = {
        **kept,
        "PIP_CONFIG_FILE": os.devnull,
        **{name: str(value) for name, value in environment.items()},
    }
    return subprocess.run(
        [str(c) for c in command], capture_output=True, text=True, check=False, env=variables
    )


def would_install(*options: str, **environment: str | Path) -> str:
    """What uv says it would install of the package `soundings`."""
    done = run(
        sys.executable,
        SCRIPTS / "uv_like_pip.py",
        "--dry-run",
        *options,
        "soundings",
        **environment,
    )
    return done.stderr


def wheels(folder: Path, version: str) -> Path:
    """A folder with a wheel of the package `soundings`, which is nowhere else."""
    folder.mkdir()
    with zipfile.ZipFile(folder / f"soundings-{version}-py3-none-any.whl", "w") as wheel:
        about = f"soundings-{version}.dist-info"
        wheel.writestr(
            f"{about}/METADATA", f"Metadata-Version: 2.1\nName: soundings\nVersion: {version}\n"
        )
        wheel.writestr(
            f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        wheel.writestr(f"{about}/RECORD", "")
    return folder


@with_uv
def test_pips_variables_win_over_its_file_and_uvs_over_both(tmp_path: Path):
    one, two, three = (wheels(tmp_path / version, version) for version in ("1.0", "2.0", "3.0"))
    configuration = tmp_path / "pip.conf"
    for section in ("global", "install"):
        configuration.write_text(f"[{section}]\nno-index = true\nfind-links = {three}\n")
        assert "soundings==3.0" in would_install(PIP_CONFIG_FILE=configuration)
    assert "soundings==2.0" in would_install(PIP_CONFIG_FILE=configuration, PIP_FIND_LINKS=two)
    assert "soundings==1.0" in would_install(
        PIP_CONFIG_FILE=configuration, PIP_FIND_LINKS=two, UV_FIND_LINKS=one
    )


@with_uv
def test_pips_constraints_hold_beside_ours(tmp_path: Path):
    both = wheels(tmp_path / "both", "1.0")
    wheels(tmp_path / "newer", "2.0").joinpath("soundings-2.0-py3-none-any.whl").rename(
        both / "soundings-2.0-py3-none-any.whl"
    )
    theirs, ours = tmp_path / "theirs.txt", tmp_path / "ours.txt"
    theirs.write_text("soundings<2\n")
    ours.write_text("numpy>=2\n")
    said = would_install(
        "-c", str(ours), PIP_NO_INDEX="1", PIP_FIND_LINKS=both, PIP_CONSTRAINT=theirs
    )
    assert "soundings==1.0" in said


def test_a_folder_that_is_no_environment_is_refused_and_kept(tmp_path: Path):
    (tmp_path / "dive.png").touch()
    done = run(SCRIPTS / "setup.sh", VENV=tmp_path)
    assert done.returncode == 1
    assert re.fullmatch(rf"setup: {re.escape(str(tmp_path))} .*VENV=.*\n", done.stderr)
    assert (tmp_path / "dive.png").exists()
