"""The option `image_scale` of datasets: its range."""

from __future__ import annotations

from sucre_bench.errors import InputError

__all__ = ["check_scale"]


def check_scale(dataset: str, image_scale: float) -> None:
    """Raise InputError unless a dataset's option image_scale is above 0 up to 1."""
    if not 0 < image_scale <= 1:
        raise InputError(f"{dataset}.image_scale: {image_scale} is not above 0 up to 1; give 0.5 for half size")
