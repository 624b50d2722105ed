from __future__ import annotations

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.vehicle.state.packet_loss import PacketLoss


def _frames(count: int, component: int = 1) -> list[bytes]:
    packer = mavlink.MAVLink(None, 1, component)
    found = []
    for _ in range(count):
        found.append(bytes(mavlink.MAVLink_system_time_message(0, 0).pack(packer)))
        packer.seq = (packer.seq + 1) % 256
    return found


@pytest.mark.parametrize("loss", [0.0, 0.05, 0.2, 0.4])
def test_the_loss_is_measured_from_the_gaps(loss: float) -> None:
    rng, meter = np.random.default_rng(4), PacketLoss()
    for i, frame in enumerate(_frames(1500)):
        if rng.random() >= loss:
            meter.observe(frame, 1, i / 300.0)
    assert meter.fraction(5.0) == pytest.approx(loss, abs=0.05)


def test_doubled_and_overtaken_packets_are_not_lost() -> None:
    meter, frames = PacketLoss(), _frames(900)
    for i in range(0, 900, 3):
        for frame in (frames[i + 1], frames[i], frames[i], frames[i + 2]):
            meter.observe(frame, 1, i / 300.0)
    assert meter.fraction(3.0) == pytest.approx(0.0, abs=0.01)


def test_few_packets_other_senders_and_old_times_say_nothing() -> None:
    meter = PacketLoss()
    for frame in _frames(90):
        meter.observe(frame, 1, 0.0)
    for frame in _frames(300, component=100):
        meter.observe(frame, 1, 0.0)
    for frame in _frames(300):
        meter.observe(frame, 7, 0.0)
    assert meter.fraction(0.1) is None
    for frame in _frames(300):
        meter.observe(frame, 1, 1.0)
    assert meter.fraction(1.1) is not None
    assert meter.fraction(60.0) is None
