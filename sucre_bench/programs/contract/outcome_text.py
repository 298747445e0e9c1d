"""The outcome of a check as text, a line a rule with its remedies and the counts, or as plain data."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.text import Text

from sucre_bench.programs.contract.contract import Outcome, Status, Subject

_SIGNS: dict[Status, tuple[str, str]] = {
    "kept": ("✓", "green"),
    "broken": ("✗", "red"),
    "doubtful": ("!", "yellow"),
    "skipped": ("-", "dim"),
}
_COUNTED: dict[Status, str] = {
    "kept": "kept",
    "broken": "to mend",
    "doubtful": "to look at",
    "skipped": "not looked at",
}


def title(subject: Subject) -> Text:
    """Return the plugin's name and file."""
    plugin = subject.plugin
    return Text.assemble((f"{plugin.kind} {plugin.name}", "bold"), f"  {shown_path(subject.file)}")


def shown_path(path: Path) -> str:
    """Return a path relative to the current folder if it lies there."""
    full = Path.cwd() / path
    return str(full.relative_to(Path.cwd())) if full.is_relative_to(Path.cwd()) else str(full)


def lines(outcome: Outcome, encoding: str = "utf-8") -> list[Text]:
    """Return a rule's line and its findings. encoding: of the terminal."""
    sign, style = _SIGNS[outcome.status]
    sign = sign if encoding.lower().startswith("utf") else {"✓": "+", "✗": "x"}.get(sign, sign)
    notes = [finding.text for finding in outcome.findings if finding.level == "note"]
    said = f"  {'; '.join(notes)}" if notes and outcome.status != "broken" else ""
    said += f"  {outcome.skipped}" if outcome.skipped else ""
    head = Text.assemble((f"  {sign} ", style), str(outcome.rule), (said, "dim"))
    faults = [Text(f"      {f.text}", style) for f in outcome.findings if f.level != "note"]
    return [head, *faults]


def summary(outcomes: Sequence[Outcome]) -> Text:
    """Return the counts and the time."""
    counts = Counter(outcome.status for outcome in outcomes)
    parts = [(f"{counts[status]} {_COUNTED[status]}", _SIGNS[status][1]) for status in _SIGNS if counts[status]]
    text = Text(", ").join([Text(words, style) for words, style in parts])
    return Text.assemble("  ", text, f" in {sum(o.seconds for o in outcomes):.1f} s")


def as_object(subject: Subject, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return the outcome of a check as plain data for JSON."""
    return {
        "kind": subject.plugin.kind,
        "name": subject.plugin.name,
        "file": str(subject.file),
        "ok": not any(outcome.status == "broken" for outcome in outcomes),
        "rules": [
            {
                "name": outcome.rule.name,
                "rule": str(outcome.rule),
                "status": outcome.status,
                "seconds": round(outcome.seconds, 3),
                **({"skipped": outcome.skipped} if outcome.skipped else {}),
                "findings": [{"level": finding.level, "text": finding.text} for finding in outcome.findings],
            }
            for outcome in outcomes
        ],
    }
