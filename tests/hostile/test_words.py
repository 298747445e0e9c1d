"""Made-up words after `sucre-bench run`: they make jobs, or are refused in one line that names a word."""

import os

from hypothesis import HealthCheck, example, given, settings, strategies as st

from sucre_bench.errors import SucreBenchError
from sucre_bench.jobs import compose_jobs

EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "0"))


def listed(text: str) -> list[str]:
    return text.split()


KEYS = listed("""
method dataset metrics views every first out seed overwrite save degrade.noise method.display method.label dataset.root
shard.index shard.count replicate baseline plugins tracking.uri image_scale view_timeout_s cache_gb study.name
hydra.launcher hydra/launcher
""")
VALUES = listed(r"""
null gray_world sucre,mlle [a.png] [[]] [[coverage]] {a:1} -1 1e999 nan ' " ${out} ${oc.env:NOWHERE} range(3)
choice(1,2) a=b \ true 0x10 ~ @
""")
VALUES += ["", "\x1b[2J", "\u202e", "a\nb"]
texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="/"), max_size=8)
values = st.sampled_from(VALUES) | texts | st.integers().map(str) | st.floats().map(str)
keys = st.sampled_from(KEYS) | texts
words = (
    st.builds("{}{}={}".format, st.sampled_from(["", "", "", "+", "++", "~"]), keys, values)
    | texts
)


@settings(
    max_examples=EXAMPLES // 10 or 20,
    derandomize=not EXAMPLES,
    print_blob=True,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
@given(made=st.lists(words, min_size=1, max_size=3), is_sweep=st.booleans())
@example(made=["metrics=[[coverage]]"], is_sweep=False)
@example(made=["dataset=[[demo]]"], is_sweep=False)
@example(made=["method={a: 1}"], is_sweep=True)
def test_made_up_words_are_refused_in_one_line(made: list[str], is_sweep: bool):
    said = ""
    try:
        compose_jobs.jobs(["method=gray_world", *made], is_sweep)
    except SucreBenchError as fault:
        said = str(fault)
    assert len(said.splitlines()) <= 1
    assert len(said) < 3000
