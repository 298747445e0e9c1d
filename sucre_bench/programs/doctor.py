"""Examines this machine: what is installed, what is missing, and the commands that install the rest.

In: the folder whose disk to check. Out: `Examined`, with machine, features and remedies. It imports no package, only
torch where there is a GPU.
"""

import contextlib
import ctypes
import platform
import shlex
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sucre_bench import plugins
from sucre_bench.machine import provenance
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
    "surfaces": "open3d",
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
    "jobs of a cluster, by SLURM": "hydra_plugins.hydra_submitit_launcher",
}

State = Literal["ready", "missing", "broken", "absent"]


@dataclass(frozen=True)
class Feature:
    """A feature of sucre_bench on this machine."""

    name: str

    state: State
    """Optional and not installed is "missing"; required and missing is "broken", as is what cannot work; not applicable
    here is "absent"."""

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
    """Examine packages, plugins and the disk of `out`, without changing anything."""
    import psutil

    commit, dirty = provenance.source_commit()
    memory = psutil.virtual_memory()
    there = next(
        folder for folder in (out.resolve(), *out.resolve().parents) if folder.exists()
    )
    disk = shutil.disk_usage(there)
    machine = {
        "cores": str(usable_cores()),
        "memory": f"{memory.available / 2**30:.1f} of {memory.total / 2**30:.1f} GB free",
        "disk": f"{disk.free / 2**30:.0f} of {disk.total / 2**30:.0f} GB free at {out.resolve()}",
        "gpu": provenance.gpu() or "none found: torch and JAX run on the CPU",
    }
    features = [_packages(name, "broken", *imports) for name, imports in _REQUIRED.items()]
    features += [_plugins(), _gpu()]
    features += [_packages(name, "missing", package) for name, package in _OPTIONAL.items()]
    features += _libraries()
    return Examined(
        version_of("sucre-bench") or "not installed",
        f"{platform.python_version()}, {sys.prefix}",
        f"{commit[:12]}{' with uncommitted changes' if dirty else ''}" if commit else "",
        machine,
        tuple(features),
    )


def _packages(name: str, lacking: State, *imports: str) -> Feature:
    """A feature that needs packages. lacking: its state if one is not installed, or too old."""
    if missing := absent(*imports):
        return Feature(name, lacking, missing.fault, _in_this_python(missing.install))
    packages = [distribution_of(package) for package in imports]
    versions = ", ".join(f"{package} {version_of(package)}" for package in packages)
    return Feature(name, "ready", versions)


def _gpu() -> Feature:
    name = "SUCRe on the GPU"
    gpu = provenance.gpu()
    if gpu is None:
        return Feature(name, "absent", "no GPU here, or no driver (nvidia-smi)")
    feature = _packages(name, "missing", "torch")
    if feature.state == "missing":
        return feature
    version = version_of("torch") or ""
    if "+cpu" in version:
        wanted = f"torch=={version.partition('+')[0]}"
        remedy = _in_this_python(f"pip install --force-reinstall {wanted}")
        return Feature(name, "broken", f"torch {version} is built for CPUs alone", remedy)
    works = False
    with contextlib.suppress(ImportError, OSError):  # of a damaged installation
        import torch

        works = torch.cuda.is_available()
    if not works:
        return Feature(name, "broken", f"torch {version} cannot use the {gpu}", "nvidia-smi")
    return Feature(name, "ready", f"torch {version} on {gpu}")


def _plugins() -> Feature:
    """All plugins as one feature, naming those that cannot be used."""
    counts = []
    faults = []
    for kind in plugins.KINDS:
        known = plugins.discover(kind).values()
        counts.append(f"{len(known)} {kind}s")
        broken = [plugin for plugin in known if isinstance(plugin, Broken)]
        faults += [f"{kind} {plugin.name}: {plugin.reason}" for plugin in broken]
    if faults:
        return Feature("plugins", "broken", "; ".join(faults))
    return Feature("plugins", "ready", ", ".join(counts))


def _libraries() -> list[Feature]:
    """The libraries of the system that Open3D lacks, where it is installed."""
    if absent("open3d"):
        return []
    packages = []
    for library, package in OPEN3D_LIBRARIES.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            packages.append(package)
    if not packages:
        return []
    remedy = f"sudo apt-get install {' '.join(packages)}"
    return [
        Feature("libraries of open3d", "broken", "open3d lacks libraries of the system", remedy)
    ]


def _in_this_python(pip: str) -> str:
    return f"{shlex.quote(sys.executable)} -m {pip}"
