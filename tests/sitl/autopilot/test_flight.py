"""Real pymavlink against the process, over TCP."""

from __future__ import annotations

import pytest
from pymavlink import mavutil

from sitl.autopilot import AutopilotConfig, start_autopilot

pytestmark = pytest.mark.flight


def test_it_serves_tcp_takes_faults_and_ends_with_its_parent() -> None:
    autopilot = start_autopilot(AutopilotConfig(tcp_port=0, operator_port=None))
    try:
        peer = mavutil.mavlink_connection(autopilot.tcp_url.replace("tcpout://", "tcp:"), source_system=254)
        assert peer.wait_heartbeat(timeout=3.0) is not None
        autopilot.cut(all_links=True)
        assert autopilot.state()["armed"] is False  # the order before it has been taken
        while peer.recv_match() is not None:
            pass
        assert peer.recv_match(blocking=True, timeout=0.6) is None
        autopilot.cut(False, all_links=True)
        assert peer.wait_heartbeat(timeout=3.0) is not None
        peer.close()
    finally:
        autopilot.stop()
    assert not autopilot.alive
