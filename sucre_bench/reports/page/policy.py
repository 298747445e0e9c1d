"""The page's Content-Security-Policy: no connections, and only its own scripts and styles, by their hashes."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable


def policy(scripts: Iterable[str], styles: Iterable[str]) -> str:
    """Return the policy of a page with these scripts and style sheets, each the exact text of its element."""
    return "; ".join(
        [
            "default-src 'none'",
            "img-src 'self' file: data: blob:",
            f"style-src {_hashes(styles)} {_hashes([''])}",  # Plotly adds an empty sheet, and fills it by rules
            f"script-src {_hashes(scripts)}",
        ]
    )


def _hashes(texts: Iterable[str]) -> str:
    digests = (hashlib.sha256(text.encode()).digest() for text in texts)
    return " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
