"""Words that are written: what Hydra's own grammar reads back, and what a shell reads back."""

import itertools
import shlex

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from sucre_bench.jobs.words import quoted, shell, value_of

LETTERS = "\\'$ {}a1."
TEXTS = ["true", "Null", "nan", "inf", "5", ".5", ".5e-3", "1e-3", "C:\\dive\\", "${out}", "a,b", "~/dive", "ünï", ""]


def test_any_text_is_read_back_as_the_same_text():
    parser = OverridesParser.create()
    short = ("".join(letters) for length in (1, 2, 3) for letters in itertools.product(LETTERS, repeat=length))
    for text in [*TEXTS, *short]:
        read = parser.parse_override(f"key={quoted(text)}").value()
        assert isinstance(read, str), text
        assert OmegaConf.create({"key": str(read), "out": "other"}).key == text


@pytest.mark.parametrize("value", [None, True, 5, 0.25, "null", ["a", "true", 1], {"a_b": [1, None]}])
def test_any_value_of_an_option_is_read_back(value: object):
    read = OverridesParser.create().parse_override(f"key={value_of(value)}").value()
    assert OmegaConf.to_container(OmegaConf.create({"key": read})) == {"key": value}


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
