"""Examines this machine: what works, what does not, and the commands that install the rest.

In: the folder whose disk to check. Out: `Examined`, with machine, features and remedies.
"""

import ctypes
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from sucre_bench import plugins
from sucre_bench.machine import progress, provenance
from sucre_bench.machine.compute import usable_cores
from sucre_bench.machine.provenance import absent, distribution_of, version_of
from sucre_bench.plugins.plugin import Broken

# Shared libraries that open3d's wheel expects of the system, and the Debian/Ubuntu packages that bring them.
# scripts/setup.sh reads this table.
OPEN3D_LIBRARIES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libudev.so.1": "libudev1",
    "libidn2.so.0": "libidn2-0",
    "libgomp.so.1": "libgomp1",
}

# The packages of each feature that must be there, and of those that only some need; import names.
_REQUIRED = {
    "SUCRe on the CPU": ["numba"],
    "metrics, colour charts": ["skimage", "scipy", "cv2"],
    "results, configuration": ["pandas", "pyarrow", "hydra", "numpy"],
}
_OPTIONAL = {
    "the paper's SUCRe, networks": "torch",
    "SUCRe by JAX": "jax",
    "networks from ONNX files": "onnxruntime",
    "prepare: photos to a scene": "pycolmap",
    "runs in mlflow": "mlflow",
    "ColorChecker SG": "colour",
    "raw photos (.arw, .cr2, .nef)": "rawpy",
    "depth maps in OpenEXR": "OpenEXR",
    "MATLAB tables (squid)": "matio",
    "documentation as a site": "mkdocs",
}
_PROGRAMS = {
    "commit in the provenance": ["git"],
    "tests in a browser": [
        "chromium",
        "chromium-browser",
        "google-chrome",
        "google-chrome-stable",
    ],
}

_SLURM = ("sbatch", "squeue", "scancel", "srun")
_LITTLE_DISK_GB = 2.0
_LONGEST_S = 60.0  # of an import

State = Literal["ready", "missing", "broken", "absent"]


@dataclass(frozen=True)
class Feature:
    """A feature of sucre_bench on this machine."""

    name: str

    state: State
    """Optional and not installed is "missing"; required, but missing or failing is "broken"; not applicable here is
    "absent"."""

    said: str
    """What provides it, or why not."""

    remedy: str = ""
    """The command that mends it."""


@dataclass(frozen=True)
class Examined:
    """The result of an examination."""

    version: str
    python: str
    commit: str

    machine: dict[str, str]
    """Facts of the computer, by name."""

    features: tuple[Feature, ...]

    @property
    def faults(self) -> int:
        """The number of broken features."""
        return sum(feature.state == "broken" for feature in self.features)


def examine(out: Path = Path()) -> Examined:
    """Examine packages, plugins, programs and the disk of `out`, without changing anything."""
    import psutil

    commit, dirty = provenance.source_commit()
    gpu, memory = provenance.gpu(), psutil.virtual_memory()
    there = next(
        folder for folder in (out.resolve(), *out.resolve().parents) if folder.exists()
    )
    disk = shutil.disk_usage(there)
    machine = {
        "cores": str(usable_cores()),
        "memory": f"{memory.available / 2**30:.1f} of {memory.total / 2**30:.1f} GB free",
        "disk": f"{disk.free / 2**30:.0f} of {disk.total / 2**30:.0f} GB free at {out.resolve()}",
        "gpu": gpu or "none found: torch and JAX run on the CPU",
    }
    cluster = "a cluster, by SLURM"
    no_program = [name for name in _SLURM if not shutil.which(name)]
    tries: list[Callable[[], Feature]] = [
        partial(_packages, name, *imports) for name, imports in _REQUIRED.items()
    ]
    tries += [partial(_gpu, gpu), _open3d]
    tries += [
        partial(_packages, name, package, lacking="missing")
        for name, package in _OPTIONAL.items()
    ]
    if not no_program:
        tries.append(
            partial(
                _packages, cluster, "hydra_plugins.hydra_submitit_launcher", lacking="missing"
            )
        )
    with ThreadPoolExecutor(usable_cores()) as pool:  # each waits for a process that imports
        done = pool.map(lambda examined: examined(), tries)
        features = list(progress.track(done, "importing packages", len(tries)))
    features.insert(len(_REQUIRED), _plugins())
    for name, programs in _PROGRAMS.items():
        found = next((path for program in programs if (path := shutil.which(program))), None)
        missing = Feature(name, "missing", f"no {programs[0]}", _apt(programs[0]))
        features.append(Feature(name, "ready", found) if found else missing)
    if no_program:
        features.append(
            Feature(cluster, "absent", f"no {no_program[0]}: not a login node of a cluster")
        )
    if disk.free < _LITTLE_DISK_GB * 2**30:
        said = f"less than {_LITTLE_DISK_GB:.0f} GB free; give another out=FOLDER"
        features.append(Feature("disk for results", "broken", said))
    return Examined(
        version_of("sucre-bench") or "not installed",
        f"{platform.python_version()}, {sys.prefix}",
        f"{commit[:12]}{' with uncommitted changes' if dirty else ''}" if commit else "",
        machine,
        tuple(features),
    )


