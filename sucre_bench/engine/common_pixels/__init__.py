"""Scores on common pixels: the pixels of a view that all methods fill. The choice of pixels is `compare/pixels.py`."""
