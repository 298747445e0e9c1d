from __future__ import annotations

import pytest

from sucre_bench import plugins
from sucre_bench.errors import Lack
from sucre_bench.results import Reason, brief, with_remedy


@pytest.mark.parametrize("has", [frozenset(), frozenset({"depth"}), frozenset({"charts", "poses"})])
def test_what_a_scene_lacks_is_read_back_from_the_text_of_a_row(has: frozenset[str]):
    text = plugins.missing_needs(plugins.find("method", "sucre"), has, "view")
    assert Lack.read(text) == Lack(tuple(sorted({"depth", "poses"} - has)), tuple(sorted(has)), "view")
    assert Reason.of(text) is Reason.LACK


def test_scenes_that_lack_the_same_have_one_brief_reason():
    method = plugins.find("method", "sucre")
    texts = {plugins.missing_needs(method, frozenset({"poses", *more})) for more in ((), ("charts",))}
    assert len(texts) == 2
    assert {brief(text) for text in texts} == {"needs depth"}


def test_a_reason_of_a_methods_own_words_is_kept_whole():
    text = "too dark, nothing to score in this view"
    assert Reason.of(text) is Reason.OTHER
    assert brief(text) == text


def test_who_lacks_depth_or_poses_is_told_the_command_that_makes_them():
    method = plugins.find("method", "sucre")
    assert "sucre-bench prepare" in with_remedy(plugins.missing_needs(method, frozenset({"poses"})))
    charts = plugins.missing_needs(plugins.find("metric", "psi"), frozenset())
    assert with_remedy(charts) == charts
