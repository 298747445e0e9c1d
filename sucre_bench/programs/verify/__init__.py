"""Checks somebody else's bundle: its hashes, its data, and its scores, computed again from its pictures.

In: a bundle, see `sucre_bench.results.bundle_format`, and the data if they are here. Out: `Outcome`.
Metrics and datasets are those registered here. Nothing of the bundle is executed or unpacked onto the disk.
"""

# The allowed difference as a share of a score. Scores were computed before pictures were rounded.
TOLERANCE = 0.001
