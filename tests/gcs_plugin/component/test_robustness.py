"""Whatever comes: no exception, no memory without bounds, and the component goes on answering."""

from __future__ import annotations

import gc

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.component import CameraComponent
from gcs_plugin.component.commands import COMMAND_MESSAGES
from gcs_plugin.component.parameter_protocol import PARAMETER_MESSAGES
from mission.vehicle.mavlink.framing import decode
from tests.support.component_bench import Bench

FRAMES = 10_000


HANDLED = (*COMMAND_MESSAGES, *PARAMETER_MESSAGES)
COMMANDS = (31010, 31011, 31012, 2004, 2005, 2010, 510, 511, 512, 521, 2504)


def random_messages(rng: np.random.Generator, count: int) -> list[mavlink.MAVLink_message]:
    """Valid frames of the handled types with random contents, for the component or not, from anybody."""
    kinds = [kind for kind in mavlink.mavlink_map.values() if kind.msgname in HANDLED]
    parser = mavlink.MAVLink(None)
    found: list[mavlink.MAVLink_message] = []
    while len(found) < count:
        kind = kinds[rng.integers(len(kinds))]
        values = dict(zip(kind.ordered_fieldnames, kind.unpacker.unpack(rng.bytes(kind.unpacker.size)), strict=True))
        if rng.random() < 0.9:
            values |= {"target_system": 1, "target_component": 100}
        if "command" in values and rng.random() < 0.9:
            values["command"] = int(rng.choice(COMMANDS))
        payload = kind.unpacker.pack(*(values[name] for name in kind.ordered_fieldnames))
        sender = mavlink.MAVLink(None, 255 if rng.random() < 0.8 else int(rng.integers(256)), int(rng.integers(256)))
        blank = kind(*(values[name] for name in kind.fieldnames))
        message = decode(parser, blank._pack(sender, kind.crc_extra, payload))
        if message is not None:
            found.append(message)
    return found


def still_answers(component: CameraComponent, bench: Bench) -> bool:
    bench.step(2.0)
    bench.take()
    bench.command(mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION, 1.0)
    bench.step()
    return len(bench.take("CAMERA_INFORMATION")) == 1


def test_random_contents_of_every_handled_message() -> None:
    bench = Bench()
    rng = np.random.default_rng(5)
    messages = random_messages(rng, FRAMES // 5)
    alive = []
    for _ in range(5):
        for message in messages:
            bench.wire.waiting.append(message)
            if rng.random() < 0.02:
                if bench.turn(0.05) is not None and rng.random() < 0.5:
                    bench.component.ended(int(rng.integers(5)))
                bench.take()
        bench.turn(10.0)
        bench.take()
        gc.collect()
        alive.append(len(gc.get_objects()))
    assert still_answers(bench.component, bench)
    assert alive[-1] - alive[1] < 50


def test_a_flood_of_one_sender_does_not_starve_the_others() -> None:
    bench = Bench()
    for _ in range(5000):
        bench.command(mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION, 1.0, source=(77, 1))
    for _ in range(20):
        bench.step(0.05)
    assert len(bench.take("CAMERA_INFORMATION")) <= 200
    assert bench.authority.counts["too-many"] >= 4000
    bench.command(mavlink.MAV_CMD_REQUEST_CAMERA_INFORMATION, 1.0)
    bench.step()
    assert len(bench.take("CAMERA_INFORMATION")) == 1
