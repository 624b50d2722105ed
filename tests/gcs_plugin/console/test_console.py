"""The console's server: what it shows, whom it obeys, and what it does not let in."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from gcs_plugin.component.orders import Follow, HandToAutopilot, LocateOrder, Mark
from gcs_plugin.console.passwords import read_passwords, set_password
from gcs_plugin.console.server import ConsoleServer
from gcs_plugin.console.sockets import MOST_PAGES
from gcs_plugin.geotags.log import GeotagLog
from mission.errors import SettingsError
from mission.settings import ConsoleSettings
from tests.gcs_plugin.console.page_client import Browser, Console, Nobody, Wire, console, until
from tests.support.sample import geotag, jpeg


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Console]:
    with console(tmp_path) as made:
        yield made


@pytest.fixture
def browser(running: Console) -> Browser:
    found = Browser(running.server.url)
    found.open()
    return found


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Console]:
    path = tmp_path / "passwords"
    set_password(path, "viewer", "look only")
    set_password(path, "commander", "may order")
    with console(tmp_path, ConsoleSettings(password_file=path)) as made:
        yield made


def test_the_page_is_whole_and_fetches_nothing_from_elsewhere(browser: Browser) -> None:
    status, headers, content = browser.get("/")
    assert status == 200
    assert b"http://" not in content
    assert b"https://" not in content
    assert "default-src 'self'" in headers["content-security-policy"]
    for name in ("main.js", "map-worker.js", "style.css", "icon.svg"):
        assert browser.get(f"/{name}")[0] == 200


def test_the_cookie_is_for_this_page_only(running: Console) -> None:
    cookie = Browser(running.server.url).get("/")[1]["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie


def test_pictures_come_with_number_time_and_content(running: Console, browser: Browser) -> None:
    with browser.live() as wire:
        number = running.picture(7)
        found = wire.next("picture")
        assert found["id"] == number
        assert 0.0 <= found["age"] < 5.0
        image = cv2.imdecode(np.frombuffer(found["jpeg"], np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert image.shape == (48, 64, 3)


def test_a_slow_page_gets_the_newest_picture_and_delays_nobody(running: Console, browser: Browser) -> None:
    with browser.live() as slow, browser.live() as quick:
        running.picture(0)
        slow.next("hello")  # reads no more
        for index in range(1, 20):
            number = running.picture(index)
            while quick.next("picture")["id"] != number:
                pass
        seen = [slow.next("picture")["id"]]
        while seen[-1] != number:
            seen.append(slow.next("picture")["id"])
    assert len(seen) < 10


def test_who_is_marked_is_followed_and_then_located(running: Console, browser: Browser) -> None:
    with browser.live() as wire:
        number = running.picture(1)
        assert wire.order("mark", picture=number, box=[0.25, 0.25, 0.5, 0.75]) == ""
        (order,) = running.taken.orders
        assert isinstance(order, Follow)
        assert (order.mark.left, order.mark.bottom) == (0.25, 0.75)
        assert "mark somebody" in wire.order("locate")  # not seen yet
        running.picture(2)
        assert until(lambda: running.server.desk.following)
        assert wire.order("locate") == ""
        located = running.taken.orders[1]
        assert located == LocateOrder(Mark(0.25, 0.25, 0.5, 0.75))  # where the tracker has them, and nobody else
        assert wire.order("abort") == ""
        assert running.taken.aborts == 1


def test_nobody_is_located_who_was_not_marked(running: Console, browser: Browser) -> None:
    with browser.live() as wire:
        assert "mark somebody" in wire.order("locate")
    assert running.taken.orders == []


@pytest.mark.parametrize(
    ("picture", "box", "why"),
    [
        (999, [0.1, 0.1, 0.2, 0.2], "too old"),
        (1, [1.5, 1.5, 1.5, 1.5], "outside"),
        (1, [0.1, 0.1, "x", 0.2], "cannot be read"),
        (1, [0.1, 0.1], "cannot be read"),
        (True, [0.1, 0.1, 0.2, 0.2], "cannot be read"),
        (1, None, "cannot be read"),
    ],
)
def test_a_mark_that_means_nothing_is_refused(
    running: Console, browser: Browser, picture: object, box: object, why: str
) -> None:
    with browser.live() as wire:
        running.picture(1)
        assert why in wire.order("mark", picture=picture, box=box)
    assert running.taken.orders == []


def test_a_mark_in_an_old_picture_is_refused(running: Console, browser: Browser) -> None:
    with browser.live() as wire:
        number = running.picture(1)
        time.sleep(4.1)  # the picture has to become old
        assert "too old" in wire.order("mark", picture=number, box=[0.1, 0.1, 0.5, 0.5])


def test_the_vehicles_own_refusal_is_told(running: Console, browser: Browser) -> None:
    running.taken.refusal = "the battery is low"
    with browser.live() as wire:
        number = running.picture(1)
        assert wire.order("mark", picture=number, box=[0.1, 0.1, 0.5, 0.5]) == "the battery is low"


def test_the_answer_is_given_back_to_the_autopilot(running: Console, browser: Browser) -> None:
    with browser.live() as wire:
        assert wire.order("give", what="roi") == ""
        assert wire.order("give", what="self-destruct") == "there is no such order"
    assert running.taken.orders == [HandToAutopilot(roi=True, waypoint=False)]


def test_one_of_two_commanders_is_in_command(running: Console) -> None:
    first, second = Browser(running.server.url), Browser(running.server.url)
    first.open()
    second.open()
    with first.live() as one, second.live() as two:
        assert one.order("take") == ""
        assert two.order("give", what="roi") == "Operator 1 is in command"
        assert two.order("abort") == ""  # anybody who may command may stop the drone
        one.order("release")
        assert two.order("give", what="roi") == ""
    assert len(running.taken.orders) == 1


def test_targets_are_listed_with_grid_reference_and_picture(tmp_path: Path) -> None:
    GeotagLog(tmp_path / "geotags.gpkg").append(geotag(picture=jpeg()))
    with console(tmp_path) as running:
        browser = Browser(running.server.url)
        browser.open()
        with browser.live() as wire:
            (target,) = wire.next("targets")["targets"]
            assert target["mgrs"].startswith("52S CG")
            assert target["name"] == "Target 1"
            running.server.desk.targets.tell(replace(geotag("b"), number=2))
            assert [t["number"] for t in wire.next("targets")["targets"]] == [1, 2]
        assert browser.get("/targets/1/picture")[2] == jpeg()
        assert browser.get("/targets/9/picture")[0] == 404
        for ending in ("kmz", "gpx", "csv", "zip", "gpkg", "geojson"):
            assert browser.get(f"/targets.{ending}")[0] == 200
        assert browser.get("/targets.exe")[0] == 404


def test_another_origin_another_host_and_a_stranger_are_turned_away(running: Console, browser: Browser) -> None:
    for origin in ("http://evil.example", "null", f"https://{browser.host}"):
        with pytest.raises(InvalidStatus), browser.live(origin=origin):
            pass
    with pytest.raises(InvalidStatus), Browser(running.server.url).live():
        pass
    assert browser.get("/", Host="evil.example")[0] == 421
    assert browser.get("/", Host="127.0.0.1.evil.example:80")[0] == 421
    assert browser.request("POST", "/logout", b"", Origin="http://evil.example")[0] == 403
    assert browser.request("POST", "/logout", b"")[0] == 403
    assert Browser(running.server.url).get("/targets.csv")[0] == 401


def test_a_forged_and_a_stolen_cookie_open_nothing(running: Console, browser: Browser) -> None:
    name, _, signature = browser.cookie.partition(".")
    forged = [f"{name}.{'0' * len(signature)}", f"x.{signature}", name, "", "\xff.\xff"]
    for cookie in forged:
        assert Browser(running.server.url, cookie).get("/targets.csv")[0] == 401
    assert Browser(running.server.url, browser.cookie, agent="another browser").get("/targets.csv")[0] == 401
    assert browser.get("/targets.csv")[0] == 200
    assert browser.request("POST", "/logout", b"", Origin=browser.url.rstrip("/"))[0] == 303
    assert browser.get("/targets.csv")[0] == 401


@pytest.mark.parametrize(
    "path",
    [
        "/../../etc/passwd",
        "/..%2f..%2fetc%2fpasswd",
        "/%2e%2e/settings.py",
        "//etc/passwd",
        "/page/index.html",
        "/.env",
    ],
)
def test_no_path_reaches_the_disk(browser: Browser, path: str) -> None:
    status, _, content = browser.get(path)
    assert status in (400, 404)
    assert b"root:" not in content


def test_rubbish_is_passed_over_and_too_much_of_it_ends_the_connection(running: Console, browser: Browser) -> None:
    with browser.live() as wire:
        for text in ("", "{", "[]", "null", '{"type": 3}', '{"type": "ack", "id": "x"}', "[" * 5000):
            wire.socket.send(text)
        assert wire.order("take") == ""
    for flood in (["x" * 10_000_000], ["{}"] * 2000):
        with browser.live() as wire, pytest.raises(ConnectionClosed):
            sent_until_closed(wire, flood)
    assert running.taken.orders == []


def sent_until_closed(wire: Wire, flood: list[str]) -> None:
    for text in flood:
        wire.socket.send(text)
    while True:
        wire.socket.recv(10.0)


def test_so_many_pages_and_no_more(running: Console, browser: Browser) -> None:
    with contextlib.ExitStack() as open_pages:
        wires: list[Wire] = [open_pages.enter_context(browser.live()) for _ in range(MOST_PAGES)]
        with pytest.raises(InvalidStatus), browser.live():
            pass
        assert wires[0].order("take") == ""
    assert until(lambda: not running.server.desk.pictures.wanted)
    with browser.live() as wire:
        assert wire.order("take") == ""


def test_hundreds_of_silent_connections_do_not_keep_the_operator_out(running: Console, browser: Browser) -> None:
    address = (browser.host.split(":")[0], int(browser.host.split(":")[1]))
    with contextlib.ExitStack() as held, browser.live() as wire:
        for _ in range(300):
            held.enter_context(contextlib.closing(socket.create_connection(address, 5.0)))
        assert wire.order("abort") == ""
    assert running.taken.aborts == 1


def test_a_password_says_who_commands_and_who_watches(guarded: Console) -> None:
    url = guarded.server.url
    stranger = Browser(url)
    assert b'name="password"' in stranger.get("/")[2]
    assert "set-cookie" not in stranger.get("/")[1]
    stranger.login("guess")
    assert stranger.cookie == ""
    viewer, commander = Browser(url), Browser(url)
    assert viewer.login("look only") == 303
    assert commander.login("may order") == 303
    with viewer.live() as watching, commander.live() as ordering:
        assert watching.next("hello")["role"] == "viewer"
        for kind in ("take", "locate", "abort", "mark", "give"):
            assert watching.order(kind) == "viewers give no orders"
        assert ordering.order("give", what="roi") == ""
    assert guarded.taken.aborts == 0


def test_passwords_cannot_be_tried_for_long_nor_from_another_page(guarded: Console) -> None:
    browser = Browser(guarded.server.url)
    assert browser.login("may order", origin="http://evil.example") == 403
    answers = [browser.login(f"guess {number}") for number in range(8)]
    assert answers[:5] == [303] * 5
    assert answers[-1] == 429
    body = b"password=" + b"x" * 100_000
    assert browser.request("POST", "/login", body, Origin=browser.url.rstrip("/"))[0] in (413, 429)


def test_elsewhere_than_on_this_machine_it_needs_a_password_and_tls(tmp_path: Path) -> None:
    path = tmp_path / "passwords"
    set_password(path, "commander", "may order")
    for settings in (ConsoleSettings(host="0.0.0.0"), ConsoleSettings(host="0.0.0.0", password_file=path)):
        with pytest.raises(SettingsError, match="without a password"):
            ConsoleServer(settings, tmp_path / "log.gpkg", Nobody, time.monotonic)


def test_a_port_that_is_taken_is_told(tmp_path: Path) -> None:
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as taken:
        settings = ConsoleSettings(port=taken.getsockname()[1])
        with pytest.raises(SettingsError, match=r"another console\.port"):
            ConsoleServer(settings, tmp_path / "log.gpkg", Nobody, time.monotonic)


def test_a_password_file_that_others_may_read_or_that_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "passwords"
    with pytest.raises(SettingsError, match="too short"):
        set_password(path, "viewer", "short")
    set_password(path, "viewer", "long enough")
    assert b"long enough" not in path.read_bytes()
    assert read_passwords(path).role("long enough") == "viewer"
    path.chmod(0o644)
    with pytest.raises(SettingsError, match="others may read"):
        read_passwords(path)
    path.chmod(0o600)
    for content in ("rubbish", "viewer:x$y", "admin:AAAA$AAAA", ""):
        path.write_text(content)
        with pytest.raises(SettingsError):
            read_passwords(path)


def test_the_state_says_what_the_vehicle_says(browser: Browser) -> None:
    with browser.live() as wire:
        state = wire.next("state")
        assert state["vehicle"]["inAir"] is True
        assert state["commander"] is None
        json.dumps(state, allow_nan=False)
