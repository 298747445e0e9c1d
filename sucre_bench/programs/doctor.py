"""Examines this machine: what works, what does not, and the commands that install the rest.

In: the folder whose disk to check. Out: `Examined`, with machine, features and remedies.
"""

import ctypes
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sucre_bench import plugins
from sucre_bench.machine import provenance
from sucre_bench.machine.children import python
from sucre_bench.machine.cores import usable_cores
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

_LITTLE_DISK_GB = 2.0

State = Literal["ready", "missing", "broken", "absent"]


@dataclass(frozen=True)
class Feature:
    """A feature of sucre_bench on this machine.

    state: "ready"; "missing": optional and not installed; "broken": required, but missing or failing; "absent": not
    applicable here. said: what provides it, or why not; remedy: the command that mends it.
    """

    name: str
    state: State
    said: str
    remedy: str = ""


@dataclass(frozen=True)
class Examined:
    """The result of an examination. machine: its facts by name."""

    version: str
    python: str
    commit: str
    machine: dict[str, str]
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
    there = next(folder for folder in (out.resolve(), *out.resolve().parents) if folder.exists())
    disk = shutil.disk_usage(there)
    machine = {
        "cores": str(usable_cores()),
        "memory": f"{memory.available / 2**30:.1f} of {memory.total / 2**30:.1f} GB free",
        "disk": f"{disk.free / 2**30:.0f} of {disk.total / 2**30:.0f} GB free at {out.resolve()}",
        "gpu": gpu or "none found: torch and JAX run on the CPU",
    }
    features = list(_features(gpu))
    if disk.free < _LITTLE_DISK_GB * 2**30:
        said = f"less than {_LITTLE_DISK_GB:.0f} GB free; give another out=FOLDER"
        features.append(Feature("disk for results", "broken", said))
    return Examined(
        provenance.version_of("sucre-bench") or "not installed",
        f"{platform.python_version()}, {sys.prefix}",
        f"{commit[:12]}{' with uncommitted changes' if dirty else ''}" if commit else "",
        machine,
        tuple(features),
    )


def _features(gpu: str | None) -> Iterator[Feature]:
    yield _packages("SUCRe on the CPU", "torch", "numba")
    yield _gpu(gpu)
    yield _packages("SUCRe and others by JAX", "jax")
    yield _open3d()
    yield _packages("prepare: photos to a scene", "pycolmap", "opencv-python-headless")
    yield _packages("colour charts, metrics", "colour-science", "scikit-image", "scipy")
    yield _packages("networks from ONNX files", "onnxruntime")
    yield _packages("results, configuration", "pandas", "pyarrow", "hydra-core", "numpy")
    yield _packages("mlflow", "mlflow")
    yield _plugins()
    yield _optional("raw photos (.arw, .cr2, .nef)", "rawpy", "rawpy")
    yield _optional("depth maps in OpenEXR", "OpenEXR", "OpenEXR")
    yield _optional("MATLAB tables (squid)", "matio", "mat-io")
    videos = "videos in H.264, for slides"  # presentation programs need it, browsers play VP9
    if shutil.which("ffmpeg"):
        yield Feature(videos, "ready", "ffmpeg -i dive.webm -c:v libx264 -pix_fmt yuv420p dive.mp4")
    else:
        yield Feature(videos, "missing", "no ffmpeg to turn VP9 (.webm, .mp4, for browsers) into it", _apt("ffmpeg"))
    yield _program("commit in the provenance", "git")
    yield _program("tests in a browser", "chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    yield _optional("documentation as a site", "mkdocs", "mkdocs", "make setup")
    slurm = "a cluster, by SLURM"
    absent = [program for program in ("sbatch", "squeue", "scancel", "srun") if not shutil.which(program)]
    if absent:
        yield Feature(slurm, "absent", f"no {absent[0]}: not a login node of a cluster")
    else:
        yield _optional(slurm, "submitit", "submitit")


def _packages(name: str, *distributions: str) -> Feature:
    """A feature of required packages: a missing one is a fault."""
    versions = {package: provenance.version_of(package) for package in distributions}
    absent = [package for package, version in versions.items() if version is None]
    if absent:
        return Feature(name, "broken", f"no {', '.join(absent)}", _pip(*absent))
    return Feature(name, "ready", ", ".join(f"{package} {version}" for package, version in versions.items()))


def _optional(name: str, module: str, distribution: str, remedy: str = "") -> Feature:
    if importlib.util.find_spec(module) is not None:
        return Feature(name, "ready", f"{distribution} {provenance.version_of(distribution) or ''}".strip())
    return Feature(name, "missing", f"no {distribution}", remedy or _pip(distribution))


def _program(name: str, *programs: str) -> Feature:
    found = next((path for program in programs if (path := shutil.which(program))), None)
    return Feature(name, "ready", found) if found else Feature(name, "missing", f"no {programs[0]}", _apt(programs[0]))


def _gpu(gpu: str | None) -> Feature:
    name, torch = "SUCRe on the GPU", provenance.version_of("torch")
    if gpu is None:
        return Feature(name, "absent", "no GPU here, or no driver (nvidia-smi)")
    if torch is None:
        return Feature(name, "broken", "no torch", _pip("torch"))
    if "+cpu" in torch:
        remedy = _pip("--force-reinstall", f"torch=={torch.partition('+')[0]}")
        return Feature(name, "broken", f"torch {torch} is built for CPUs alone", remedy)
    tried = _python("import torch; torch.zeros(1).cuda(); print(torch.cuda.get_device_name())")
    if tried.returncode == 0:
        return Feature(name, "ready", f"torch {torch} on {tried.stdout.strip()}")
    return Feature(name, "broken", f"torch {torch} does not see the {gpu}: {_last(tried.stderr)}", "nvidia-smi")


def _plugins() -> Feature:
    """All plugins as one feature, naming the first that cannot be used."""
    counts, faults, remedies = [], [], []
    for kind in plugins.KINDS:
        known = plugins.discover(kind).values()
        counts.append(f"{len(known)} {kind}s")
        for plugin in known:
            if isinstance(plugin, Broken):
                faults.append(f"{kind} {plugin.name}: {plugin.reason}")
            elif remedy := plugins.missing_packages(plugin):
                faults.append(f"{kind} {plugin.name}: a package is missing")
                remedies.append(remedy)
    if faults:
        return Feature("plugins", "broken", "; ".join(faults), remedies[0] if remedies else "")
    return Feature("plugins", "ready", ", ".join(counts))


def _open3d() -> Feature:
    """Open3D is imported in another process, because it may crash."""
    installed = _packages("demo scene, surfaces", "open3d")
    if installed.state != "ready" or not (tried := _python("import open3d")).returncode:
        return installed
    if absent := [package for library, package in OPEN3D_LIBRARIES.items() if not _loads(library)]:
        return Feature(installed.name, "broken", "open3d lacks libraries of the system", _apt(*absent))
    said = f"open3d does not import: {_last(tried.stderr) or f'exit code {tried.returncode}'}"
    return Feature(installed.name, "broken", said, _pip("--force-reinstall", "open3d"))


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(python("-c", code), capture_output=True, text=True, check=False)


def _last(text: str) -> str:
    return (text.strip().splitlines() or [""])[-1]


def _pip(*words: str) -> str:
    return f"{shlex.quote(sys.executable)} -m pip install {' '.join(words)}"


def _apt(*packages: str) -> str:
    return f"{'' if os.geteuid() == 0 else 'sudo '}apt-get install {' '.join(packages)}"
