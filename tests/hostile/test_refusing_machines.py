"""Rights that are missing, full disks, limits: one line, another exit code than 0, and nothing finished is lost."""

import contextlib
import ctypes
import functools
import os
import re
import resource
from pathlib import Path

import pytest
from support.colmap_folder import write_dive
from support.command_line import Started, forks, run_here

from sucre_bench import results

_VERSION_3 = 0x20080522  # of Linux's capabilities
_REFUSED = 13  # exit code


def as_user() -> None:
    """Take from this process what root may do to the files of others; permissions then count for root as well."""
    if os.geteuid() != 0:
        return
    header = (ctypes.c_uint32 * 2)(_VERSION_3, 0)
    nothing = (ctypes.c_uint32 * 6)()
    assert ctypes.CDLL(None, use_errno=True).capset(header, nothing) == 0


def skip_unless_refused(folder: Path) -> None:
    """Skip a test where root's rights cannot be taken from a process, or rights of files mean nothing."""
    secret = folder / "secret"
    secret.touch(mode=0)
    process = forks().Process(target=_open_as_user, args=(secret,))
    process.start()
    process.join()
    secret.unlink()
    if process.exitcode != _REFUSED:
        pytest.skip("this system refuses root nothing")


def _open_as_user(path: Path) -> None:
    with contextlib.suppress(PermissionError):
        as_user()
        path.open().close()
        os._exit(0)
    os._exit(_REFUSED)


def with_small_files(n_bytes: int) -> None:
    """Let this process write no file of more bytes."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, n_bytes))


RUN = "run -m dataset=colmap dataset.root=dive method=gray_world,underwater metrics=[coverage] tracking.uri=off"
RESULTS = f"{RUN} report=false save=full out=results"

# What this user must not do, a command, and a pattern of its line.
FORBIDDEN: dict[str, tuple[str, int, str, str]] = {
    "enter a dataset": ("dive", 0o600, f"{RUN} out=x", r"dive/\S+: .*Permission denied; "),
    "enter a folder of images": (
        "dive/images",
        0o600,
        f"{RUN} out=x",
        r"dive/images/a\.png: .*Permission denied; ",
    ),
    "list a folder of images": (
        "dive/images",
        0o300,
        "run dataset=photos dataset.root=dive/images method=gray_world out=x",
        r"dive/images: .*Permission denied; ",
    ),
    "enter a folder of photos": (
        "dive/images",
        0o600,
        "prepare dive/images x",
        r"\ba\.png: .*Permission",
    ),
    "read a score table": (
        "results/scores.parquet",
        0o200,
        "compare results",
        r"parquet: .*Permission denied; let",
    ),
    "read the score table of a run": (
        "results/scores.parquet",
        0o200,
        RESULTS,
        r"parquet: .*Permission denied; let",
    ),
    "enter a results folder": (
        "results",
        0o600,
        "compare results",
        r"results/.*Permission denied; let",
    ),
    "list the parts of a score table": (
        "parted/parts",
        0o300,
        "compare parted",
        r"parted/parts: .*Permission denied; let",
    ),
    "write into a results folder": ("results", 0o500, RESULTS, r"results/.*: .*written.*; "),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("refused")
    write_dive(folder / "dive", ("a.png", "b.png"))
    (folder / "full").mkdir()
    (folder / "parted" / "parts").mkdir(parents=True)
    assert run_here(folder, *RESULTS.split()).returncode == 0
    return folder


@pytest.mark.parametrize(("path", "mode", "command", "said"), FORBIDDEN.values(), ids=FORBIDDEN)
def test_a_missing_right_is_one_line(
    place: Path, path: str, mode: int, command: str, said: str
):
    skip_unless_refused(place)
    before = results.read(place / "results")
    usual = (place / path).stat().st_mode
    (place / path).chmod(mode)
    try:
        done = Started(place, *command.split(), before=as_user).ended()
    finally:
        (place / path).chmod(usual)
    assert done.returncode == 2
    assert re.search(said, done.stderr), done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert len(done.errors) == 1
    assert results.read(place / "results").equals(before)


def test_stored_restorations_that_cannot_be_replaced_keep_their_rows(place: Path):
    skip_unless_refused(place)
    before = results.read(place / "results")
    folder = place / "results" / "restored" / "colmap" / "gray_world"
    folder.chmod(0o500)
    try:
        done = Started(place, *RESULTS.split(), "overwrite=always", before=as_user).ended()
    finally:
        folder.chmod(0o700)
    assert done.returncode != 0
    assert re.search(r"gray_world/a\.\w+: .*written.*; ", done.stdout + done.stderr)
    of_method = before[before["method"] == "gray_world"]
    after = results.read(place / "results")
    assert (
        after[after["method"] == "gray_world"]
        .reset_index(drop=True)
        .equals(of_method.reset_index(drop=True))
    )
    assert set(after["status"].unique()) == {"ok"}


def test_a_limit_on_the_size_of_files_stops_a_run_which_goes_on_without_it(
    place: Path, tmp_path: Path
):
    (tmp_path / "dive").symlink_to(place / "dive")
    words = [*RESULTS.split(), "out=small"]
    done = Started(tmp_path, *words, before=functools.partial(with_small_files, 4096)).ended()
    assert done.returncode in (1, 2)
    assert re.search(r"small/\S+: .*[Ff]ile too large.*; ", done.stdout + done.stderr)
    assert "Traceback" not in done.stdout + done.stderr
    assert run_here(tmp_path, *words).returncode == 0
    assert set(results.read(tmp_path / "small")["status"].unique()) == {"ok"}
