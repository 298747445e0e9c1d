"""The two passes over all observations that the solvers need, for several array libraries."""

from sucre_bench.methods.sucre.kernels.kernel import Kernel, opened

__all__ = ["Kernel", "opened"]
