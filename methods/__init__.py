"""Restoration methods, one file or folder each."""
