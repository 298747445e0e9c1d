"""Every option and method that a hint of SUCRe's family names exists: what a user copies is accepted."""

import re
from pathlib import Path

import numpy as np
import pytest

from sucre_bench.engine.preflight import check
from sucre_bench.jobs.catalogue import method_choice
from sucre_bench.jobs.compose_jobs import jobs
from sucre_bench.methods.sucre import record

SOURCES = "".join(file.read_text() for file in sorted(Path(record.__file__).parent.glob("*.py")))
WORDS = sorted(set(re.findall(r"\bmethod\.[a-z_]+=[\w.-]+\b|\bmethod=[a-z]\w+", SOURCES)))
WORDS = [word for word in WORDS if not word.endswith(("FILE", "FOLDER"))]
FAMILY = ["sucre", "sucre_plus", "sucre_paper", "sucre_exact"]


def test_there_are_hints() -> None:
    assert {"method=dive_gray_world", "method.light=even"} <= set(WORDS)


@pytest.mark.parametrize("word", WORDS)
def test_a_word_in_a_hint_is_accepted(word: str) -> None:
    assert jobs(["dataset=demo", "method=sucre", word], multirun=False).jobs


@pytest.mark.parametrize("name", FAMILY)
def test_hints_about_colours_name_options_of_their_method(name: str) -> None:
    many = np.ones(3)
    for text in record.faults_of_colours(many, many, method_choice(name, {}).make()):
        for word in re.findall(r"\bmethod[.=]\S+", text):
            command = jobs(["dataset=demo", f"method={name}", word], multirun=False)
            assert command.jobs[0].method != jobs(["dataset=demo", f"method={name}"], multirun=False).jobs[0].method
            check(command)


def test_negative_colours_of_the_paper_name_a_method() -> None:
    (first, *_) = record.faults_of_colours(np.ones(3), np.zeros(3), method_choice("sucre_paper", {}).make())
    assert "method=sucre_plus" in first
