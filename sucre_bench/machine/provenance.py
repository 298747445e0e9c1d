"""What a result rests on: Python packages, `environment.json` with versions, commit and machine, and hashes of code.

sucre_bench itself needs few packages. What one kind of work needs beside them stands in an extra, `sucre-bench[torch]`
say. A hash of code is of the files' content; it does not change when a file is moved.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.metadata
import importlib.util
import json
import platform
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

from sucre_bench.arguments import check_argument
from sucre_bench.errors import InputError, one_line
from sucre_bench.machine.compute import usable_cores
from sucre_bench.machine.files import read_json, write_atomically
from sucre_bench.machine.text_formats import masked, short_hash

# Import name -> name in the package index, where the two differ.
_PACKAGE = {
    "cv2": "opencv-python-headless",
    "skimage": "scikit-image",
    "colour": "colour-science",
    "hydra": "hydra-core",
    "hydra_plugins.hydra_submitit_launcher": "hydra-submitit-launcher",
    "PIL": "Pillow",
    "matio": "mat-io",
}
_OF_DEVELOPERS = ("dev", "docs")  # extras


@dataclass(frozen=True)
class Absent:
    """Packages that are missing or too old."""

    fault: str
    """Which, and why."""

    install: str
    """The command that mends it."""

    is_extra: bool
    """Whether all are of extras, which not everybody needs."""

    def __str__(self) -> str:
        return f"{self.fault}; {self.install}"


def distribution_of(package: str) -> str:
    """Return the name in the package index of an import name."""
    return _PACKAGE.get(package, package)


@functools.cache
def version_of(package: str) -> str | None:
    """Return an installed package's version, or None."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


@functools.cache
def requirements() -> Mapping[str, tuple[Requirement, str]]:
    """Return what sucre_bench needs, by name in the package index, each with its extra, "" for the core."""
    try:
        lines = importlib.metadata.requires("sucre-bench") or []
    except importlib.metadata.PackageNotFoundError:
        # run from its files, without an installation
        lines = []
    needed = {}
    for line in lines:
        one, found = Requirement(line), re.search(r"extra == .(\w+)", line)
        if (
            one.name != "sucre-bench"
            and (extra := found[1] if found else "") not in _OF_DEVELOPERS
        ):
            needed[one.name] = one, extra
    return needed


def absent(*packages: str) -> Absent | None:
    """Return which import names are missing, or older than sucre_bench needs; None if all are there."""
    faults, wanted, extras = [], [], []
    for package in packages:
        name = distribution_of(package)
        needed, extra = requirements().get(name, (Requirement(name), ""))
        version = version_of(name)
        if not _is_found(package):
            faults.append(f"{name} is not installed")
        elif version and not needed.specifier.contains(version, prereleases=True):
            faults.append(f"{name} is {version}, not {needed.specifier}")
        else:
            continue
        extras.append(extra)
        bounded = f"'{name}{needed.specifier}'" if needed.specifier else name
        wanted.append(f"'sucre-bench[{extra}]'" if extra else bounded)
    if not faults:
        return None
    return Absent(
        ", ".join(faults), f"pip install {' '.join(dict.fromkeys(wanted))}", all(extras)
    )


