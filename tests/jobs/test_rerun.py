from __future__ import annotations

import shlex

import pytest

from sucre_bench.jobs.words import shell


@pytest.mark.parametrize(
    "words",
    [
        ["run", "views=['34.png']"],
        ["views=['a b.png']", "out=my results"],
        ["views=['$HOME.png']", "views=['`ls`']", "views=['a\\b']", "views=['a\"b!']"],
        ["", "'", '"', "method=sucre"],
    ],
)
def test_a_shell_reads_the_words_back(words: list[str]):
    assert shlex.split(shell(words)) == words


def test_a_quoted_name_stays_readable():
    assert shell(["views=['34.png']"]) == "\"views=['34.png']\""
