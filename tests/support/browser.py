"""Drives a real Chromium without a window, by Playwright and with the system's own Chromium.

Chromium has no network: every name resolves to nothing, and the page is told that it is offline.

SUCRE_BENCH_TEST_BROWSER=1 makes it a failure that there is no Chromium, rather than a reason to skip.
"""

import json
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import sync_playwright

_PATIENCE_MS = 300_000  # for a busy machine
# Marsaglia's xorshift in the place of the browser's random numbers, so that a test does not fail by chance.
_DRAWS = """(() => {
    let state = (SEED * 2654435761 + 1) >>> 0 || 1;
    const drawn = (array) => {
        for (let n = 0; n < array.length; n++) {
            state ^= state << 13; state ^= state >>> 17; state ^= state << 5;
            array[n] = state >>> 0;
        }
        return array;
    };
    for (let n = 0; n < 20; n++) drawn([0]);
    Crypto.prototype.getRandomValues = drawn;
    Math.random = () => drawn(new Uint32Array(1))[0] / 2 ** 32;
})();"""
_LOCAL = ("file:", "data:", "blob:", "about:")


def chromium() -> str:
    """Return the path of a Chromium or Chrome. Without one the test is skipped, or fails where there must be one."""
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
    for name in names:
        if found := shutil.which(name):
            return found
    said = "no Chromium or Chrome here; install Debian's package chromium"
    if os.environ.get("SUCRE_BENCH_TEST_BROWSER") == "1":
        pytest.fail(said)
    pytest.skip(said)


