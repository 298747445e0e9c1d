"""The page of a people's study in a real browser, judged by simulated observers whose preferences are known."""

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.browser import Browser
from support.command_line import registry, run, run_here, succeeded
from support.places import TOYS

from sucre_bench import plugins

STATE = "JSON.parse(Object.values(localStorage)[0])"
# log-odds, what observers prefer
SCORES = {
    "gain,gain=0.5": -2.5,
    "gain,gain=0.75": 0.0,
    "gain,gain=1.0": 2.5,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("study")
    with plugins.using(registry(TOYS)):
        run(place / "results", "dataset.views=12", "method.gain=0.5,0.75,1.0", multirun=True)
    asked = ("--methods", ",".join(SCORES), "--question", "<b>Better?</b>")
    succeeded(place, "study", "results", *asked, "--out", "study.html")
    return place


@pytest.fixture
def browser(chrome: Browser, folder: Path) -> Iterator[Browser]:
    """The page, as somebody sees it who never saw it before; it must not complain, nor ask for anything."""
    chrome.complaints.clear()
    seen_anew(chrome, folder, 0)
    yield chrome
    assert chrome.complaints == []


def seen_anew(browser: Browser, folder: Path, seed: int) -> None:
    """Open the page as another person, to whom it shows pairs as the seed has it."""
    browser.draws(seed)
    browser.open((folder / "study.html").as_uri())
    browser.ask("localStorage.clear()")
    browser.open((folder / "study.html").as_uri())


def whose(folder: Path) -> dict[str, str]:
    """The method of each picture, from the study's key."""
    (key,) = (folder / "results" / "people").glob("*.json")
    return {
        name: one["method"] for name, one in json.loads(key.read_text())["pictures"].items()
    }


def judge(
    browser: Browser, folder: Path, prefers: Callable[[str, str], str], pairs: int
) -> list[tuple[str, str]]:
    """Judge pairs with the keyboard; return the methods on the left and right. prefers: says the key of an answer."""
    methods, seen = whose(folder), []
    for n in range(pairs):
        current = browser.until(f"{STATE}.votes.length == {n} && {STATE}.current")
        seen.append((methods[current["left"]], methods[current["right"]]))
        browser.press(prefers(*seen[-1]))
    browser.until(f"{STATE}.votes.length == {pairs}")
    return seen


def observer(seed: int) -> Callable[[str, str], str]:
    """A person who follows Bradley and Terry, and says "equal" now and then."""
    rng = np.random.default_rng(seed)

    def answer(left: str, right: str) -> str:
        chance = 1 / (1 + math.exp(SCORES[right] - SCORES[left]))
        return (
            "ArrowDown"
            if rng.random() < 0.05
            else "ArrowLeft"
            if rng.random() < chance
            else "ArrowRight"
        )

    return answer


def test_six_observers_of_known_preference_give_the_right_order(
    browser: Browser, folder: Path, tmp_path: Path
):
    files = []
    for n in range(6):
        seen_anew(browser, folder, n)
        judge(browser, folder, observer(n), 20)
        browser.until("!document.getElementById('end').hidden")
        files.append(tmp_path / f"votes-{n}.json")
        browser.download("#save", files[-1])
    told = json.loads(
        run_here(folder, "study", "results", "--votes", *map(str, files), "--json").stdout
    )
    assert (told["votes"], told["observers"], told["skipped"]) == (120, 6, [])
    found = {one["method"]: one for one in told["preference"]}
    assert sorted(found, key=lambda name: found[name]["score"]) == list(SCORES)
    assert found["gain,gain=1.0"]["low"] > 0 > found["gain,gain=0.5"]["high"]
    assert told["agreement"]["n"] > 5, "several observers judged the same pairs"
    (redness,) = (
        m for m in told["metrics"] if m["metric"] == "redness"
    )  # grows with the gain, as these people's preference does
    assert redness["tau"] == 1
    assert redness["predicted"] > 0.7
    table = json.loads(
        run_here(folder, "compare", "results", "--metric", "preference", "--json").stdout
    )
    means = {record["method"]: record["mean"] for record in table}
    assert means == pytest.approx({name: one["score"] for name, one in found.items()}, abs=1e-6)


def test_the_page_names_nothing(browser: Browser, folder: Path):
    text = (folder / "study.html").read_text()
    without_pictures = re.sub(r'<script type="text/plain".*?</script>', "", text)
    for word in ("gain=", "v0", "toy", "redness"):
        assert word not in without_pictures, word
    browser.until("document.querySelector('#left img').naturalWidth > 0")
    assert browser.ask("document.querySelector('h1').textContent") == "<b>Better?</b>"
    assert browser.ask("document.querySelector('h1').children.length") == 0


def test_sides_and_order_are_random_and_close_methods_meet_most(browser: Browser, folder: Path):
    """Of two good methods and a bad one, votes on the good ones tell most."""
    rng = np.random.default_rng(0)
    bad = "gain,gain=0.5"

    def answer(left: str, right: str) -> str:
        if bad in (left, right):
            return "ArrowRight" if left == bad else "ArrowLeft"
        return str(rng.choice(["ArrowLeft", "ArrowRight"]))

    seen = judge(browser, folder, answer, 20)
    pairs = Counter(frozenset(pair) for pair in seen)
    close = pairs[frozenset(SCORES) - {bad}]
    assert close >= 8, "a third of 20 would be 7"
    assert set().union(*pairs) == set(SCORES)
    turned = sum(left < right for left, right in seen)
    assert 2 <= turned <= 18
    votes = browser.ask(f"{STATE}.votes")
    shown = [frozenset((vote["left"], vote["right"])) for vote in votes]
    assert len(set(shown)) == 20, "no pair of pictures twice"


def test_votes_outlive_the_page_and_can_be_undone(browser: Browser, folder: Path):
    judge(browser, folder, lambda left, right: "ArrowLeft", 3)
    browser.open((folder / "study.html").as_uri())
    browser.until("document.getElementById('progress').textContent.startsWith('Pair 4 of 20')")
    last: dict[str, Any] = browser.ask(f"{STATE}.votes[2]")
    browser.press("Backspace")
    assert browser.until(f"{STATE}.votes.length == 2 && {STATE}.current") == {
        k: last[k] for k in ("left", "right")
    }
    browser.click("#choose-tie")
    assert browser.until(f"{STATE}.votes.length == 3 && {STATE}.votes[2]")["choice"] == "tie"


def test_pictures_are_zoomed_in_step(browser: Browser, folder: Path):
    looks = "['left', 'right'].map((side) => document.querySelector(`#${side} img`).style.transform)"
    left, top, width, height = browser.place("#left")
    browser.wheel((left + width / 4, top + height / 4), -600)
    browser.until(f"{looks}[0].includes('scale') && !{looks}[0].includes('scale(1)')")
    zoomed = browser.ask(looks)
    browser.drag([(left + width / 2, top + height / 2), (left + width / 3, top + height / 3)])
    dragged = browser.ask(looks)
    assert zoomed[0] == zoomed[1] != dragged[0] == dragged[1]
    browser.press("0")
    assert "scale(1)" in browser.ask(looks)[1]
    browser.press("+")
    browser.press("ArrowLeft")
    browser.until(f"{STATE}.votes.length == 1")
    assert "scale(1)" in browser.ask(looks)[0], "the next pair is shown whole"
