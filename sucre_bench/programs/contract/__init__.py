"""The contract that every plugin keeps, and templates for a plugin of your own.

`sucre-bench new` writes a template, `sucre-bench check` tests a plugin against the contract. A plugin's own test does
the same in a line: ``assert not sucre_bench.breaches("method", "my_method")``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sucre_bench.programs.contract.contract import Finding, Outcome, Rule, Subject, breaches, check, rules

__all__ = ["Finding", "Outcome", "Rule", "Subject", "breaches", "check", "rules"]


def __getattr__(name: str) -> Any:
    """Import a name when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module 'sucre_bench.programs.contract' has no attribute '{name}'")
    return getattr(import_module("sucre_bench.programs.contract.contract"), name)
