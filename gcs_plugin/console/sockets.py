"""A page's connection: pictures and state out, orders in; a page that is slow gets fewer pictures and delays nobody.

Every picture is acknowledged by the page before the one after the next is sent, which is the newest then. Text messages
are JSON; a picture is a binary message: four bytes length (big-endian), a JSON header of that length, the JPEG.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from starlette.websockets import WebSocket, WebSocketDisconnect

from gcs_plugin.authority.rate import TokenBucket
from gcs_plugin.component.orders import Order
from gcs_plugin.console.access import Session
from gcs_plugin.console.command import Command
from gcs_plugin.console.desk import ANSWER_S, ConsoleDesk, hand_to_autopilot
from gcs_plugin.console.people import Lookout
from gcs_plugin.console.pictures import Picture
from gcs_plugin.console.state import state_json
from gcs_plugin.console.targets import target_json

STATE_S: Final = 0.2
MOST_PAGES: Final = 16
_SEND_S: Final = 10.0
_MESSAGES_PER_S: Final = 60.0
_UNDERWAY: Final = 2
"""Pictures on their way to a page that it has not acknowledged yet."""
_PATIENCE_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class Room:
    """What all pages share."""

    desk: ConsoleDesk
    lookout: Lookout
    command: Command
    clock: Callable[[], float]


class Page:
    """One page's connection.

    Args:
        socket: accepted.
        session: whose page it is.
        room: what it shows.
    """

    def __init__(self, socket: WebSocket, session: Session, room: Room) -> None:
        self._socket = socket
        self._session = session
        self._room = room
        self._bucket = TokenBucket(_MESSAGES_PER_S, 2.0 * _MESSAGES_PER_S)
        self._news = asyncio.Event()
        self._sent = self._acknowledged = 0
        self._loop = asyncio.get_running_loop()

    async def run(self) -> None:
        """Until the page goes."""
        desk, command = self._room.desk, self._room.command
        desk.pictures.watch(self._tell)
        command.opened(self._session.id)
        tasks = [asyncio.ensure_future(work()) for work in (self._listen, self._show, self._report)]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            desk.pictures.leave(self._tell)
            command.closed(self._session.id)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    def _tell(self) -> None:
        """A new picture is there; called in another thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._news.set)

    async def _listen(self) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while True:
                text = await self._socket.receive_text()
                if not self._bucket.take(self._room.clock()):
                    await self._socket.close(1008)
                    return
                await self._take(text)

    async def _take(self, text: str) -> None:
        """A message; one that says nothing is passed over."""
        try:
            message = json.loads(text)
        except (ValueError, RecursionError):
            return
        if not isinstance(message, dict):
            return
        kind = message.get("type")
        if kind == "ack":
            self._acknowledge(message.get("id"))
        elif kind in ("take", "release", "mark", "unmark", "locate", "abort", "give"):
            why = await self._do(str(kind), message)
            await self._send({"type": "answer", "to": message.get("nr"), "of": kind, "refused": why})

    def _acknowledge(self, number: object) -> None:
        if isinstance(number, int) and not isinstance(number, bool):
            self._acknowledged = max(self._acknowledged, min(number, self._sent))
            self._news.set()

    async def _do(self, kind: str, message: Mapping[str, Any]) -> str:
        """Carry out what a commander asks for; why not, or empty."""
        session, command, desk = self._session, self._room.command, self._room.desk
        if session.role != "commander":
            return "viewers give no orders"
        if kind == "abort":  # from whoever may command, also where another one does
            return await self._answered(None)
        if kind == "release":
            command.release(session.id)
            return ""
        if why := command.take(session.id, session.name):
            return why
        if kind == "take":
            return ""
        if kind == "unmark":
            return "" if desk.status is None or desk.status.flying else await self._answered(None)
        order = self._ordered(kind, message)
        if not isinstance(order, str):
            desk.said(f"{session.name} orders: {kind}")
        return order if isinstance(order, str) else await self._answered(order)

    def _ordered(self, kind: str, message: Mapping[str, Any]) -> Order | str:
        """The order that a message gives, or why there is none."""
        if kind == "locate":
            return self._room.desk.locate()
        if kind == "mark":
            return self._marked(message)
        return hand_to_autopilot(str(message.get("what"))) or "there is no such order"

    def _marked(self, message: Mapping[str, Any]) -> Order | str:
        picture, box = message.get("picture"), message.get("box")
        numbers = isinstance(box, list) and len(box) == 4 and all(type(n) in (int, float) for n in box)
        if type(picture) is not int or not isinstance(box, list) or not numbers:
            return "the mark cannot be read"
        left, top, right, bottom = (float(n) for n in box)
        return self._room.desk.mark(picture, (left, top, right, bottom))

    async def _answered(self, order: Order | None) -> str:
        answer = asyncio.wrap_future(self._room.desk.order(order))
        try:
            return await asyncio.wait_for(answer, ANSWER_S)
        except (TimeoutError, asyncio.CancelledError):
            return "the drone's link does not answer; look at the aircraft"

    async def _show(self) -> None:
        """Pictures, the newest each time."""
        while True:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), _PATIENCE_S)
            self._news.clear()
            picture = self._room.desk.pictures.newest
            behind = self._sent - self._acknowledged
            if picture is None or picture.id <= self._sent or (self._acknowledged and behind > _UNDERWAY):
                continue
            self._sent = picture.id
            if not self._acknowledged:
                self._acknowledged = picture.id - 1
            await asyncio.wait_for(self._socket.send_bytes(picture_message(picture, self._room.clock())), _SEND_S)

    async def _report(self) -> None:
        """The state, news and the list of targets."""
        room, news, version = self._room, 0, -1
        await self._send({"type": "hello", "you": self._session.name, "role": self._session.role})
        while True:
            holder = room.command.holder()
            commander = None if holder is None else {"name": holder[1], "you": holder[0] == self._session.id}
            state = state_json(room.desk, room.lookout, room.clock)
            await self._send({"type": "state", "commander": commander, **state})
            lines = room.desk.news(news)
            if lines:
                news = lines[-1].number
                now_s = room.clock()
                told = [{"age": round(now_s - line.t_s, 1), "text": line.text} for line in lines]
                await self._send({"type": "news", "lines": told})
            targets = await asyncio.to_thread(room.desk.targets.newest)
            if room.desk.targets.version != version:
                version = room.desk.targets.version
                await self._send({"type": "targets", "targets": [target_json(geotag) for geotag in targets]})
            await asyncio.sleep(STATE_S)

    async def _send(self, message: Mapping[str, object]) -> None:
        text = json.dumps(message, allow_nan=False, separators=(",", ":"))
        await asyncio.wait_for(self._socket.send_text(text), _SEND_S)


def picture_message(picture: Picture, now_s: float) -> bytes:
    """A picture with its header: number, age in seconds when it was sent, box as fractions, state of the track."""
    header = {"id": picture.id, "age": round(now_s - picture.t_s, 3), "box": picture.box, "track": picture.state}
    coded = json.dumps(header, separators=(",", ":")).encode("ascii")
    return len(coded).to_bytes(4, "big") + coded + picture.jpeg
