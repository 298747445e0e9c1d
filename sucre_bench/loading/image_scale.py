"""The option `image_scale` of datasets: its range."""

from __future__ import annotations

from sucre_bench.errors import check_number

__all__ = ["check_scale"]


def check_scale(dataset: str, image_scale: float) -> None:
    """Raise InputError unless a dataset's option image_scale is above 0 up to 1."""
    check_number(f"{dataset}.image_scale", image_scale, "(0, 1]")
