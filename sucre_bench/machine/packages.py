"""Python packages: their versions, and what installs those that are missing or too old.

sucre_bench itself needs few. What one kind of work needs beside them stands in an extra, `sucre-bench[torch]` say.
"""

import functools
import importlib
import importlib.metadata
import importlib.util
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from packaging.requirements import Requirement

from sucre_bench.errors import InputError, one_line

# Import name -> name in the package index, where the two differ.
_PACKAGE = {
    "cv2": "opencv-python-headless",
    "skimage": "scikit-image",
    "colour": "colour-science",
    "hydra": "hydra-core",
    "PIL": "Pillow",
    "matio": "mat-io",
}
_OF_DEVELOPERS = ("dev", "docs")  # extras


@dataclass(frozen=True)
class Absent:
    """Packages that are missing or too old.

    fault: which, and why; install: the command that mends it; is_extra: whether all are of extras, which not all need.
    """

    fault: str
    install: str
    is_extra: bool

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
    except importlib.metadata.PackageNotFoundError:  # run from its files, without an installation
        lines = []
    needed = {}
    for line in lines:
        one, found = Requirement(line), re.search(r"extra == .(\w+)", line)
        if one.name != "sucre-bench" and (extra := found[1] if found else "") not in _OF_DEVELOPERS:
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
    return Absent(", ".join(faults), f"pip install {' '.join(dict.fromkeys(wanted))}", all(extras))


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
        remedy = "`sucre-bench doctor` says what to install"
        raise InputError(f"{package} does not import, {one_line(fault)}", place, remedy) from fault
