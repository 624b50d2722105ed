"""A bad Wi-Fi between an AR.Drone and its pilot: AT commands and navdata get lost, doubled and out of order.

The video has TCP to mend that and passes untouched.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace

from sitl.ardrone.server import Ports
from sitl.faults.relay import FaultRelay, LinkFaults


@contextmanager
def bad_wifi(ports: Ports, faults: LinkFaults, seed: int = 1) -> Iterator[Ports]:
    """Stand between an aircraft on 127.0.0.1 and its pilot.

    Args:
        ports: the aircraft's.
        faults: in both directions, of both ports.
        seed: of all faults.

    Yields:
        The ports at which the pilot finds the aircraft now.
    """
    with ExitStack() as stack:
        taken = {"at": ports.at, "navdata": ports.navdata}
        for number, (name, port) in enumerate(taken.items()):
            # The pilot speaks first here: it stands where the relay expects an aircraft.
            relay = FaultRelay(port, seed=seed + number)
            stack.callback(relay.close)
            relay.set(faults)
            taken[name] = relay.vehicle_port
        yield replace(ports, at=taken["at"], navdata=taken["navdata"])
