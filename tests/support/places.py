"""Where the repository lies, the toy plugins, and the data that some tests read where they are at hand."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TOYS = Path(__file__).with_name("toy_plugins.py")


def _data() -> Path:
    """The folder shared/data in the checkout, beside it, or beside a folder above it."""
    beside = [folder / "shared" / "data" for folder in (ROOT, *ROOT.parents)]
    return next((folder for folder in beside if folder.is_dir()), beside[1])


DATA = _data()


def write_line_ups(folder: Path) -> None:
    """Write the first documented line-up by the names that examples give it."""
    text = (ROOT / "docs" / "run.md").read_text(encoding="utf-8")
    shown, *_ = re.findall(r"^```yaml\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    for name in ("lineup.yaml", "paper.yaml"):
        (folder / name).write_text(shown, encoding="utf-8")
