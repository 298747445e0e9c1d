"""docs/json.md has the keys that `--json` prints, and no others."""

import json
import re

import pytest
from support.hidden_packages import hide
from support.places import ROOT


def documented(command: str) -> set[str]:
    """The keys in the first column of a command's table."""
    text = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    section = text.split(f"### `{command} --json`\n")[1].split("\n### ")[0]
    cells = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    return {key for cell in cells for key in re.findall(r"`(\w+)`", cell)}


def test_every_key_is_documented(bench, monkeypatch: pytest.MonkeyPatch, small_demo: list[str]):
    hide(monkeypatch)
    words = [*small_demo, "method=gray_world", "tracking.uri=off"]
    commands = {
        "run": ["run", *words, "out=results"],
        "run --dry-run": ["run", *words, "out=results", "--dry-run"],
        "compare": ["compare", "results"],
        "score": ["score", "results/restored/demo/gray_world", "--metrics", "uciqe"],
        "list methods": ["list", "methods", "gray_world"],
        "doctor": ["doctor"],
        "describe": ["describe", *small_demo],
    }
    for name, arguments in commands.items():
        printed = json.loads(bench(*arguments, "--json").stdout)
        first = printed[0] if isinstance(printed, list) else printed
        assert (name, set(first)) == (name, documented(name))


def test_the_short_map_names_commands_and_pages_that_exist(bench):
    text = (ROOT / "docs" / "llms.txt").read_text(encoding="utf-8")
    for page in re.findall(r"\]\(([\w.]+)\)", text):
        assert (ROOT / "docs" / page).is_file() or page == "tutorial.md"
    for command in sorted(set(re.findall(r"`sucre-bench (\w+)", text))):
        assert bench(command, "--help").returncode == 0, command
