from __future__ import annotations

import pytest

from sucre_bench import plugins
from sucre_bench.errors import Death, DiedError, Lack, PluginError, one_line
from sucre_bench.results import Reason, brief, with_remedy
from sucre_bench.results.reasons import without_view


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


@pytest.mark.parametrize("text", ["a.png has no depth map", "a.png: has no depth map", "has no depth map"])
def test_views_with_one_reason_count_together(text: str):
    assert without_view(text, "a.png") == "has no depth map"
    assert without_view(text, "") == text


def test_a_number_that_a_view_is_named_like_stays_in_its_reason():
    near = "1.5 m is too near"
    assert without_view(near, "1") == near


def test_who_lacks_depth_or_poses_is_told_the_command_that_makes_them():
    method = plugins.find("method", "sucre")
    assert "sucre-bench prepare" in with_remedy(plugins.missing_needs(method, frozenset({"poses"})))
    charts = plugins.missing_needs(plugins.find("metric", "psi"), frozenset())
    assert with_remedy(charts) == charts


@pytest.mark.parametrize("how", ["signal 9, perhaps for want of memory", "exit code 7", "3 times, unseen"])
@pytest.mark.parametrize("step", ["method 'a' on view 'dive/b; c (1).png'", "the start of method 'x'"])
def test_how_a_process_died_and_where_is_read_back_from_the_text_of_a_row(how: str, step: str):
    text = one_line(DiedError(str(Death(how, step))))
    assert Death.read(text) == Death(how, step)
    assert Reason.of(text) is Reason.DIED


def test_a_methods_own_words_about_a_death_are_no_death():
    text = one_line(PluginError("the process died (signal 9) in my own child"))
    assert Death.read(text) is None
    assert Reason.of(text) is Reason.OTHER
