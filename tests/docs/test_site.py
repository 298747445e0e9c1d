"""The documentation as a site: it builds without a warning, needs no network, and can be searched from disk."""

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
from support.browser import Browser
from support.places import ROOT


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "--site-dir",
        str(folder),
    ]
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, env=quiet
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


class Loaded(HTMLParser):
    """What a page has a browser load by itself: scripts, styles, fonts, pictures, frames."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag == "link" and given.get("rel") not in ("canonical", "next", "prev"):
            self.addresses.append(given.get("href") or "")
        elif tag != "a":
            self.addresses += [
                given[name] or "" for name in ("src", "srcset", "data") if name in given
            ]


def test_no_page_asks_for_anything_from_elsewhere_and_nothing_is_missing(site: Path):
    for page in site.glob("*.html"):
        loaded = Loaded()
        loaded.feed(page.read_text(encoding="utf-8"))
        for address in (one for one in loaded.addresses if not one.startswith("data:")):
            assert not re.match(r"(https?:)?//", address), f"{page.name}: {address}"
            # The page that says "not found" is served from any address, and so takes its own from the root.
            assert page.name == "404.html" or (page.parent / address.split("?")[0]).exists(), (
                f"{page.name}: {address}"
            )
    for style in site.rglob("*.css"):
        assert not re.search(
            r"(url\(|@import)\s*[\"']?(https?:)?//", style.read_text(encoding="utf-8")
        ), style


def test_every_formula_is_written_for_the_browser(site: Path):
    pages = {page.stem: page.read_text(encoding="utf-8") for page in site.glob("*.html")}
    assert not [
        name for name, text in pages.items() if "arithmatex" in text or "\\frac" in text
    ]
    assert pages["formulas"].count('<div class="formula"><math') >= 10
    assert "<munder><mo>∑</mo>" in pages["formulas"]


def test_the_notebook_is_a_page_and_can_be_had(site: Path):
    text = (site / "tutorial.html").read_text(encoding="utf-8")
    assert 'href="tutorial.ipynb"' in text
    assert "KnownWater" in text
    assert (site / "tutorial.ipynb").is_file()
    assert not list(site.rglob("*.py"))


def test_the_reference_has_what_the_package_offers(site: Path):
    import sucre_bench

    text = (site / "api.html").read_text(encoding="utf-8")
    missing = {name for name in sucre_bench.__all__ if f'id="sucre_bench.{name}"' not in text}
    assert missing == {"__version__"}


def test_it_is_searched_from_disk(chrome: Browser, site: Path):
    chrome.open((site / "index.html").as_uri())
    chrome.click(".md-search__input")
    chrome.until(
        "document.querySelector('.md-search-result__meta').textContent.trim() === 'Type to start searching'"
    )
    chrome.write("variable projectio")
    chrome.press("n")  # the search listens to keys
    found = "[...document.querySelectorAll('.md-search-result__item a')].map(link => link.href)"
    chrome.until(f"{found}.some(address => address.includes('supplement.html'))")
    assert not chrome.complaints


@pytest.mark.parametrize("page", ["metrics", "api"])
def test_it_is_no_wider_than_a_phone(chrome: Browser, site: Path, page: str):
    chrome.size(390, 844, phone=True)
    chrome.open((site / f"{page}.html").as_uri())
    assert chrome.ask("document.documentElement.scrollWidth") == 390
    chrome.size(1440, 900)
    assert not chrome.complaints
