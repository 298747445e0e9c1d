"""Colour charts: their kinds, their orientation, and how patches are measured."""
