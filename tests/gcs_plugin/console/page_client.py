"""A browser as far as the console's server can tell, and a vehicle's loop that takes every order."""

from __future__ import annotations

import http.client
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

import numpy as np
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from gcs_plugin.component.orders import Order
from gcs_plugin.console.server import ConsoleServer
from mission.detect import Detector
from mission.records import Box, Detection, Frame
from mission.settings import ConsoleSettings, MissionSettings
from mission.track import Track
from tests.support.fakes import CAMERA, FakeDrone

AGENT = "test browser"


class Nobody:
    """A detector that finds one person."""

    name = "one"

    def detect(self, image: object, region: Box | None = None) -> list[Detection]:
        return [Detection(Box(10.0, 10.0, 20.0, 40.0), 0.9)]


@dataclass
class Taken:
    """Orders as the component takes them."""

    settings: MissionSettings = field(default_factory=MissionSettings)
    orders: list[Order] = field(default_factory=list)
    aborts: int = 0
    refusal: str = ""
    busy: bool = False
    flying: bool = False

    def order(self, order: Order) -> str:
        if not self.refusal:
            self.orders.append(order)
            self.busy = True
        return self.refusal

    def abort(self) -> None:
        self.aborts += 1
        self.busy = self.flying = False


@dataclass
class Console:
    """A server with a vehicle behind it."""

    server: ConsoleServer
    taken: Taken
    ended: threading.Event = field(default_factory=threading.Event)

    def loop(self) -> None:
        drone = FakeDrone()
        self.server.desk.attach(drone, self.taken, CAMERA)
        while not self.ended.wait(0.01):
            self.server.desk.turn()
        self.server.desk.detach()

    def offer(self, index: int) -> None:
        """A picture as the vehicle's loop offers it; who was marked is seen in it while an order runs."""
        image = np.full((48, 64, 3), index % 255, np.uint8)
        frame = Frame(image, time.monotonic(), index)
        box = Box(16.0, 12.0, 16.0, 24.0)
        track = Track(index, frame.t_s, "tracking", box, box.centre_px, 1.0, 24.0, 0.1, 1.0)
        self.server.desk.frame(frame, track if self.taken.busy else None)

    def picture(self, index: int) -> int:
        """Publish a picture; its number."""
        desk = self.server.desk
        assert until(lambda: desk.pictures.wanted)  # the page's connection has been taken up
        before = desk.pictures.newest
        self.offer(index)
        assert until(lambda: desk.pictures.newest is not before)
        assert desk.pictures.newest is not None
        return desk.pictures.newest.id


def until(condition: Any, timeout_s: float = 10.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return bool(condition())


@contextmanager
def console(folder: Path, settings: ConsoleSettings | None = None) -> Iterator[Console]:
    """A console at a free port."""
    chosen = (settings or ConsoleSettings()).model_copy(update={"port": 0})
    server = ConsoleServer(chosen, folder / "geotags.gpkg", _detector, time.monotonic)
    made = Console(server, Taken())
    thread = threading.Thread(target=made.loop)
    thread.start()
    try:
        assert until(lambda: server.desk.status is not None)
        assert until(lambda: _answers(server.url))
        yield made
    finally:
        made.ended.set()
        thread.join()
        server.close()


def _detector() -> Detector:
    return Nobody()


def _answers(url: str) -> bool:
    try:
        return Browser(url).get("/icon.svg")[0] == 200
    except OSError:
        return False


@dataclass
class Browser:
    """Keeps a cookie; sends the headers that a browser would."""

    url: str
    cookie: str = ""
    agent: str = AGENT

    @property
    def host(self) -> str:
        return urlsplit(self.url).netloc

    def get(self, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
        return self.request("GET", path, None, **headers)

    def request(self, method: str, path: str, body: bytes | None, **headers: str) -> tuple[int, dict[str, str], bytes]:
        connection = http.client.HTTPConnection(self.host, timeout=10.0)
        sent = {"User-Agent": self.agent, **({"Cookie": f"sidestep={self.cookie}"} if self.cookie else {})}
        sent |= {name.replace("_", "-"): value for name, value in headers.items()}
        try:
            connection.request(method, path, body, sent)
            answer = connection.getresponse()
            found = {name.lower(): value for name, value in answer.getheaders()}
            return answer.status, found, answer.read()
        finally:
            connection.close()

    def open(self) -> None:
        """The page, and the cookie that comes with it."""
        status, headers, _ = self.get("/")
        assert status == 200
        self._keep(headers)

    def login(self, password: str, origin: str | None = None) -> int:
        body = urlencode({"password": password}).encode()
        kind = "application/x-www-form-urlencoded"
        status, headers, _ = self.request(
            "POST", "/login", body, Origin=origin or self.url.rstrip("/"), Content_Type=kind
        )
        self._keep(headers)
        return status

    def _keep(self, headers: dict[str, str]) -> None:
        if "set-cookie" in headers:
            self.cookie = headers["set-cookie"].split(";")[0].partition("=")[2]

    @contextmanager
    def live(self, origin: str | None = None) -> Iterator[Wire]:
        """The page's connection."""
        with connect(
            self.url.replace("http", "ws", 1) + "live",
            origin=Origin(origin or self.url.rstrip("/")),
            additional_headers={"Cookie": f"sidestep={self.cookie}"},
            user_agent_header=self.agent,
            open_timeout=10.0,
            compression=None,
        ) as socket:
            yield Wire(socket)


@dataclass
class Wire:
    """One connection of a page."""

    socket: ClientConnection
    count: int = 0

    def next(self, kind: str, timeout_s: float = 10.0) -> dict[str, Any]:
        """The next message of a kind; pictures are acknowledged."""
        deadline = time.monotonic() + timeout_s
        while True:
            message = self.socket.recv(max(0.01, deadline - time.monotonic()))
            if isinstance(message, bytes):
                length = int.from_bytes(message[:4], "big")
                header: dict[str, Any] = json.loads(message[4 : 4 + length])
                self.socket.send(json.dumps({"type": "ack", "id": header["id"]}))
                if kind == "picture":
                    return {**header, "jpeg": message[4 + length :]}
                continue
            found: dict[str, Any] = json.loads(message)
            if found["type"] == kind:
                return found

    def order(self, kind: str, **more: object) -> str:
        """Ask for something; why it is refused, or empty."""
        self.count += 1
        self.socket.send(json.dumps({"type": kind, "nr": self.count, **more}))
        answer = self.next("answer")
        assert answer["to"] == self.count
        return str(answer["refused"])


__all__ = ["Browser", "Console", "Taken", "Wire", "console", "until"]