def _packages(name: str, *imports: str, lacking: State = "broken") -> Feature:
    """A feature that needs packages. Another process imports them, because they may crash.

    lacking: its state if one is not installed, or too old.
    """
    if missing := absent(*imports):
        return Feature(name, lacking, missing.fault, _in_this_python(missing.install))
    packages = [distribution_of(package) for package in imports]
    works, line = _try(f"import {', '.join(imports)}")
    if not works:
        remedy = _in_this_python(f"pip install --force-reinstall {' '.join(packages)}")
        return Feature(
            name, "broken", f"{' or '.join(imports)} does not import: {line}", remedy
        )
    return Feature(
        name, "ready", ", ".join(f"{package} {version_of(package)}" for package in packages)
    )


def _gpu(gpu: str | None) -> Feature:
    name = "SUCRe on the GPU"
    version = version_of("torch")
    if gpu is None:
        return Feature(name, "absent", "no GPU here, or no driver (nvidia-smi)")
    if missing := absent("torch"):
        return Feature(name, "missing", missing.fault, _in_this_python(missing.install))
    if version and "+cpu" in version:
        remedy = _in_this_python(
            f"pip install --force-reinstall torch=={version.partition('+')[0]}"
        )
        return Feature(name, "broken", f"torch {version} is built for CPUs alone", remedy)
    works, line = _try(
        "import torch; torch.zeros(1).cuda(); print(torch.cuda.get_device_name())"
    )
    if works:
        return Feature(name, "ready", f"torch {version} on {line}")
    return Feature(
        name, "broken", f"torch {version} does not see the {gpu}: {line}", "nvidia-smi"
    )


def _plugins() -> Feature:
    """All plugins as one feature, naming those that cannot be used."""
    counts, faults, remedies = [], [], []
    for kind in plugins.KINDS:
        known = plugins.discover(kind).values()
        counts.append(f"{len(known)} {kind}s")
        for plugin in known:
            if isinstance(plugin, Broken):
                faults.append(f"{kind} {plugin.name}: {plugin.reason}")
            elif (lacking := absent(*plugin.requires)) and not lacking.is_extra:
                faults.append(f"{kind} {plugin.name}: {lacking.fault}")
                remedies.append(_in_this_python(lacking.install))
    if faults:
        return Feature("plugins", "broken", "; ".join(faults), "".join(remedies[:1]))
    return Feature("plugins", "ready", ", ".join(counts))


def _open3d() -> Feature:
    """Open3D, with the libraries of the system that it may lack."""
    feature = _packages("surfaces", "open3d", lacking="missing")
    packages = []
    for library, package in OPEN3D_LIBRARIES.items() if feature.state == "broken" else ():
        try:
            ctypes.CDLL(library)
        except OSError:
            packages.append(package)
    if packages:
        return Feature(
            feature.name, "broken", "open3d lacks libraries of the system", _apt(*packages)
        )
    return feature


def _try(code: str) -> tuple[bool, str]:
    """Run code in another Python. Return whether it succeeded, and its last line, of errors if it failed."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-c", code],
            capture_output=True,
            text=True,
            check=False,
            timeout=_LONGEST_S,
        )
    except subprocess.TimeoutExpired:
        return False, f"no end after {_LONGEST_S:.0f} s"
    lines = (done.stderr if done.returncode else done.stdout).strip().splitlines()
    return done.returncode == 0, lines[-1] if lines else f"exit code {done.returncode}"


def _in_this_python(pip: str) -> str:
    return f"{shlex.quote(sys.executable)} -m {pip}"


def _apt(*packages: str) -> str:
    return f"{'' if os.geteuid() == 0 else 'sudo '}apt-get install {' '.join(packages)}"