class Browser:
    """One tab. complaints: warnings and errors on the console, exceptions, and requests that leave the machine."""

    def __init__(
        self, program: str, profile: Path, width: int = 1440, height: int = 900
    ) -> None:
        flags = [
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--host-resolver-rules=MAP * ~NOTFOUND",
        ]
        self._playwright = sync_playwright().start()
        self._context = self._playwright.chromium.launch_persistent_context(
            profile,
            executable_path=program,
            args=flags,
            offline=True,
            no_viewport=True,
            timeout=_PATIENCE_MS,
        )
        self._page = self._context.pages[0]
        self._page.set_default_timeout(_PATIENCE_MS)
        self._protocol = self._context.new_cdp_session(self._page)
        self.complaints: list[str] = []
        self._loading: set[Any] = set()
        self._drawing = ""
        self._page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self._page.on("console", self._heard)
        self._page.on("request", self._requested)
        for ended in ("requestfinished", "requestfailed"):
            self._page.on(ended, lambda request: self._loading.discard(request))
        self.size(width, height)

    def _heard(self, message: Any) -> None:
        if message.type in ("error", "warning", "assert"):
            self.complaints.append(message.text)

    def _requested(self, request: Any) -> None:
        self._loading.add(request)
        if not request.url.startswith(_LOCAL):
            self.complaints.append(f"asked for {request.url}")

    def close(self) -> None:
        """End the browser."""
        self._context.close()
        self._playwright.stop()

    def call(self, method: str, **params: Any) -> Any:
        """Return the answer of the DevTools protocol, for what Playwright has no method for."""
        return self._protocol.send(method, params)

    # -- what a person does --------------------------------------------------------------------------------

    def open(self, address: str) -> None:
        """Load a page, as if for the first time."""
        if "#" in address:  # else the browser would only move within the page
            self._page.goto("about:blank")
        self._page.goto(address)

    def size(self, width: int, height: int, phone: bool = False) -> None:
        """Set the window's size; phone: with a finger, and two pixels to one."""
        scale = 2 if phone else 1
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=phone,
        )
        self.call("Emulation.setTouchEmulationEnabled", enabled=phone)

    def prefer(self, scheme: Any) -> None:
        """Prefer "light" or "dark"."""
        self._page.emulate_media(color_scheme=scheme)

    def ask(self, script: str) -> Any:
        """Return the value of an expression in the page."""
        return self._page.evaluate(script)

    def until(self, script: str) -> Any:
        """Wait until an expression is true, and return it. Raises AssertionError after 5 minutes."""
        value: Any = None

        def asked() -> Any:
            nonlocal value
            value = self.ask(script)
            return value

        # Playwright's own waiting evaluates text, which the page's policy forbids
        self.wait(asked, script)
        return value

    def wait(self, true: Callable[[], Any], what: str) -> None:
        """Wait until a function returns something true; meanwhile the browser's complaints come in."""
        deadline = time.monotonic() + _PATIENCE_MS / 1000
        while not true():
            assert time.monotonic() < deadline, f"never came true: {what}; {self.complaints}"
            self._page.wait_for_timeout(20)

    def wait_until_loaded(self) -> None:
        """Wait until the page has all that it asked for, or knows that it cannot have it."""
        self.ask(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )
        self.wait(lambda: not self._loading, "nothing is loading")
        # for a complaint about the last one, which is on its way
        self._page.wait_for_timeout(20)

    def draws(self, seed: int) -> None:
        """From the next page on, let pages draw these random numbers."""
        if self._drawing:
            self.call("Page.removeScriptToEvaluateOnNewDocument", identifier=self._drawing)
        script = _DRAWS.replace("SEED", str(seed))
        self._drawing = self.call("Page.addScriptToEvaluateOnNewDocument", source=script)[
            "identifier"
        ]

    def place(self, selector: str) -> tuple[float, float, float, float]:
        """Bring an element into view, and return its left, top, width and height."""
        script = f"""(() => {{ const e = document.querySelector({json.dumps(selector)});
            e.scrollIntoView({{block: 'center', behavior: 'instant'}});
            const b = e.getBoundingClientRect(); return [b.left, b.top, b.width, b.height]; }})()"""
        left, top, width, height = self.ask(script)
        return left, top, width, height

    def click(self, selector: str, alt: bool = False) -> None:
        """Click in an element's middle, once the page has drawn what came before: on a busy machine it still moves."""
        self.ask(
            "new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(() => drawn(true))))"
        )
        left, top, width, height = self.place(selector)
        if alt:
            self._page.keyboard.down("Alt")
        self._page.mouse.click(left + width / 2, top + height / 2)
        if alt:
            self._page.keyboard.up("Alt")

    def drag(self, path: list[tuple[float, float]]) -> None:
        """Press the mouse at the first point, move through the others, and let go at the last."""
        mouse = self._page.mouse
        mouse.move(*path[0])
        mouse.down()
        for point in path[1:]:
            mouse.move(*point)
        mouse.up()

    def wheel(self, point: tuple[float, float], by: float, ctrl: bool = False) -> None:
        """Turn the wheel at a point."""
        self._page.mouse.move(*point)
        if ctrl:
            self._page.keyboard.down("Control")
        self._page.mouse.wheel(0, by)
        if ctrl:
            self._page.keyboard.up("Control")

    def touch(self, *paths: list[tuple[float, float]]) -> None:
        """Move a finger along each path, all at once."""
        for step, points in enumerate(zip(*paths, strict=True)):
            kind = "touchMove" if step else "touchStart"
            fingers = [{"x": x, "y": y, "id": n} for n, (x, y) in enumerate(points)]
            self.call("Input.dispatchTouchEvent", type=kind, touchPoints=fingers)
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def press(self, key: str) -> None:
        """Press a key: a character, or a name such as "ArrowRight" or "Shift+ArrowRight"."""
        self._page.keyboard.press(key)

    def write(self, text: str) -> None:
        """Write into the focused element."""
        self._page.keyboard.insert_text(text)

    def download(self, selector: str, path: Path) -> None:
        """Click what saves a file, and keep that file."""
        with self._page.expect_download() as saved:
            self.click(selector)
        saved.value.save_as(path)

    def picture(self, path: Path) -> None:
        """Store a picture of the window."""
        self._page.screenshot(path=path)
