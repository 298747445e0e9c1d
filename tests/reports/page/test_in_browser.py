"""The results page in a real browser, without a network: what one does with it, and what it says then."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
from support.browser import Browser
from support.made_results import DE00, PATCHES, PSNR, made_results

from sucre_bench.compare import compare
from sucre_bench.compare.words import number
from sucre_bench.reports import page as report
from sucre_bench.results.restorations import write_masked_png

HOSTILE = "</script><img src=x onerror=console.error('run')>"


def write_page(out: Path, rows: pd.DataFrame) -> Path:
    return report.write(out, rows, compare(rows))


SHEET = "#scores [data-dataset]:not([hidden]) [data-table]:not([hidden])"  # the table of scores that is shown
# of the pictures: larger than their thumbnails
WIDTH = 1000
HEIGHT = 500


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    rows = made_results(
        folder, datasets=("reef", "reef,noise=0.1", "reef,noise=0.2"), size=(WIDTH, HEIGHT)
    )
    np.savez(folder / "restored/reef/clever/v0.npz", confidence=np.ones((HEIGHT, WIDTH)) * 0.1)
    mask = np.ones((HEIGHT, WIDTH), np.bool_)
    # where the picture has colours, as if by fill=true
    mask[:, WIDTH // 2 : WIDTH * 3 // 4] = False
    path = folder / "restored/reef/clever/v1.png"
    write_masked_png(path, cv2.imread(str(path)), mask)
    write_page(folder, rows)
    return folder


@pytest.fixture
def page(chrome: Browser, out: Path) -> Iterator[Browser]:
    """The page, freshly opened; at the end it must not have complained of anything, nor asked for anything."""
    chrome.complaints.clear()
    chrome.size(1440, 900)
    chrome.prefer("light")
    opened(chrome, out)
    yield chrome
    assert chrome.complaints == []


def opened(browser: Browser, out: Path, place: str = "") -> None:
    browser.open(f"file://{out}/report/index.html{place}")
    browser.ask("localStorage.clear()")


def texts(page: Browser, selector: str) -> list[str]:
    found: list[str] = page.ask(
        f"[...document.querySelectorAll({json.dumps(selector)})].map((e) => e.innerText.trim())"
    )
    return found


def methods(page: Browser) -> list[str]:
    return texts(page, f"{SHEET} tbody th")


def transform(page: Browser, selector: str) -> list[float]:
    """Scale, and where the left top corner is, in widths and heights of the frame."""
    script = f"""(() => {{ const e = document.querySelector({json.dumps(selector)}), frame = e.parentElement;
        const m = new DOMMatrix(getComputedStyle(e).transform);
        return [m.a, m.e / frame.clientWidth, m.f / frame.clientHeight]; }})()"""
    page.ask("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    # it glides
    page.ask(
        "Promise.allSettled(document.getAnimations().map((one) => one.finished)).then(() => null)"
    )
    found: list[float] = page.ask(script)
    return found


def state(page: Browser, key: str) -> Any:
    return page.ask(f"resultsPage.state.{key}")


def test_an_opened_page_shows_the_best_method_and_its_commands_and_sorts_by_a_click_on_a_head(
    page: Browser,
):
    view = "v2.png"  # the median of the best method
    assert [state(page, key) for key in ("before", "method", "view")] == [
        "*view",
        "clever",
        view,
    ]
    cells = page.ask(
        f"[...document.querySelectorAll({json.dumps(SHEET + ' tbody tr')})].map((row) => row.cells[1])"
        ".map((cell) => [cell.className.trim(), cell.querySelector('.mean').innerText, cell.title])"
    )
    # over the two views that all have
    assert [cell[1] for cell in cells] == [
        "26.0",
        "21.0",
        "18.5",
    ]
    assert [cell[0] for cell in cells] == ["best", "second", ""]
    assert "95 % interval" in cells[0][2]
    # two views are too few
    assert page.ask("document.querySelectorAll('#scores .whisker').length") == 0
    assert "2 images" in texts(page, f"{SHEET} thead th")[1]
    said = texts(page, ".commands:not([hidden]) code")
    assert len(said) == len(methods(page))
    assert all("'views=[v0.png,v1.png,v2.png]' 'metrics=[psnr," in command for command in said)
    values = [
        sign * digits * 10.0**power
        for power in range(-7, 5)
        for digits in (1, 1.26, 9.4, 9.97)
        for sign in (1, -1)
    ]
    shown = page.ask(
        f"{json.dumps(values)}.map((value) => resultsPage.number(value).replaceAll('−', '-'))"
    )
    assert shown == [number(value) for value in values]
    assert page.ask("[0, null].map(resultsPage.number)") == ["0", "–"]
    head = f"{SHEET} [data-key='psnr:masked']"
    assert methods(page) == ["clever", "plain", "broken"]  # higher is better: best first
    assert page.ask(f'document.querySelector("{head}").ariaSort') == "descending"
    page.click(f"{head} button")
    assert methods(page) == ["broken", "plain", "clever"]
    page.click(f"{head} button")
    assert methods(page) == ["clever", "plain", "broken"]
    assert state(page, "metric") == "psnr:masked"


def test_metrics_that_only_describe_and_leads_within_chance_are_shown_when_asked_for(
    page: Browser,
):
    heads = f"[...document.querySelectorAll({json.dumps(SHEET + ' th[data-key]')})].filter((e) => e.checkVisibility())"
    keys = f"{heads}.map((e) => e.dataset.key)"
    assert page.ask(keys) == ["psnr:masked", "de00:lab", "filled:image", "seconds:wall"]
    page.click("#all")
    assert "chart_distance:median" in page.ask(keys)
    # Differences that may be chance are set apart. psnr: 26 dB against 21 in each of two views, which are too few; de00
    # is the same for all methods.
    lead = "[data-dataset]:not([hidden])"
    assert re.search(r"clever .*plain .*5\.00 dB", texts(page, f"{lead} .verdicts li")[0])
    page.click(f"{lead} .chances summary")
    assert [
        line
        for line in texts(page, f"{lead} .chances li")
        if line.startswith("psnr: clever is ahead of plain by 5.00 dB")
    ]


def test_the_filter_keeps_rows_with_every_word(page: Browser):
    page.click("[data-rows=view]")
    assert len(methods(page)) == 9
    page.ask("document.activeElement.blur()")
    page.press("/")
    page.write("v1 clev")
    rows = f"document.querySelectorAll({json.dumps(SHEET + ' tbody tr')}).length"
    page.until(f"{rows} === 1")
    assert "clever" in texts(page, f"{SHEET} tbody tr")[0]
    page.press("Escape")
    page.until(f"{rows} === 9")
    for word, count in (("boom", 1), ("nowhere", 0)):  # what failed, by its reason
        page.click("#filter")
        page.write(word)
        page.until(f"{rows} === {count}")
        if count:
            page.press("Escape")
    assert "Nothing matches" in texts(page, SHEET)[0]


def test_the_divider_follows_mouse_and_keys_and_from_nearby_the_full_picture_is_shown(
    page: Browser,
):
    left, top, width, height = page.place("#stage")
    page.drag(
        [
            (left + width / 2, top + height / 2),
            (left + width * 0.6, top + 20),
            (left + width * 0.8, top + 20),
        ]
    )
    assert float(page.ask("document.querySelector('#divider').ariaValueNow")) == pytest.approx(
        80, abs=1
    )
    after = "getComputedStyle(document.querySelector('.side.after')).clipPath"
    assert "80" in page.ask(after)
    page.ask("document.querySelector('#divider').focus()")
    page.press("ArrowLeft")
    page.press("Shift+ArrowLeft")
    assert float(page.ask("document.querySelector('#divider').ariaValueNow")) == pytest.approx(
        69, abs=1
    )
    page.press("Home")
    assert page.ask("document.querySelector('#divider').getAttribute('aria-valuenow')") == "0"
    assert page.until("document.querySelector('#left').naturalWidth === 960")
    page.ask("resultsPage.zoomAt(3)")
    page.until(f"document.querySelector('#left').naturalWidth === {WIDTH}")
    page.until(
        f"[...document.querySelectorAll('#grid img:not([hidden])')].every((i) => i.naturalWidth === {WIDTH})"
    )


def test_zoom_and_pan_are_the_same_in_slider_and_grid_and_a_plain_wheel_scrolls(page: Browser):
    left, top, width, height = page.place("#stage")
    page.wheel((left + width * 0.25, top + height * 0.5), -300, ctrl=True)
    scale, x, y = transform(page, "#left")
    assert scale > 1.5
    assert 0.25 * (1 - scale) == pytest.approx(x, abs=0.01)  # the point below the mouse stays
    assert 0.5 * (1 - scale) == pytest.approx(y, abs=0.01)
    left, top, width, height = page.place("#stage")
    page.drag([(left + width * 0.7, top + 100), (left + width * 0.6, top + 100)])
    moved = transform(page, "#right")
    assert moved[1] == pytest.approx(max(x - 0.1, 1 - scale), abs=0.01)
    for tile in range(1, 4):
        assert transform(page, f"#grid .tile:nth-child({tile}) img") == pytest.approx(
            moved, abs=0.01
        )
    page.press("0")
    assert transform(page, "#left") == pytest.approx([1, 0, 0])
    left, top, width, height = page.place("#stage")
    before = page.ask("scrollY")
    page.wheel((left + width / 2, top + height / 2), 200)
    page.until(f"scrollY > {before}")
    assert page.ask("resultsPage.zoom.scale") == 1


def test_a_picture_is_chosen_in_the_grid_by_keys_and_by_the_lists(page: Browser):
    page.click("#grid [data-which=plain]")
    assert state(page, "method") == "plain"
    assert texts(page, "#right-name") == ["plain"]
    page.click("#grid [data-which=clever]", alt=True)
    assert state(page, "before") == "clever"
    page.press("x")
    assert [state(page, "before"), state(page, "method")] == ["plain", "clever"]
    page.press("[")
    assert state(page, "view") == "v1.png"
    page.press("3")
    page.press("]")
    assert "failed: ValueError: boom" in texts(page, "#right-name")[0]
    assert "boom" in texts(page, "#detail")[0]
    page.ask("document.querySelector('#before').value = '*reference';"
             "document.querySelector('#before').dispatchEvent(new Event('change'))")  # fmt: skip
    assert "reference" in texts(page, "#left-name")[0]


def test_holes_confidence_and_guessed_colours_are_shown_where_there_are_some(page: Browser):
    page.ask(
        "resultsPage.choose({view: 'v0.png', method: 'clever', before: '*view', layer: 'holes'})"
    )
    page.until("!document.querySelector('#right-holes').hidden")
    assert page.ask("document.querySelector('#left-holes').hidden")
    page.ask("resultsPage.choose({layer: 'confidence'})")
    assert "0.1 (dark)" in texts(page, "#detail")[0]
    # all but the one that has it
    assert page.ask("document.querySelectorAll('#grid .pale').length") == 4
    page.ask("resultsPage.choose({layer: 'picture'})")
    assert page.ask("document.querySelector('#guesses-pick').hidden"), (
        "nothing is guessed in this view"
    )
    page.ask("resultsPage.choose({view: 'v1.png'})")
    assert "clever 25 %" in texts(page, "#layer-note")[0]
    over = (
        "[...document.querySelectorAll('#pictures .black')].filter((e) => !e.hidden)"
        ".map((e) => [e.id, getComputedStyle(e).filter])"
    )
    assert page.ask(over) == []
    page.click("#guesses")
    # in the slider and in the grid
    assert page.ask(over) == [
        ["right-holes", "brightness(0)"],
        ["", "brightness(0)"],
    ]
    page.ask("document.activeElement.blur()")
    page.press("f")
    assert page.ask(over) == []


def test_a_link_opens_what_it_names_and_the_address_follows_what_is_chosen(
    page: Browser, out: Path
):
    opened(
        page,
        out,
        "#" + "/".join(["reef%2Cnoise%3D0.1", "v1.png", "plain", "*reference", "de00:lab"]),
    )
    chosen = [state(page, key) for key in ("dataset", "view", "method", "before", "metric")]
    assert chosen == [1, "v1.png", "plain", "*reference", "de00:lab"]
    assert page.ask(
        "document.querySelector('#stage').getBoundingClientRect().top < innerHeight"
    )
    page.click("#grid [data-which=clever]")
    assert (
        page.ask("decodeURIComponent(location.hash)")
        == "#reef,noise=0.1/v1.png/clever/*reference/de00:lab"
    )
    page.ask("location.hash = '#reef/v0.png/nobody'")
    page.until("resultsPage.state.dataset === 0 && resultsPage.state.method === 'clever'")
    opened(page, out, "#nowhere/%E0%A4%A")
    assert state(page, "dataset") == 0


def test_best_median_and_worst_views_are_of_the_method_on_the_right_and_losses_lead_to_theirs(
    page: Browser,
):
    for place, view in (("0", "v1.png"), ("1", "v0.png"), ("0.5", "v2.png")):
        page.click(f"[data-place='{place}']")
        assert state(page, "view") == view
        pressed = page.ask(
            "[...document.querySelectorAll('[data-place][aria-pressed=true]')].map((e) => e.dataset.place)"
        )
        assert pressed == [place]
    page.ask("resultsPage.choose({method: '*reference'})")
    assert page.ask("document.querySelector('#ranked-views').hidden")
    page.ask("resultsPage.choose({before: 'plain', method: 'clever'})")
    assert "no view" in texts(page, "#losses-title")[0]
    page.press("x")
    gaps = {f"v{n}.png": PSNR["plain"][n] - PSNR["clever"][n] for n in range(3)}
    lines = [line.split() for line in texts(page, "#losses-list li")]
    assert lines[0][0] == min(gaps, key=gaps.__getitem__)
    assert {name: float(gap.replace("−", "-")) for name, gap, _ in lines} == pytest.approx(gaps)
    page.click("#losses-list li:nth-child(2) button")
    assert state(page, "view") == lines[1][0]


def test_the_error_map_is_black_where_a_picture_is_its_reference(page: Browser, tmp_path: Path):
    rows = made_results(tmp_path)
    ramp = np.repeat(
        np.linspace(80, 200, 96, dtype=np.uint8)[None, :, None], 64, axis=0
    ).repeat(3, axis=2)
    (reference,) = (tmp_path / "references").rglob("v0.*")
    for path in (tmp_path / "restored/reef/plain/v0.png", reference):
        cv2.imwrite(str(path), ramp)
    write_page(tmp_path, rows)
    opened(page, tmp_path)
    page.ask("resultsPage.choose({view: 'v0.png', method: 'plain', before: 'plain'})")
    page.ask("document.querySelector('#divider').hidden = true;"
             "document.querySelectorAll('#stage .name').forEach((e) => e.hidden = true)")  # fmt: skip
    left, top, width, height = map(int, page.place("#stage"))
    means = []
    for layer in ("picture", "error"):
        page.ask(f"resultsPage.choose({{layer: '{layer}'}})")
        page.ask(
            "Promise.all([...document.querySelectorAll('#stage img[src]')].map((i) => i.decode()))"
        )
        page.picture(tmp_path / "seen.png")
        seen = cv2.imread(str(tmp_path / "seen.png"))[
            top + 10 : top + height - 10, left + 10 : left + width - 10
        ]
        means.append(seen.mean())
    assert means[0] > 60
    assert means[1] < 3


def test_the_photograph_is_one_picture_and_stands_below_the_methods(
    page: Browser, tmp_path: Path
):
    rows = made_results(tmp_path)
    is_clever = rows["method"] == "clever"
    rows.loc[is_clever, "options"] = rows.loc[is_clever, "options"].str.replace(
        "gray_world", "underwater"
    )
    write_page(tmp_path, rows)
    opened(page, tmp_path)
    assert methods(page) == ["plain", "broken", "clever"]  # though its psnr is the best
    assert [state(page, "before"), state(page, "method")] == ["clever", "plain"]
    tiles = page.ask(
        "[...document.querySelectorAll('#grid .tile')].map((e) => e.dataset.which)"
    )
    assert tiles == ["*reference", "plain", "clever", "broken"]


def test_a_script_that_is_not_the_pages_own_does_not_run(page: Browser):
    page.ask(
        "document.body.append(Object.assign(document.createElement('script'), {textContent: 'window.ran = 1'}))"
    )
    page.ask(
        "document.body.insertAdjacentHTML('beforeend', '<b onclick=\"window.ran = 1\">x</b>')"
    )
    page.ask("document.body.lastChild.click()")
    assert page.ask("window.ran === undefined")
    page.wait(lambda: len(page.complaints) == 2, "both are refused")
    page.complaints.clear()


def drawn(page: Browser, part: str) -> str:
    """Scroll to the first plot of a part of the page, and wait until it is drawn; what the browser calls it."""
    plot = f"[data-dataset]:not([hidden]) {part}:not([hidden]) .plot"
    page.place(plot)
    page.until(f"document.querySelector('{plot}').data?.length > 0")
    return f"document.querySelector('{plot}')"


def test_plots_and_patches_show_the_numbers_of_the_table_and_a_list_shows_another_plot(
    page: Browser,
):
    cost = drawn(page, ".cost")
    assert page.ask(f"{cost}.data.map((t) => [t.name, t.x[0], t.y[0]])") == [
        ["plain", 1.0, 21.0], ["clever", 1.0, 26.0], ["broken", 1.0, 18.5],
    ]  # fmt: skip
    distance = drawn(page, ".distance")
    assert page.ask(f"{distance}.data.map((t) => t.x)") == [[2, 4, 8], [2, 4, 8], [2, 4]]
    mean = np.mean(list(DE00.values()))
    assert page.ask(f"{distance}.data[0].y") == pytest.approx([mean] * 3, abs=1e-4)
    water = drawn(page, ".estimate")
    assert page.ask(f"{water}.data.length") == 6  # 3 channels, and the truth
    assert page.ask(f"{water}.data.find((t) => t.name === 'true').y") == [0.1, 0.1, 0.1]
    drawn(page, ".cost")  # what is not in view is not drawn
    page.ask("(() => { const list = document.querySelector('#cost select'); list.value = 'd0-cost-1';"
             "list.dispatchEvent(new Event('change')); })()")  # fmt: skip
    page.until("document.querySelector('#d0-cost-1 .plot').data?.length === 3")
    assert page.ask("document.querySelector('#d0-cost-0').hidden")
    table = "#charts [data-dataset]:not([hidden]) .swatches"
    rows = page.ask(
        f"[...document.querySelector('{table}').tBodies[0].rows].map((row) => [...row.querySelectorAll('svg')].map("
        "(svg) => [...svg.querySelectorAll('rect, circle')].map((shape) => getComputedStyle(shape).fill)))"
    )
    for n, (measured, expected) in enumerate(PATCHES.values()):
        assert rows[0][n] == [f"rgb({', '.join(map(str, expected))})"]
        assert rows[1][n] == [f"rgb({', '.join(map(str, c))})" for c in (measured, expected)]
    heads = page.ask(
        f"[...document.querySelector('{table}').tHead.rows[0].cells].map((e) => e.innerText)"
    )
    assert heads[2:] == ["white", "red", "blue"]  # in the chart's order: 1, 2, 10
    numbers = page.ask(
        f"[...document.querySelector('{table}').tBodies[0].rows[1].querySelectorAll('small')].map((e) => +e.innerText)"
    )
    assert numbers == pytest.approx(list(DE00.values()), abs=0.06)


def test_a_run_that_failed_as_a_whole_has_reasons_and_commands_and_no_dead_links(
    chrome: Browser, tmp_path: Path
):
    rows = made_results(tmp_path)
    rows = rows[rows["metric"] == "seconds"].assign(
        status="failed", value=np.nan, reason="ValueError: boom"
    )
    write_page(tmp_path, rows)
    opened(chrome, tmp_path)
    shown = chrome.ask(
        "[...document.querySelectorAll('nav a')].filter((a) => a.checkVisibility()).map((a) => a.innerText)"
    )
    assert shown == ["Missing", "Origin"]
    assert not chrome.ask(
        "['scores', 'pictures', 'cost'].some((id) => document.getElementById(id).checkVisibility())"
    )
    assert len(texts(chrome, ".commands:not([hidden]) code")) == 3
    assert chrome.complaints == []


def test_light_and_dark_follow_the_browser_until_the_switch_is_used_and_keys_are_listed(
    page: Browser,
):
    paper = "getComputedStyle(document.body).backgroundColor"
    light = page.ask(paper)
    page.prefer("dark")
    dark = page.ask(paper)
    assert dark != light
    page.click("#theme")
    assert page.ask(paper) == light
    page.press("d")
    assert page.ask(paper) == dark
    page.press("?")
    is_open = "document.querySelector('#keys').matches(':popover-open')"
    assert page.ask(is_open)
    page.press("Escape")
    assert not page.ask(is_open)
    page.click("#help")
    assert page.ask(is_open)


def test_a_phone_shows_it_all_without_scrolling_sideways(page: Browser, out: Path):
    width = 390
    page.size(width, 844, phone=True)
    opened(page, out)
    for part in (".distance", ".estimate", ".cost"):
        drawn(page, part)
    assert page.ask("document.documentElement.scrollWidth") == width
    left, top, w, h = page.place("#stage")
    page.touch(
        *[[(left + w / 2 + side * d, top + h / 2) for d in (20, 40, 60)] for side in (-1, 1)]
    )
    # two fingers, three times as far apart
    assert page.ask("resultsPage.zoom.scale") == pytest.approx(3, abs=0.3)


def test_every_control_has_a_name_and_can_be_reached_by_tab(page: Browser):
    nameless = page.ask(
        "[...document.querySelectorAll('button, select, input, [role=slider]')].filter((e) => e.checkVisibility() &&"
        " !(e.ariaLabel || e.innerText?.trim() || e.closest('label')?.innerText.trim() || e.title))"
        ".map((e) => e.outerHTML)"
    )
    assert nameless == []
    assert page.ask("[...document.querySelectorAll('img')].every((i) => i.hasAttribute('alt'))")
    reached = set()
    for _ in range(100):
        page.press("Tab")
        reached.add(
            page.ask("document.activeElement.id || document.activeElement.dataset.which")
        )
    assert {"theme", "filter", "view", "before", "after", "divider", "clever"} <= reached


def test_hostile_names_run_nothing(page: Browser, tmp_path: Path):
    rows = made_results(tmp_path)
    rows["method"] = rows["method"] + HOSTILE
    rows["view"] = rows["view"].str.replace("v2.png", HOSTILE)
    write_page(tmp_path, rows)
    opened(page, tmp_path)
    assert HOSTILE in methods(page)[0]
    page.click("[data-rows=view]")
    for part in (".distance", ".cost"):
        drawn(page, part)
    assert page.ask("document.querySelectorAll(\"img[src='x']\").length") == 0


def test_a_page_moved_away_from_its_pictures_still_shows_thumbnails(
    page: Browser, out: Path, tmp_path: Path
):
    (tmp_path / "report").mkdir()
    (tmp_path / "report/index.html").write_bytes((out / "report/index.html").read_bytes())
    opened(page, tmp_path)
    page.until("document.querySelector('#left').naturalWidth === 960")
    page.ask("resultsPage.zoomAt(3)")
    page.wait(
        lambda: any("ERR_FILE_NOT_FOUND" in said for said in page.complaints),
        "the pictures are not found",
    )
    page.wait_until_loaded()
    assert page.ask("document.querySelector('#left').naturalWidth") == 960
    page.complaints[:] = [said for said in page.complaints if "ERR_FILE_NOT_FOUND" not in said]
