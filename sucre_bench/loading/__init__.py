"""Reads the files of datasets: images, depth maps, cameras, lenses, charts; pixels are decoded when first used."""
