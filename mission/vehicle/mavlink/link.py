"""`MavlinkLink`: pymavlink on a loopback UDP socket, behind the connection that the pilot process owns."""

from __future__ import annotations

import contextlib
import logging
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.mavlink.command_protocol import CommandProtocol, Patience
from mission.vehicle.mavlink.datagrams import Address, Datagrams
from mission.vehicle.mavlink.framing import MESSAGE_IDS, decode, frames
from mission.vehicle.mavlink.mailbox import Mailbox, Message

_LOG = logging.getLogger(__name__)

Gate = Callable[[bytes, float], bool]
"""Whether a whole frame that arrived at a time (monotonic seconds) is let in."""


class MavlinkLink:
    """One side of a MAVLink connection over UDP: sends, listens, commands; its own heartbeat keeps it known.

    Frames of types that nobody listens to are not decoded. Nothing that arrives raises: broken frames are counted in
    `rejected`. Only datagrams from the address that sent the first valid frame are read.

    Args:
        sock: a bound UDP socket; the link owns it from here on.
        source_system: our system id.
        source_component: our component id.
        target_system: the vehicle; 0 takes the first autopilot that is heard.
        handler: called in the reader thread with each message of `handled` types, with its arrival time. It must not
            raise and not block.
        handled: message names for the handler.
        heartbeat: whether the link sends HEARTBEAT once a second.
        wants: called in the reader thread with id and bytes of every whole frame, and its arrival time; what it answers
            False to is not decoded.
        at_leisure: answers whether frames may wait some hundredths of a second, to be read together.
        clock: monotonic seconds.
    """

    def __init__(
        self,
        sock: socket.socket,
        *,
        source_system: int,
        source_component: int,
        target_system: int = 0,
        handler: Callable[[Message, float], None] | None = None,
        handled: Sequence[str] = (),
        heartbeat: bool = True,
        wants: Callable[[int, bytes, float], bool] | None = None,
        at_leisure: Callable[[float], bool] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.source_system = source_system
        self.source_component = source_component
        self.target_system = target_system
        self.target_component: int = mavlink.MAV_COMP_ID_AUTOPILOT1
        self.rejected = 0
        """Frames that were broken, and datagrams from strangers."""
        self.dropped = 0
        """Messages that could not be sent."""
        self.received: Counter[str] = Counter()
        """Decoded messages by name."""
        self._socket = sock
        self._datagrams = Datagrams(sock, clock)
        self._clock = clock
        self._handler = handler
        self._handled = frozenset(handled)
        self._parser = mavlink.MAVLink(None)
        self._packers: dict[int, mavlink.MAVLink] = {}
        self._signers: dict[int, Callable[[], int]] = {}
        self._sending = threading.Lock()
        self._peer: Address | None = None
        self._boxes: list[tuple[frozenset[str], Mailbox, Gate | None]] = []
        self._boxes_lock = threading.Lock()
        self._boxes_of: dict[int, tuple[tuple[Mailbox, Gate | None], ...]] = {}
        self._handled_ids = frozenset(MESSAGE_IDS[n] for n in (*handled, "HEARTBEAT"))
        self._commands = CommandProtocol(self, clock)
        self._heartbeat = heartbeat
        self._wants = wants
        self._at_leisure = at_leisure
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="mavlink-link", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The local UDP port; 0 when closed."""
        return 0 if self._closed.is_set() else int(self._socket.getsockname()[1])

    @property
    def connected(self) -> bool:
        """Whether anything valid was ever received."""
        return self._peer is not None

    def close(self) -> None:
        """Stop reading and free the port. Safe to call twice."""
        self._closed.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(2.0)
        self._socket.close()

    def send(self, message: Message, *, source_component: int | None = None) -> None:
        """Pack and send a message. Thread-safe, never blocks, never raises for the network: what cannot go is counted.

        Args:
            message: of pymavlink's v20 dialects.
            source_component: send it as this component of ours.
        """
        component = self.source_component if source_component is None else source_component
        with self._sending:
            packer = self._packer(component)
            packer.srcSystem = self.source_system
            if component in self._signers:
                packer.signing.timestamp = max(packer.signing.timestamp, self._signers[component]())
            data = message.pack(packer)
            packer.seq = (packer.seq + 1) % 256
            if self._peer is None or self._closed.is_set():
                self.dropped += 1
                return
            try:
                self._socket.sendto(data, socket.MSG_DONTWAIT, self._peer)
            except OSError:
                self.dropped += 1

    def sign_as(self, component: int, key: bytes, timestamp: Callable[[], int]) -> None:
        """From here on sign what is sent as this component (MAVLink 2 message signing).

        Args:
            component: of ours.
            key: 32 bytes.
            timestamp: the next one, 10 us since 2015; it is made to grow with each message.
        """
        with self._sending:
            signing = self._packer(component).signing
            signing.secret_key, signing.sign_outgoing = key, True
            self._signers[component] = timestamp

    def _packer(self, component: int) -> mavlink.MAVLink:
        packer = self._packers.get(component)
        if packer is None:
            packer = self._packers[component] = mavlink.MAVLink(None, self.source_system, component)
        return packer

    @contextlib.contextmanager
    def listen(self, *types: str, size: int = 200, gate: Gate | None = None) -> Iterator[Mailbox]:
        """A mailbox that collects messages of these names from the whole link while the context lasts.

        Args:
            types: message names.
            size: when more wait, the oldest go.
            gate: called in the reader thread with the bytes of each such frame and its arrival time; what it answers
                False to does not get into the mailbox, nor is it decoded for it. It must not raise and not block.

        Raises:
            ValueError: a name that is not in the MAVLink dialect.
        """
        unknown = [t for t in types if t not in MESSAGE_IDS]
        if unknown:
            raise ValueError(f"no MAVLink message is called {', '.join(unknown)}")
        entry = (frozenset(types), Mailbox(size), gate)
        with self._boxes_lock:
            self._boxes.append(entry)
            self._sort_boxes()
        try:
            yield entry[1]
        finally:
            with self._boxes_lock:
                self._boxes = [e for e in self._boxes if e is not entry]
                self._sort_boxes()

    def command(
        self,
        command: int,
        params: Sequence[float],
        *,
        timeout_s: float = 0.7,
        retries: int = 4,
        progress_timeout_s: float = 30.0,
        source_component: int | None = None,
    ) -> int:
        """Send COMMAND_LONG until it is answered (MAVLink command protocol: `confirmation` counts the repetitions).

        Args:
            command: MAV_CMD.
            params: up to seven; the rest are 0.
            timeout_s: wait for an answer before sending again.
            retries: how often to send again.
            progress_timeout_s: wait after each IN_PROGRESS.
            source_component: order as this component of ours.

        Returns:
            MAV_RESULT of the final COMMAND_ACK.

        Raises:
            LinkError: nothing answered.
        """
        seven = [*map(float, params), *([0.0] * 7)][:7]

        def build(attempt: int) -> Message:
            return mavlink.MAVLink_command_long_message(
                self.target_system, self.target_component, command, min(attempt, 255), *seven
            )

        patience = Patience(timeout_s, retries, progress_timeout_s)
        return self._commands.order(build, command, patience, source_component)

    def command_int(
        self,
        command: int,
        params: Sequence[float],
        x: int,
        y: int,
        z: float,
        *,
        frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        timeout_s: float = 0.7,
        retries: int = 4,
        progress_timeout_s: float = 30.0,
        source_component: int | None = None,
    ) -> int:
        """Send COMMAND_INT until it is answered; `x` and `y` are degrees times 1e7 in global frames. See `command`."""
        four = [*map(float, params), *([0.0] * 4)][:4]

        def build(attempt: int) -> Message:
            del attempt  # COMMAND_INT has no confirmation field.
            return mavlink.MAVLink_command_int_message(
                self.target_system, self.target_component, frame, command, 0, 0, *four, x, y, z
            )

        patience = Patience(timeout_s, retries, progress_timeout_s)
        return self._commands.order(build, command, patience, source_component)

    def _sort_boxes(self) -> None:
        boxes_of: dict[int, tuple[tuple[Mailbox, Gate | None], ...]] = {}
        for types, box, gate in self._boxes:
            for message_id in (MESSAGE_IDS[name] for name in types):
                boxes_of[message_id] = (*boxes_of.get(message_id, ()), (box, gate))
        self._boxes_of = boxes_of

    def _run(self) -> None:
        next_beat = 0.0
        while not self._closed.is_set():
            now = self._clock()
            if self._heartbeat and now >= next_beat:
                next_beat = now + 1.0
                kind, active = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_STATE_ACTIVE
                self.send(mavlink.MAVLink_heartbeat_message(kind, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, active, 3))
            try:
                found = self._datagrams.receive(at_leisure=self._at_leisure is not None and self._at_leisure(now))
            except OSError as error:
                # An ICMP "port unreachable" from the far side, or the socket was closed.
                if not self._closed.is_set():
                    _LOG.debug("link: %s", error)
                    self._closed.wait(0.05)
                continue
            if found is not None:
                self._take(*found)

    def _take(self, data: bytes, peer: Address, arrived_s: float) -> None:
        if self._peer is not None and peer != self._peer:
            self.rejected += 1
            return
        for message_id, frame in frames(data):
            wanted = self._wants is None or self._wants(message_id, frame, arrived_s)
            boxes = [
                box
                for box, gate in (self._boxes_of.get(message_id, ()) if wanted else ())
                if gate is None or gate(frame, arrived_s)
            ]
            if self._peer is not None and not boxes and not (wanted and message_id in self._handled_ids):
                continue
            message = decode(self._parser, frame)
            if message is None:
                self.rejected += 1
                continue
            self._peer = peer
            self._deliver(message, boxes, arrived_s)

    def _deliver(self, message: Message, boxes: Sequence[Mailbox], arrived_s: float) -> None:
        name = message.get_type()
        self.received[name] += 1
        if (
            self.target_system == 0
            and name == "HEARTBEAT"
            and message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1
            and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
        ):
            self.target_system = message.get_srcSystem()
        for box in boxes:
            box.put(message)
        if self._handler is not None and name in self._handled:
            self._handler(message, arrived_s)
