"""Reads arrays in .npy and .npz files. It reads the header first, so that a false size allocates no memory."""

import math
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import IO

import numpy as np

from sucre_bench.errors import ANY_FAULT, DamagedFileError, SucreBenchError, file_error, one_line
from sucre_bench.imaging.pixel_limit import check_array
from sucre_bench.machine.files import regular


def read_array(path: Path, choose: Callable[[list[str]], str] | None = None) -> np.ndarray:
    """Return the array of an .npy, or with `choose` that of an .npz whose name it returns, of all names there.

    Raises FileError if it cannot be read, DamagedFileError if it is not whole, and InputError if it has too many
    values, see `pixel_limit`.
    """
    try:
        with regular(path).open("rb") as file:
            if not zipfile.is_zipfile(file):
                file.seek(0)
                return _checked(path, file, path.stat().st_size)
            if choose is None:
                raise ValueError("an archive, not an array")
            with zipfile.ZipFile(file) as archive:
                names = [name.removesuffix(".npy") for name in archive.namelist()]
                member = f"{choose(names)}.npy"
                with archive.open(member) as content:
                    return _checked(path, content, archive.getinfo(member).file_size)
    except SucreBenchError:
        raise
    except ANY_FAULT as fault:  # unpacking damaged bytes raises errors of many kinds
        remedy = "write it again with numpy.save"
        if isinstance(fault, OSError):
            raise file_error(path, fault, remedy) from fault
        raise DamagedFileError(f"cannot be read, {one_line(fault)}", path, remedy) from fault


def _checked(path: Path, file: IO[bytes], size: int) -> np.ndarray:
    """Read an array from a file of `size` bytes, its header first."""
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    version = np.lib.format.read_magic(file)
    shape, fortran, dtype = read.get(version, np.lib.format.read_array_header_2_0)(file)
    n_bytes = math.prod(shape) * dtype.itemsize
    if dtype.hasobject or n_bytes > size:
        raise ValueError("cut short or not an array of numbers")
    check_array(path, shape)
    content = file.read(n_bytes)
    if len(content) < n_bytes:
        raise ValueError("cut short")
    values = np.frombuffer(content, dtype).copy()
    return values.reshape(shape[::-1]).T if fortran else values.reshape(shape)
