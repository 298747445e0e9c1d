"""The plugin kit: templates for a method, a dataset or a metric of one's own, and the contract that every one keeps.

`sucre-bench new` writes them, `sucre-bench check` runs the contract. A plugin's own test does it in a line:

    assert not breaches("method", "my_method")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sucre_bench.programs.contract.contract import Finding, Outcome, Rule, Subject, breaches, check, rules

__all__ = ["Finding", "Outcome", "Rule", "Subject", "breaches", "check", "rules"]


def __getattr__(name: str) -> Any:
    """Import when asked for: the command line brings this package with every command."""
    if name not in __all__:
        raise AttributeError(f"module 'sucre_bench.programs.contract' has no attribute '{name}'")
    return getattr(import_module("sucre_bench.programs.contract.contract"), name)
