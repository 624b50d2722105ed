"""Commands and navdata over a radio that loses, doubles and reorders."""

from __future__ import annotations

import struct
import time

from sitl.ardrone.wifi import bad_wifi
from sitl.faults.relay import LinkFaults
from tests.sitl.ardrone.test_server import BOOTSTRAP, Wire
from tests.support.live_ardrone import ANY_PORTS, flying, until

FAULTS = LinkFaults(loss=0.2, duplicate=0.1, reorder=0.1)


def test_a_pilot_who_repeats_itself_gets_through() -> None:
    with flying(ANY_PORTS) as server, bad_wifi(server.ports, FAULTS) as ports, Wire(ports) as wire:

        def awake() -> bool:
            wire.wake()
            wire.send("CONFIG", '"general:navdata_demo","FALSE"')
            return wire.hears() and wire.newest()[0] & BOOTSTRAP == 0

        assert until(awake, 5.0)

        def airborne() -> bool:
            wire.send("REF", "290718208")
            time.sleep(0.03)
            return server.drone.commander.state.in_the_air

        assert until(airborne, 3.0)


def test_navdata_arrives_with_gaps_doubles_and_out_of_order() -> None:
    with flying(ANY_PORTS) as server, bad_wifi(server.ports, FAULTS) as ports, Wire(ports) as wire:

        def awake() -> bool:
            wire.wake()
            return wire.hears()

        assert until(awake, 5.0)
        server.drone.configuration.set("general:navdata_demo", "FALSE")
        numbers = [struct.unpack_from("<I", wire.navdata.recv(4096), 8)[0] for _ in range(150)]
    assert len(set(numbers)) < len(numbers)
    assert numbers != sorted(numbers)
    assert len(set(numbers)) < max(numbers) - min(numbers)
