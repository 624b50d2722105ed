"""The answer goes to a simulated autopilot over a real link that loses packets."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from urllib.parse import urlsplit

import numpy as np
import pytest

from gcs_plugin.publish.messages import set_region_of_interest
from gcs_plugin.publish.mission_items import append_item, standoff_waypoint
from gcs_plugin.publish.mission_protocol import MissionItem, MissionProtocol
from mission.geodesy import enu_to_geodetic, geodetic_to_enu
from mission.records import GeodeticOrigin
from mission.vehicle.mavlink.link import MavlinkLink
from sitl.autopilot import AutopilotConfig, start_autopilot
from sitl.autopilot.process import AutopilotProcess
from tests.support.fake_autopilot import ARDUPILOT, PX4, plan

HOME = GeodeticOrigin(37.2276, 126.8405, 30.0, "amsl")
Connected = tuple[AutopilotProcess, MavlinkLink]


@pytest.fixture(params=["px4", "ardupilot"])
def connected(request: pytest.FixtureRequest) -> Iterator[Connected]:
    autopilot = start_autopilot(AutopilotConfig(flavour=request.param, noise="none", home=HOME, operator_port=None))
    link: MavlinkLink | None = None
    try:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind(("127.0.0.1", urlsplit(autopilot.url).port or 0))
        link = MavlinkLink(sock, source_system=245, source_component=191)
        until = time.monotonic() + 10.0
        with link.listen("HEARTBEAT") as beats:
            while link.target_system == 0 and time.monotonic() < until:
                beats.get(0.2)
        yield autopilot, link
    finally:
        if link is not None:
            link.close()
        autopilot.stop()


@pytest.mark.flight
def test_the_waypoint_joins_the_operators_plan_and_the_nose_gets_its_region_of_interest(connected: Connected) -> None:
    autopilot, link = connected
    protocol = MissionProtocol(link, answer_timeout_s=0.25)
    operators = plan(ARDUPILOT if autopilot.config.flavour == "ardupilot" else PX4)
    protocol.upload(operators)
    before = protocol.download()
    assert len(before) == len(operators)
    autopilot.lose(0.1)
    target = enu_to_geodetic(np.array([2.0, 9.0, 0.9]), HOME)
    drone = enu_to_geodetic(np.array([0.0, 0.0, 3.0]), HOME)
    waypoint = standoff_waypoint(target, drone, distance_m=5.0)
    number = append_item(protocol, waypoint).number
    set_region_of_interest(link, target)
    autopilot.lose(0.0)

    after = protocol.download()
    assert number == len(operators)
    home = 1 if autopilot.config.flavour == "ardupilot" else 0
    assert [_bits(item) for item in after[home:-1]] == [_bits(item) for item in before[home:]]
    place = geodetic_to_enu(after[-1].x / 1e7, after[-1].y / 1e7, 30.0, HOME)
    assert np.hypot(*(place[:2] - [2.0, 9.0])) == pytest.approx(5.0, abs=0.05)
    assert after[-1].z == pytest.approx(drone.alt_m, abs=0.02)
    assert autopilot.state()["roi_enu_m"] == pytest.approx([2.0, 9.0, 0.9], abs=0.05)


def _bits(item: MissionItem) -> tuple[object, ...]:
    return (
        item.frame,
        item.command,
        item.x,
        item.y,
        item.autocontinue,
        np.array([*item.params, item.z], dtype=np.float32).tobytes(),
    )
