import pytest

from sucre_bench import plugins
from sucre_bench.errors import DiedError, one_line
from sucre_bench.results import Reason, brief, with_remedy
from sucre_bench.results.reasons import without_view


@pytest.mark.parametrize("has", [frozenset(), frozenset({"depth"}), frozenset({"charts", "poses"})])
def test_a_lack_is_known_by_its_code_and_names_what_is_there(has: frozenset[str]):
    text = plugins.missing_needs(plugins.find("method", "sucre"), has, "view")
    assert Reason.of(text) is Reason.LACK
    assert brief(text) == f"needs {' and '.join(sorted({'depth', 'poses'} - has))}"
    assert text.endswith(f"the view has {', '.join(sorted(has)) or 'only images'}")


def test_a_lack_in_a_table_of_an_earlier_version_is_known():
    text = "needs charts, the scene has depth, poses"
    assert Reason.of(text) is Reason.LACK
    assert brief(text) == with_remedy(text).partition(", the ")[0] == "needs charts"


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


def test_a_death_is_known_by_its_code():
    assert Reason.of(one_line(DiedError("exit code 7", "method 'a' on view 'b (1).png'"))) is Reason.DIED
