"""Imports pycolmap; no other module does."""

from types import ModuleType

from sucre_bench.errors import InputError


def load_pycolmap() -> ModuleType:
    """Return pycolmap with its log switched off. Raises InputError if it is too old."""
    # pycolmap's wheel has its own zlib, png and jpeg. If it were the first to load them, writing a PNG later
    # would abort the process.
    import zlib  # noqa: F401

    import cv2  # noqa: F401
    import pycolmap

    if not hasattr(pycolmap.Database, "num_verified_image_pairs") or not hasattr(pycolmap, "FeatureExtractionOptions"):
        fault = f"is {pycolmap.__version__}, too old to prepare photos"
        raise InputError(f"pycolmap: {fault}; run pip install 'pycolmap>=4.0'")
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    return pycolmap
