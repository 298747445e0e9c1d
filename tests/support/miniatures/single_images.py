"""Folders of images in miniature, as the datasets of single images have them."""

from __future__ import annotations

from pathlib import Path

from support.colmap_folder import picture, write_image


def write_images(folder: Path, *names: str, seed: int = 0) -> Path:
    for number, name in enumerate(names):
        write_image(folder / name, picture(seed + number))
    return folder
