"""A typical mistake with each command, word for word: golden_errors/<command>.txt holds its error line.

After a change that is meant, write the files anew: `GOLDEN=write python -m pytest tests/commands/test_errors.py`.
"""

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from support.command_line import Done, commands

GOLDEN = Path(__file__).with_name("golden_errors")
MISTAKES = {
    "run": ["method=grey_world"],
    "lineup": ["nowhere"],
    "compare": ["nowhere"],
    "score": [".", "--metrics", "uicqe"],
    "prepare": ["nowhere", "out"],
    "restore": ["nowhere", "out"],
    "describe": ["dataset=colmap", "dataset.root=nowhere"],
    "charts": ["dataset=demo", "--kind", "dkg"],
    "report": ["nowhere"],
    "texture": ["nowhere", "out.ply", "--method", "sucre"],
    "video": ["nowhere", "dive.avi", "--methods", "sucre"],
    "track": ["nowhere"],
    "bundle": ["nowhere", "paper.zip"],
    "verify": ["nowhere.zip"],
    "site": ["nowhere", "public"],
    "study": ["nowhere", "--methods", "sucre,gray_world", "--out", "study.html"],
    "list": ["plugins"],
    "new": ["method", "my-method"],
    "check": ["gray_wrld"],
    "gallery": ["nowhere", "out"],
    "doctor": ["--jsn"],
    "completion": ["powershell"],
}


def test_every_command_has_a_mistake() -> None:
    assert set(MISTAKES) == set(commands())


@pytest.mark.parametrize("command", MISTAKES)
def test_a_mistake_is_answered_in_one_line_on_stderr(command: str, bench: Callable[..., Done]) -> None:
    done = bench(command, *MISTAKES[command])
    file = GOLDEN / f"{command}.txt"
    said = re.sub(
        r"; known: .*|(did you mean '\w+')\? known: (?:\w+, ){9}.*", r"\1", done.stderr
    )  # not of every plugin
    if os.environ.get("GOLDEN") == "write":
        file.write_text(said, encoding="utf-8")
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.errors) == 1
    assert said == file.read_text(encoding="utf-8")
