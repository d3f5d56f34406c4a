"""Chromium, driven by Playwright, with what it complains of and asks for kept."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

__all__ = ["Visit", "chromium", "drawn", "opened", "violations", "visits"]

_NAMES = ("chromium", "chromium-browser", "google-chrome")


@contextmanager
def chromium() -> Iterator[Any]:
    """A running browser; the test is skipped, and says why, where there is none."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        pytest.skip("reports are not looked at in a browser: the extra `dev` is not installed (playwright)")
    path = next((found for name in _NAMES if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip("reports are not looked at in a browser: there is no Chromium; run: apt-get install chromium")
    alone = ["--no-sandbox"] if os.geteuid() == 0 else []  # its sandbox does not run as root
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=alone)
        try:
            yield browser
        finally:
            browser.close()


class Visit:
    """A page that was opened.

    Attributes:
        page: What Playwright calls a page.
        said: Errors and warnings of the console, and what the policy of the page refused.
        asked: Addresses that are neither files nor data.
    """

    def __init__(self, page: Any) -> None:
        self.page = page
        self.said: list[str] = []
        self.asked: list[str] = []
        page.on("console", lambda message: self.said.append(message.text) if message.type != "log" else None)
        page.on("pageerror", lambda error: self.said.append(str(error)))
        page.on(
            "request",
            lambda request: None if request.url.startswith(("file:", "data:")) else self.asked.append(request.url),
        )

    def state(self, expression: str) -> Any:
        """A value of the script."""
        return self.page.evaluate(expression)

    def until(self, expression: str) -> None:
        """Wait until a condition of the script holds; Playwright's own wait evaluates text, which the page forbids."""
        from playwright.sync_api import Error

        for _ in range(1500):
            with suppress(Error):  # while another page is on its way, there is no script to ask
                if self.state(expression):
                    return
            self.page.wait_for_timeout(20)
        raise AssertionError(f"{expression} never held")

    def press(self, *keys: str) -> None:
        """Press keys one after the other."""
        for key in keys:
            self.page.keyboard.press(key)


@contextmanager
def visits(
    browser: Any, path: Path, *, width: int = 1280, height: int = 900, scheme: str = "light", fragment: str = ""
) -> Iterator[Visit]:
    """A page in a window of its own; nothing may have gone wrong when it is closed."""
    context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
    visit = Visit(context.new_page())
    visit.page.goto(f"{path.as_uri()}{fragment}")
    try:
        yield visit
        assert visit.said == []
        assert visit.asked == []
    finally:
        context.close()


def opened(visit: Visit, place: int = 0) -> None:
    """Open the player by keyboard alone."""
    visit.page.locator("button.open").nth(place).focus()
    visit.press("Enter")
    assert visit.state("dialog.open")


def violations(page: Any) -> list[str]:
    """What axe-core finds, each with the first element."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [f"{one['id']}: {one['nodes'][0]['html'][:120]}" for one in found]


def drawn(visit: Visit, figure: str) -> str:
    """A canvas as text that changes with what it shows."""
    found: str = visit.state(f"document.querySelector('{figure} canvas').toDataURL()")
    return found
