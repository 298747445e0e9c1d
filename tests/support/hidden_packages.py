"""Packages that seem not to be installed."""

import importlib.util

import pytest

EXTRAS = ("mlflow", "torch", "jax", "open3d", "pycolmap", "onnxruntime", "colour", "mkdocs")


def hide(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Let Python find none of these packages, by import name, for the time of a test.

    names: by default those whose imports take seconds, for tests of `doctor`, which imports what there is.
    """
    names = names or EXTRAS
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name in names else find_spec(name))
