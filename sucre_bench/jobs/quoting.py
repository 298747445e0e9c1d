"""Writes values in Hydra's grammar."""

import re
from collections.abc import Mapping
from typing import Any

# Words that Hydra does not read as text, in any case.
_NO_TEXT = frozenset({"true", "false", "null", "nan", "inf"})


def quoted(text: str) -> str:
    """Return any text as the value of an override: bare if Hydra reads that as the same text, else in quotes.

    Backslashes are doubled right before a quote, and before ``${``, which is escaped: it would be interpolated. All
    others are read as they are.
    """
    is_number = re.fullmatch(r"\.[\d_]+(e[+-]?\d+)?", text, re.IGNORECASE)
    if re.fullmatch(r"[A-Za-z_./][\w./-]*", text, re.ASCII) and text.lower() not in _NO_TEXT and not is_number:
        return text
    literal = re.sub(r"(\\*)\$\{", lambda found: found[1] * 2 + r"\${", text)
    return "'" + re.sub(r"(\\*)('|$)", lambda found: found[1] * 2 + (r"\'" if found[2] else ""), literal) + "'"


def value_of(value: Any) -> str:
    """Return a value, of an option as rows keep it, as Hydra reads it back."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return f"[{','.join(map(value_of, value))}]"
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{k}:{value_of(v)}" for k, v in value.items()) + "}"
    return quoted(value) if isinstance(value, str) else repr(value)
