"""A datagram's time is that of its arrival, not of its reading; a time of the kernel that cannot be is not believed."""

from __future__ import annotations

import socket
import sys
import time

import pytest

from mission.vehicle.mavlink.datagrams import Datagrams
from mission.vehicle.pilot.loopback import loopback_socket


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells")
@pytest.mark.parametrize("at_leisure", [False, True])
def test_what_is_read_late_arrived_when_it_did(at_leisure: bool) -> None:
    with loopback_socket() as near, loopback_socket() as far:
        datagrams = Datagrams(near, time.monotonic)
        late_s = [reading_moved_the_arrival(datagrams, near, far, at_leisure=at_leisure) for _ in range(3)]
        # The kernel begins to stamp a moment after it is asked: the first may come without a time of its own.
        assert late_s[1:] == pytest.approx([0.0, 0.0], abs=0.1)


def reading_moved_the_arrival(
    datagrams: Datagrams, near: socket.socket, far: socket.socket, *, at_leisure: bool
) -> float:
    """By how much one that waits for 0.2 s seems to have arrived later than it was sent."""
    far.sendto(b"one", near.getsockname())
    sent_s = time.monotonic()
    time.sleep(0.2)  # it waits to be read
    found = datagrams.receive(at_leisure=at_leisure)
    assert found is not None
    data, sender, arrived_s = found
    assert (data, sender) == (b"one", far.getsockname())
    return arrived_s - sent_s


@pytest.mark.parametrize("at_leisure", [False, True])
def test_nothing_is_nothing_after_a_moment(at_leisure: bool) -> None:
    with loopback_socket() as near:
        began_s = time.monotonic()
        assert Datagrams(near, time.monotonic).receive(at_leisure=at_leisure) is None
        assert 0.01 < time.monotonic() - began_s < 5.0


def test_a_time_from_before_the_clock_was_set_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    with loopback_socket() as near, loopback_socket() as far:
        datagrams = Datagrams(near, lambda: 7.0)
        far.sendto(b"one", near.getsockname())
        an_hour_on = time.time() + 3600.0
        monkeypatch.setattr(time, "time", lambda: an_hour_on)
        found = datagrams.receive()
        assert found is not None
        assert found[2] == 7.0


def test_a_rest_is_short_in_a_flood_and_long_again_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    rests_s: list[float] = []
    monkeypatch.setattr("mission.vehicle.mavlink.datagrams.time.sleep", rests_s.append)
    now_s = [50.0]
    with loopback_socket() as near, loopback_socket() as far:
        datagrams = Datagrams(near, lambda: now_s[0])
        for count in (0, 12, 200, 200, 0):
            for _ in range(count):
                far.sendto(b"x", near.getsockname())
            now_s[0] += 0.04
            while datagrams.receive(at_leisure=True) is not None:
                pass
    assert rests_s[0] == rests_s[1] == rests_s[4] == 0.04
    assert rests_s[2] == rests_s[3] == pytest.approx(0.02)  # in which 100 gather
