"""Debian's Chromium, driven by Playwright."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
SOFTWARE = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
"""The map draws with WebGL, which a machine without a graphics card does in software."""


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser without a window, which gets the processor that the flight leaves: it draws in software."""
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        humble = Path(folder) / "chromium"
        humble.write_text(f'#!/bin/sh\nexec nice -n 19 {CHROMIUM} "$@"\n')
        humble.chmod(0o755)
        browser = playwright.chromium.launch(executable_path=humble, args=SOFTWARE)
        try:
            yield browser
        finally:
            browser.close()


def page_of(browser: Browser, url: str, complaints: list[str], width: int = 1440, height: int = 860) -> Page:
    """The console's page, in a context of its own; what its scripts complain of is kept."""
    page = browser.new_context(viewport={"width": width, "height": height}).new_page()
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda line: complaints.append(line.text) if line.type == "error" else None)
    page.on("request", lambda asked: complaints.append(asked.url) if not _own(asked.url, url) else None)
    page.goto(url)
    return page


def _own(asked: str, url: str) -> bool:
    return asked.startswith((url, url.replace("http", "ws", 1), "blob:", "data:"))
