"""PyTorch, imported when it is first used: each process that collects the tests would take two seconds longer."""

from typing import Any


def __getattr__(name: str) -> Any:
    if name.startswith(("_", "pytest")):  # what the search asks of everything in a file
        raise AttributeError(name)
    import torch

    return getattr(torch, name)
