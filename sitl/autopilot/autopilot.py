"""The simulated autopilot without sockets and without a clock of its own: `step(now)` and bytes on `Link`s.

Everything that happens follows from the configuration, the times passed in and the bytes received.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sitl.autopilot.config import AutopilotConfig
from sitl.autopilot.flight_stack import FlightStack
from sitl.autopilot.link import Link
from sitl.autopilot.peers import Peers
from sitl.autopilot.requests import Requests


class Autopilot(FlightStack):
    """A flight stack that is spoken to over links.

    Args:
        config: what to simulate.
        now: monotonic seconds of the first step.
        unix_s: UTC seconds at `now`, for SYSTEM_TIME.
    """

    def __init__(self, config: AutopilotConfig, now: float, unix_s: float) -> None:
        super().__init__(config, now, unix_s)
        # the third child: the flight stack has the first two
        radio = np.random.default_rng(np.random.SeedSequence(config.seed).spawn(3)[2])
        self._peers = Peers(self, radio)
        self._requests = Requests(self, self._peers)

    @property
    def links(self) -> list[Link]:
        """To the peers."""
        return self._peers.links

    def add_link(self, write: Callable[[bytes], None]) -> Link:
        """A new peer; `write` gets every packet for it."""
        return self._peers.add(write)

    def remove_link(self, link: Link) -> None:
        """The peer is gone."""
        self._peers.remove(link)

    def receive(self, link: Link, data: bytes) -> None:
        """Bytes from a peer; anything at all."""
        for message in link.feed(data):
            if self._peers.route(link, message):
                self._requests.handle(link, message)

    def step(self, now: float) -> None:
        """Advance the aircraft by one tick and send what is due."""
        super().step(now)
        self._peers.transmit()
