"""The page in a real browser, on a vehicle that takes every order."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, expect

from gcs_plugin.component.orders import Follow, LocateOrder
from gcs_plugin.geotags.log import GeotagLog
from tests.gcs_plugin.console.browsers import chromium, needs_chromium, page_of
from tests.gcs_plugin.console.page_client import Console, console, until
from tests.support.sample import geotag, jpeg

pytestmark = needs_chromium
PATIENCE_MS = 30_000


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    expect.set_options(timeout=PATIENCE_MS)
    with chromium() as opened:
        opened.new_context().close()
        yield opened


@contextmanager
def filmed(folder: Path) -> Iterator[Console]:
    """A console with a target in its list, and pictures that go on."""
    GeotagLog(folder / "geotags.gpkg").append(geotag(picture=jpeg()))
    with console(folder) as running:
        ended = threading.Event()
        thread = threading.Thread(target=_film, args=(running, ended))
        thread.start()
        try:
            yield running
        finally:
            ended.set()
            thread.join()


def _film(running: Console, ended: threading.Event) -> None:
    index = 0
    while not ended.wait(0.1):
        if running.server.desk.pictures.wanted:
            index += 1
            running.offer(index)


@pytest.mark.parametrize("width", [1440, 390])
def test_nothing_on_the_page_shuts_anybody_out(tmp_path: Path, browser: Browser, width: int) -> None:
    complaints: list[str] = []
    with filmed(tmp_path) as running:
        page = page_of(browser, running.server.url, complaints, width)
        expect(page.locator("#target-list h3")).to_contain_text("Target 1")
        expect(page.locator("#no-picture")).to_be_hidden()
        for _ in ("dark", "bright"):
            found = Axe().run(page, options={"resultTypes": ["violations"]}).response["violations"]
            assert [(v["id"], [n["html"] for n in v["nodes"]]) for v in found] == []
            page.locator("#theme").click()
        small = page.evaluate(
            "[...document.querySelectorAll('button, a, summary')].filter(e => e.offsetParent && !e.closest('#boxes'))"
            ".filter(e => e.offsetHeight < 48 || e.offsetWidth < 48).map(e => e.outerHTML)"
        )
        assert small == []
        page.context.close()
    assert complaints == []


def test_a_person_is_marked_followed_located_and_the_flight_aborted_by_escape(tmp_path: Path, browser: Browser) -> None:
    complaints: list[str] = []
    with filmed(tmp_path) as running:
        taken = running.taken
        page = page_of(browser, running.server.url, complaints)
        expect(page.locator("#no-picture")).to_be_hidden()
        box = page.locator("#picture").bounding_box()
        assert box is not None
        x, y = box["x"], box["y"]
        page.mouse.move(x + 0.25 * box["width"], y + 0.25 * box["height"])
        page.mouse.down()
        page.mouse.move(x + 0.5 * box["width"], y + 0.75 * box["height"], steps=4)
        page.mouse.up()
        expect(page.locator("#confirm")).to_be_visible()
        (order,) = taken.orders
        assert isinstance(order, Follow)
        assert order.mark.left == pytest.approx(0.25, abs=0.02)
        assert order.mark.bottom == pytest.approx(0.75, abs=0.02)
        page.locator("#locate").click()
        assert until(lambda: isinstance(taken.orders[-1], LocateOrder))
        expect(page.locator("#commander")).to_have_text("You are in command")
        page.keyboard.press("Escape")
        assert until(lambda: taken.aborts == 1)
        page.context.close()
    assert complaints == []


def test_a_second_page_watches_and_takes_over_when_the_first_has_gone(tmp_path: Path, browser: Browser) -> None:
    with filmed(tmp_path) as running:
        first, second = (page_of(browser, running.server.url, []) for _ in range(2))
        expect(first.locator("#commander")).to_have_text("Nobody is in command")  # connected
        first.locator("#command").click()
        expect(second.locator("#commander")).to_have_text("Operator 1 is in command")
        expect(second.locator("#command")).to_be_disabled()
        first.reload()
        expect(first.locator("#commander")).to_have_text("You are in command")
        first.context.close()
        expect(second.locator("#command")).to_be_enabled()
        second.locator("#command").click()
        expect(second.locator("#commander")).to_have_text("You are in command")
        second.context.close()


def test_a_lost_drone_and_a_lost_connection_are_told_in_words(tmp_path: Path, browser: Browser) -> None:
    with filmed(tmp_path) as running:
        page = page_of(browser, running.server.url, [])
        expect(page.locator("#sentence")).to_contain_text("Ready.")
        running.ended.set()  # the vehicle's loop
        expect(page.locator("#sentence")).to_contain_text("No drone is connected")
        running.server.close()
        expect(page.locator("#sentence")).to_contain_text("The connection to Sidestep is lost")
        page.context.close()
