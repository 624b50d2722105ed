"""The MAVLink camera component that ground stations talk to: https://mavlink.io/en/services/camera.html.

It has no thread. The loop that does the work calls `attend` (or `step`), so that a loop that hangs falls silent and the
stations see the camera go.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any, Final, Protocol, Self

from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority import Authority
from gcs_plugin.component.commands import COMMAND_MESSAGES, CommandServer
from gcs_plugin.component.identity import HEARTBEAT_S, Identity, heartbeat
from gcs_plugin.component.information import Picture, information
from gcs_plugin.component.intervals import Intervals
from gcs_plugin.component.namesake import Namesake
from gcs_plugin.component.order_queue import OrderQueue
from gcs_plugin.component.orders import Order
from gcs_plugin.component.parameter_protocol import PARAMETER_MESSAGES, ParameterServer
from gcs_plugin.component.tracking import TrackedBox, camera_tracking_image_status
from gcs_plugin.publish.messages import Inbox, Link, StatusTexts
from mission.settings import MissionSettings

Message = Any
"""A pymavlink message: its classes are generated and untyped."""

IMAGE_STATUS: Final[int] = mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_IMAGE_STATUS
GEO_STATUS: Final[int] = mavlink.MAVLINK_MSG_ID_CAMERA_TRACKING_GEO_STATUS
DEFAULT_INTERVALS_US: Final[dict[int, int]] = {IMAGE_STATUS: 500_000, GEO_STATUS: 0}
_ORDERLY: Final = 300
"""Messages looked at in one step: the rest waits for the next, so that a flood does not starve the flight."""


class ComponentLink(Link, Protocol):
    """A link that sends as the component (`gcs_plugin.component.link.StationLink`)."""

    answer: Message | None
    """The newest CAMERA_TRACKING_GEO_STATUS that was sent."""

    def listen(self, *types: str, gate: Callable[[bytes, float], bool] | None = None) -> AbstractContextManager[Inbox]:
        """Collect messages of these types while the context lasts.

        Args:
            types: message names.
            gate: told the bytes and the arrival time of each, in another thread; answers whether it is let in.
        """
        ...


class Visitor(Protocol):
    """Somebody beside the link who gives orders and is told what stations are told: the console."""

    def turn(self) -> None:
        """Called in every round of the loop: keep it short."""
        ...

    def said(self, text: str) -> None:
        """The operator was told this."""
        ...


class CameraComponent:
    """Discovery, orders, tracking status, answer and parameters on one link. Use as a context.

    Args:
        link: sends as this component.
        identity: who it is.
        picture: the camera's video.
        settings: of the mission, as parameters.
        authority: who may give orders.
        refusal: why the aircraft cannot carry out an order now; empty when it can.
        clock: the program's clock, seconds.
        changed: is told the settings when a station has changed some.
        file: the settings file's own, whose safety limits no station widens; `settings` when omitted.
    """

    def __init__(
        self,
        link: ComponentLink,
        identity: Identity,
        picture: Picture,
        settings: MissionSettings,
        authority: Authority,
        refusal: Callable[[Order], str],
        clock: Callable[[], float] = time.monotonic,
        changed: Callable[[MissionSettings], None] = lambda _: None,
        file: MissionSettings | None = None,
    ) -> None:
        self._link = link
        self._changed = changed
        self._identity = identity
        self.picture = picture
        """The camera's video; replaced when it turns out to be another."""
        self.visitor: Visitor | None = None
        """Also looks in, and is told."""
        self._clock = clock
        self._authority = authority
        self._texts = StatusTexts(link)
        self._desk = OrderQueue(refusal)
        self._namesake = Namesake(identity, self.say)
        self._intervals = Intervals(DEFAULT_INTERVALS_US)
        self._parameters = ParameterServer(settings, identity.encoding, file, self.say)
        self._commands = CommandServer(
            identity,
            authority,
            self._desk,
            self._intervals,
            box_locates=lambda: self.settings.orders.box == "locate",
            namesake=self._namesake,
            requested=self._requested,
            send=link.send,
            say=self.say,
        )
        self._seen: TrackedBox | None = None
        self._started_s = clock()
        self._next_beat_s = self._started_s
        self._listening = link.listen("HEARTBEAT", *COMMAND_MESSAGES, *PARAMETER_MESSAGES, gate=authority.lets_in)
        self._inbox: Inbox | None = None

    def __enter__(self) -> Self:
        """Listen."""
        self._inbox = self._listening.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop listening."""
        self._inbox = None
        self._listening.__exit__(kind, error, trace)

    @property
    def settings(self) -> MissionSettings:
        """With what stations have changed."""
        return self._parameters.settings

    def attend(self, timeout_s: float) -> Order | None:
        """Wait a moment for messages, deal with them, send what is due.

        Returns:
            The next order to carry out; from here until `ended` it is the one that runs.
        """
        self.step(timeout_s)
        return self._desk.take()

    def step(self, timeout_s: float = 0.0) -> None:
        """As `attend`, but leave a new order waiting."""
        if self._inbox is not None:
            message = self._inbox.get(timeout_s)
            for _ in range(_ORDERLY):
                if message is None:
                    break
                self._take(message)
                message = self._inbox.get(0.0)
        if self.visitor is not None:
            self.visitor.turn()
        self._send_due(self._clock())

    @property
    def busy(self) -> bool:
        """Whether an order waits or runs."""
        return self._desk.busy

    @property
    def flying(self) -> bool:
        """Whether an order to fly waits or runs."""
        return self._desk.flying

    def order(self, order: Order) -> str:
        """Take an order of this program's own page; why not, or empty. To be called in the loop's own thread."""
        return self._commands.take_own(order, self._clock())

    def abort(self) -> None:
        """End whatever waits or runs, as a station's order to stop does."""
        self._commands.abort()

    def should_stop(self) -> bool:
        """Whether the order that runs should end: it was aborted, or another took its place."""
        return self._desk.should_stop()

    def progress(self, percent: int) -> None:
        """How far the order that runs has come."""
        self._commands.progress(percent, self._clock())

    def ended(self, result: int) -> None:
        """The order that ran has ended; the component is idle again.

        Args:
            result: MAV_RESULT, for a station that waits for it.
        """
        self.tracking(None)
        self._desk.done()
        if not self._desk.waiting:
            self._commands.ended(result, self._clock())

    def tracking(self, seen: TrackedBox | None) -> None:
        """Where the target is in the newest picture; None when nothing is tracked."""
        was, self._seen = self._seen, seen
        if seen is None and was is not None:
            self._link.send(camera_tracking_image_status(None))  # so that the box does not stay on the screen

    def say(self, text: str) -> None:
        """Tell the operator in a STATUSTEXT."""
        self._texts.send(f"sidestep: {text}")
        if self.visitor is not None:
            self.visitor.said(text)

    def _take(self, message: Message) -> None:
        now_s = self._clock()
        if message.get_type() == "HEARTBEAT":
            self._authority.hear(message)
            self._namesake.hear(message, now_s)
            return
        if message.get_type() in COMMAND_MESSAGES:
            self._commands.take(message, now_s)
            return
        for_us = message.target_component in (0, self._identity.component)
        if message.target_system not in (0, self._identity.system) or not for_us:
            return
        if self._authority.too_many(message, now_s):
            return
        may_change = message.get_type() == "PARAM_SET" and self._authority.refusal(message) is None
        before = self.settings
        for answer in self._parameters.take(message, may_change=may_change):
            self._link.send(answer)
        if self.settings is not before:
            self._changed(self.settings)

    def _send_due(self, now_s: float) -> None:
        if now_s >= self._next_beat_s:
            self._next_beat_s = max(self._next_beat_s + HEARTBEAT_S, now_s)
            self._link.send(heartbeat(self._identity, busy=self._desk.busy))
        self._commands.keep_up(now_s)
        wanted = self._seen is not None or self._intervals.asked(IMAGE_STATUS)
        if wanted and self._intervals.due(IMAGE_STATUS, now_s):
            self._link.send(camera_tracking_image_status(self._seen))
        if self._link.answer is not None and self._intervals.due(GEO_STATUS, now_s):
            self._link.send(self._link.answer)
        for message in self._parameters.due(now_s):
            self._link.send(message)

    def _requested(self, message_id: int) -> bool:
        """Send a message that a station asked for; False when there is no such message."""
        now_s = self._clock()
        if message_id == IMAGE_STATUS:
            message = camera_tracking_image_status(self._seen)
        elif message_id == GEO_STATUS:
            message = self._link.answer
        elif message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            message = heartbeat(self._identity, busy=self._desk.busy)
        else:
            boot_ms = int((now_s - self._started_s) * 1e3) % 2**32
            message = information(message_id, self._identity, self.picture, boot_ms)
        if message is None:
            return False
        self._link.send(message)
        return True
