"""The documentation: its commands exist with their options, its links lead somewhere, nothing is left to fill in."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from sucre_bench import config
from sucre_bench.cli import cli

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
PLUGINS_OF_EXAMPLES = ("halve_blue", "known_water")  # made by their pages, and run by other tests


def commands() -> list[str]:
    """Every sucre-bench command line, continued lines joined."""
    found: list[str] = []
    for page in PAGES:
        text = re.sub(r"\\\n\s*", "", page.read_text(encoding="utf-8"))
        found += [line.strip() for line in text.splitlines() if line.strip().startswith("sucre-bench ")]
    return sorted(set(found))


@pytest.mark.parametrize("line", [c for c in commands() if not any(p in c for p in PLUGINS_OF_EXAMPLES)])
def test_a_documented_command_exists_with_its_options(line: str):
    words = shlex.split(line.split("  #")[0])[1:]
    command = cli.commands[words[0]]
    if words[0] == "run":
        overrides = [word for word in words[1:] if not word.startswith("-")]
        assert config.jobs(overrides, multirun="-m" in words).jobs
    else:
        known = {option for p in command.params for option in (*p.opts, *p.secondary_opts)}
        assert {word.split("=")[0] for word in words[1:] if word.startswith("--")} <= known


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere_and_nothing_is_left_to_fill_in(page: Path):
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        assert (page.parent / target).exists(), target
    assert "@@" not in text
    assert "TODO" not in text


def test_every_page_is_reached_from_the_readme():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for page in (ROOT / "docs").glob("*.md"):
        assert f"docs/{page.name}" in text, page.name
