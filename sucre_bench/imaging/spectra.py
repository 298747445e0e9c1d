"""Colours of measured reflectances: what an eye, and a camera, sees of a surface under an illuminant.

Spectra are brought to every nanometre from 400 to 700 by straight lines. The eye is CIE's 1931 2 degree observer. Both
its white and the camera's is a perfect diffuser under the same illuminant. The functions of the observer and of CIE's
illuminants are those that colour-science has.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.imaging.cielab import colour_science, lab_d50_of_xyz, srgb_of_lab_d50
from sucre_bench.imaging.encoding import srgb_encode
from sucre_bench.machine.files import reading, regular

_NM = np.arange(400.0, 701.0)


def on_grid(place: str, nm: Array, values: Array) -> Array:
    """Return spectra (..., W) at wavelengths (W,) nm, at 400, 401, ... 700 nm. InputError where they do not reach."""
    order = np.argsort(nm)
    if len(nm) < 2 or nm.min() > _NM[0] or nm.max() < _NM[-1]:
        reach = f"{nm.min():g} to {nm.max():g} nm" if len(nm) else "nothing"
        raise InputError(f"{place}: covers {reach}; give wavelengths from 400 to 700 nm")
    return np.asarray(
        np.apply_along_axis(lambda of_one: np.interp(_NM, nm[order], of_one[order]), -1, values)
    )


def colours(
    reflectance: Array, illuminant: str, camera: str | None, folder: Path
) -> tuple[Array, Array]:
    """Return CIE Lab under D50 (P, 3), and gamma-encoded sRGB (P, 3) clipped to [0, 1], of reflectances (P, 301).

    illuminant: one of CIE's, or a CSV file with the columns wavelength (nm) and power (any unit); camera: None for
    colours as the eye sees them, or a CSV file with the columns wavelength, R, G, B of a camera's responses, for its
    white-balanced linear channels, then encoded; folder: where the paths of files start.
    Raises InputError for an unknown illuminant, and for a file that is not such a table or does not reach 400 to 700.
    """
    light = _illuminant(illuminant, folder)
    observer = colour_science().MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    sight = on_grid("observer", observer.wavelengths, observer.values.T) * light
    lab = lab_d50_of_xyz(
        reflectance @ sight.T / sight[1].sum(), sight.sum(axis=1) / sight[1].sum()
    )
    if camera is None:
        return lab, srgb_of_lab_d50(lab)
    responses = _table(folder / camera, 3) * light
    return lab, srgb_encode((reflectance @ responses.T / responses.sum(axis=1)).clip(0, 1))


def _illuminant(name: str, folder: Path) -> Array:
    if name.lower().endswith(".csv"):
        return _table(folder / name, 1)[0]
    known = colour_science().SDS_ILLUMINANTS
    if name not in known:
        usual = did_you_mean(name, ("A", "C", "D50", "D55", "D65", "E"))
        raise InputError(
            f"illuminant '{name}': unknown; {usual}, or a CSV file of wavelength,power"
        )
    return on_grid(name, known[name].wavelengths, known[name].values)


def _table(path: Path, columns: int) -> Array:
    """Read spectra (columns, 301) from a CSV file: a line of names, then wavelength and values."""
    with reading(path, "correct the path or the table of spectra"):
        rows = list(csv.reader(regular(path).read_text(encoding="utf-8-sig").splitlines()))[1:]
        table = np.array([row for row in rows if row], dtype=np.float64)
    if (
        table.ndim != 2
        or table.shape[1] != 1 + columns
        or not np.isfinite(table).all()
        or (table[:, 1:] < 0).any()
    ):
        wanted = "wavelength,power" if columns == 1 else "wavelength,R,G,B"
        raise InputError(
            f"{path}: not the columns {wanted} of finite values from 0; write the file so"
        )
    return on_grid(str(path), table[:, 0], table[:, 1:].T)
