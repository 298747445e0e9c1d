"""The built-in dataset: a made underwater scene with known truth, made once and stored in the cache folder."""

from sucre_bench.datasets.demo.demo import Demo

__all__ = ["Demo"]