def _is_found(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except ModuleNotFoundError:  # of a package that it is in
        return False


def require(place: str, *packages: str) -> None:
    """Raise InputError, with the command that installs them, if packages are missing or too old.

    place: what needs them, as the user typed it.
    """
    if lacking := absent(*packages):
        raise InputError(lacking.fault, place, lacking.install)


def load(place: str, package: str) -> Any:
    """Import a package of an extra. Raises InputError if it is missing, too old, or does not import."""
    require(place, package)
    try:
        return importlib.import_module(package)
    except (ImportError, OSError) as fault:
        remedy = f"pip install --force-reinstall {distribution_of(package)}"
        raise InputError(
            f"{package} does not import, {one_line(fault)}", place, remedy
        ) from fault


# -- environment.json ----------------------------------------------------------------------------------------


def write(path: Path, command: list[str], seed: int, data: dict[str, str]) -> None:
    """Write command, versions, source commit, data and machine of a run as JSON, without passwords.

    data: dataset label -> data_id.
    """
    import psutil

    commit, dirty = source_commit()
    processor = ""
    if sys.platform == "linux":
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor = next(
            (line.partition(":")[2].strip() for line in lines if line.startswith("model name")),
            "",
        )
    content = {
        "command": command,
        "sucre_bench": version_of("sucre-bench"),
        "git_commit": commit,
        "git_dirty": dirty,
        "seed": seed,
        "data": data,
        "python": platform.python_version(),
        "packages": {
            name: version_of(name) for name in sorted(requirements()) if version_of(name)
        },
        "machine": {
            "system": platform.platform(),
            "processor": processor or platform.processor() or platform.machine(),
            "cores": usable_cores(),
            "memory_gb": round(psutil.virtual_memory().total / 2**30, 1),
            "gpu": gpu(),
        },
    }
    write_atomically(path, (masked(json.dumps(content, indent=2)) + "\n").encode())


@functools.cache  # the code of this process is that of its start
def source_commit() -> tuple[str | None, bool | None]:
    """Return the source tree's commit and whether it has uncommitted changes; None, None outside a checkout."""
    here = Path(__file__).resolve().parent.parent.parent
    if not (here / ".git").exists():
        return None, None
    commit, status = (
        _output("git", "-C", str(here), *words)
        for words in (("rev-parse", "HEAD"), ("status", "-s"))
    )
    return (None, None) if commit is None or status is None else (commit, bool(status))


@functools.cache
def gpu() -> str | None:
    """Return the name of the first NVIDIA GPU, or None."""
    names = _output("nvidia-smi", "--query-gpu=name", "--format=csv,noheader")
    return names.splitlines()[0] if names else None


def _output(*command: str) -> str | None:
    """What a program prints, None if it fails."""
    try:
        return subprocess.run(
            command, capture_output=True, text=True, timeout=10, check=True
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None


# What `write` writes: the page reads all of it.
_TYPES: dict[str, Any] = {
    "command": list[str],
    "seed": int,
    "python": str,
    "data": Mapping[str, str],
    "packages": Mapping[str, str],
    "sucre_bench": str | None,
    "git_commit": str | None,
    "git_dirty": bool | None,
    "machine": Mapping[str, Any],
}
_OF_MACHINE = {"system", "processor", "cores", "memory_gb", "gpu"}


def read(path: Path) -> dict[str, Any] | None:
    """Read an environment; None if the file does not exist or is not one that `write` wrote."""
    try:
        content: dict[str, Any] = read_json(path, "", of_data=True)
        for name, hint in _TYPES.items():
            check_argument(name, content[name], hint)
        return content if set(content["machine"]) >= _OF_MACHINE else None
    except (InputError, TypeError, KeyError):
        return None


# -- hashes of code ------------------------------------------------------------------------------------------

# The rooms whose code decides a result, each with all its files. A hash adds the code of the plugins.
_NUMERICS = (
    "arrays",
    "camera",
    "degrade",
    "imaging",
    "loading",
    "multiview",
    "restored_pair",
    "scene",
)


# Libraries that the numerics compute with. Those that plugins name come on top.
_LIBRARIES = ("cv2", "numba", "numpy", "scipy", "skimage")


def engine_hash() -> str:
    """Return a hash of the engine's numerics, its version, and the libraries it computes with: 12 hex digits."""
    return hash_of(())


def hash_of(
    places: tuple[Path, ...], libraries: Iterable[str] = (), more: object = None
) -> str:
    """Return a hash of the engine's numerics and of further code: 12 hex digits.

    places: Python files, or folders of them; libraries: import names whose versions count too; more: anything else
    that counts, by its repr. Raises FileNotFoundError if a room of the numerics is not there.
    """
    engine = Path(__file__).parent.parent
    rooms = (engine / name for name in _NUMERICS)
    numerics = [room if room.is_dir() else room.with_suffix(".py") for room in rooms]
    versions = [
        (name, version_of(distribution_of(name))) for name in sorted({*_LIBRARIES, *libraries})
    ]
    code = {digest for place in (*numerics, *places) for digest in _digests(place)}
    made_of = (sorted(code), version_of("sucre-bench"), versions, more)
    return short_hash(repr(made_of))


@functools.cache  # the code of this process is that of its start
def _digests(place: Path) -> frozenset[str]:
    """Digests of a file, or of the Python files and tables (.csv) of a folder, wherever in it they lie."""
    files = place.rglob("*") if place.is_dir() else [place]
    contents = (file.read_bytes() for file in files if file.suffix in (".py", ".csv"))
    return frozenset(hashlib.blake2b(one, digest_size=8).hexdigest() for one in contents)
