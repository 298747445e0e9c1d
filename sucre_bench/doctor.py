"""What this machine has, what it lacks, and what that disables."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import click

from sucre_bench import plugins, provenance
from sucre_bench.plugins import Broken

__all__ = ["OPEN3D_LIBRARIES", "show"]

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

_PURPOSE = {
    "jax": "restorers that run on JAX",
    "mlflow": "logging to mlflow",
    "numba": "SUCRe, pairing",
    "onnxruntime": "networks from ONNX files",
    "open3d": "the demo scene (ray casting)",
    "pycolmap": "structure from motion",
    "torch": "restorers that run on torch, SUCRe among them",
    "colour-science": "colour differences on charts",
}


def show() -> int:
    """Print the state of this installation; return 0 when nothing is missing, else 1."""
    faults = 0
    click.echo(
        f"sucre_bench {provenance.version_of('sucre-bench')} on Python {platform.python_version()}, {sys.prefix}"
    )
    commit, dirty = provenance.source_commit()
    if commit:
        click.echo(f"source      {commit[:12]}{' with uncommitted changes' if dirty else ''}")
    for name in provenance.PACKAGES:
        version = provenance.version_of(name)
        without = _PURPOSE.get(name)
        faults += _line(name, version, f"pip install {name}" + (f"; without it: no {without}" if without else ""))
    broken = _open3d_fault()
    faults += _line("open3d runs", None if broken else "yes", broken)
    gpu = provenance.gpu()
    click.echo(f"{'gpu':24}{gpu or 'none: torch and JAX run on the CPU'}")
    if gpu and "+cpu" in (provenance.version_of("torch") or ""):
        faults += _line("torch for the GPU", None, f"pip install --force-reinstall {_torch()}; this build is CPU only")
    faults += _line("git", shutil.which("git"), "apt-get install git; without it: no commit in the provenance")
    for kind in plugins.KINDS:
        known = plugins.discover(kind).values()
        bad = [p for p in known if isinstance(p, Broken)]
        absent = [p for p in known if not isinstance(p, Broken) and plugins.missing_packages(p)]
        click.echo(f"{kind + 's':24}{len(known) - len(bad) - len(absent)} ready")
        reasons = [(p.name, p.reason) for p in bad] + [(p.name, plugins.missing_packages(p)) for p in absent]
        faults += sum(_line(f"  {name}", None, reason) for name, reason in reasons)
    click.echo("everything is there" if not faults else f"{faults} to mend")
    return 1 if faults else 0


def _torch() -> str:
    return f"torch=={(provenance.version_of('torch') or '').partition('+')[0]}"


def _line(name: str, found: str | None, remedy: str) -> int:
    """Print one line; return how many faults it is."""
    click.echo(f"{name:24}", nl=False)
    plain = found is not None or "NO_COLOR" in os.environ
    click.secho(found or f"missing: {remedy}", fg=None if plain else "red")
    return 0 if found else 1


def _open3d_fault() -> str:
    """Why open3d does not import, with the line that mends it; tried in a process of its own, for it may crash."""
    if provenance.version_of("open3d") is None:
        return "pip install open3d"
    tried = subprocess.run([sys.executable, "-c", "import open3d"], capture_output=True, text=True, check=False)
    if tried.returncode == 0:
        return ""
    absent = [package for library, package in OPEN3D_LIBRARIES.items() if not _has(library)]
    if absent:
        return f"sudo apt-get install {' '.join(absent)}; without it: no demo scene"
    why = tried.stderr.strip().splitlines()[-1] if tried.stderr else f"exit code {tried.returncode}"
    return f"python -c 'import open3d' fails: {why}"


def _has(library: str) -> bool:
    folders = ["/lib", "/usr/lib", *(str(p) for p in Path("/usr/lib").glob("*-linux-gnu")), "/usr/lib64"]
    return any((Path(folder) / library).exists() for folder in folders)
