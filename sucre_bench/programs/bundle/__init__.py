"""Writes a results folder as one file: scores, configuration, hashes, and pictures if requested.

In: a results folder. Out: a bundle, see `sucre_bench.results.bundle_format`.
"""
