"""The contract that every plugin keeps, and templates for a plugin of your own.

`sucre-bench new` writes a template, `sucre-bench check` tests a plugin against the contract. A plugin's own test does
the same in a line: ``assert not sucre_bench.breaches("method", "my_method")``.
"""

from sucre_bench.programs.contract.contract import breaches

__all__ = ["breaches"]
