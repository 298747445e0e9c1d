"""The line-up that docs/run.md shows, as the files that documented commands name."""

from __future__ import annotations

import re
from pathlib import Path

from support.places import ROOT


def write_line_ups(folder: Path) -> None:
    """Write the documented line-up by the names that examples give it."""
    text = (ROOT / "docs" / "run.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"^```yaml\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    for name in ("lineup.yaml", "paper.yaml"):
        (folder / name).write_text(shown, encoding="utf-8")
