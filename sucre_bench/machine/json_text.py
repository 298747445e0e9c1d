"""JSON text: NaN and infinity become null."""

import json
import math
from collections.abc import Mapping
from typing import Any


def json_text(value: Any) -> str:
    """Return a value as indented JSON, with null for NaN and infinity."""
    return json.dumps(plain(value), indent=1)


def plain(value: Any) -> Any:
    """Return a value with lists for tuples, and None for numbers that JSON does not have.

    >>> plain({"low": float("nan"), "of": (1, 2.5)})
    {'low': None, 'of': [1, 2.5]}
    """
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
