"""Scores on common pixels: the pixels of a view that all methods fill; `compare/choose_pixels.py` uses them."""
