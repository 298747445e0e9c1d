"""Makes the package's description of README.md: outside the repository its links and pictures need whole addresses."""

import re
import tomllib
from pathlib import Path

from setuptools import setup

HERE = Path(__file__).parent
PROJECT = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def address(match: re.Match[str]) -> str:
    """Return a link of the README with the address of its file in the repository; a picture with that of its bytes."""
    kind = "raw" if match[1].startswith("!") else "blob"
    return f"{match[1]}({PROJECT['urls']['Source']}/{kind}/v{PROJECT['version']}/{match[2]})"


README = (HERE / "README.md").read_text(encoding="utf-8")
RELATIVE = re.compile(r"(!?\[[^\]]*\])\((?!https?:|#)([^)]+)\)")
setup(
    long_description=RELATIVE.sub(address, README),
    long_description_content_type="text/markdown",
)
