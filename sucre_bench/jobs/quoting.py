"""Text as Hydra's grammar quotes it."""

from __future__ import annotations

import re

__all__ = ["quoted"]


def quoted(text: str) -> str:
    """Return any text as the value of an override: as it is where Hydra takes it for itself, else in quotes."""
    if re.fullmatch(r"[A-Za-z_./][\w./-]*", text):
        return text
    escaped = text.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"
