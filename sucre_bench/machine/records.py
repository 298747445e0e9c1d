"""The records of restored images: what the method said of each, the water for example.

A record is a .json beside the restored image. Other programs may write one there, too.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sucre_bench.machine.files import read_json


def record_of(file: Path) -> dict[str, Any]:
    """Return the record of a restored image, or of a file beside it that differs in its suffix; empty if none is there.

    Raises InputError if it is damaged.
    """
    content = read_json(file.with_suffix(".json"), "delete it and run again")
    return content if isinstance(content, dict) else {}
