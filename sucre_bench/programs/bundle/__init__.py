"""Writes a results folder as one file that travels: scores, configuration, hashes, and pictures if asked for.

In: a results folder. Out: a bundle, see `sucre_bench.results.bundle_format`.
"""
