"""Who points the gimbal: us after we asked, nobody's rival, and never after it was taken."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import pytest
from pymavlink.dialects.v20 import all as mavlink

from mission.errors import LinkError
from mission.gimbal.control import GimbalControl

CONFIGURE = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE


@dataclass
class Link:
    source_system: int = 1
    source_component: int = 191
    target_system: int = 1
    target_component: int = 1
    result: int = mavlink.MAV_RESULT_ACCEPTED
    silent: bool = False
    sent: list[Any] = field(default_factory=list)
    ordered: list[tuple[int, tuple[float, ...]]] = field(default_factory=list)

    def send(self, message: Any) -> None:
        self.sent.append(message)

    def command(self, command: int, params: Sequence[float], *, timeout_s: float = 1.0, retries: int = 1) -> int:
        if self.silent:
            raise LinkError("the autopilot did not answer", "")
        self.ordered.append((command, tuple(params)))
        return self.result

    def angles(self) -> list[Any]:
        return [m for m in self.sent if m.get_type() == "GIMBAL_MANAGER_SET_PITCHYAW"]

    def released(self) -> int:
        long = [m for m in self.sent if m.get_type() == "COMMAND_LONG"]
        return sum(m.command == CONFIGURE and m.param1 == -3.0 for m in long)


class Clock:
    now = 10.0

    def __call__(self) -> float:
        return self.now


def status(system: int, component: int) -> Any:
    return mavlink.MAVLink_gimbal_manager_status_message(0, 28, 1, system, component, 0, 0)


def test_control_is_asked_for_before_anything_is_pointed() -> None:
    link, clock = Link(), Clock()
    control = GimbalControl(link, clock)
    control.point(1.0, -0.3)
    assert link.angles() == []
    assert control.take() == ""
    assert link.ordered == [(CONFIGURE, (1.0, 191.0, -1.0, -1.0, 0.0, 0.0, 0.0))]
    control.point(4.0, -0.3)
    (angles,) = link.angles()
    assert angles.flags & mavlink.GIMBAL_MANAGER_FLAGS_YAW_LOCK
    assert angles.yaw == pytest.approx(4.0 - 2.0 * math.pi)
    assert angles.pitch == pytest.approx(-0.3)


def test_angles_are_not_sent_more_often_than_they_are_of_use() -> None:
    link, clock = Link(), Clock()
    control = GimbalControl(link, clock)
    control.take()
    for k in range(100):
        clock.now = 10.0 + 0.01 * k
        control.point(0.1, math.nan if k == 50 else 0.0)
    assert 18 <= len(link.angles()) <= 21


@pytest.mark.parametrize(("result", "silent"), [(mavlink.MAV_RESULT_UNSUPPORTED, False), (0, True)])
def test_a_gimbal_that_we_are_not_given_is_left_alone(result: int, silent: bool) -> None:
    link = Link(result=result, silent=silent)
    control = GimbalControl(link, Clock())
    assert control.take()
    control.point(1.0, 0.0)
    control.release()
    assert link.sent == []


def test_who_takes_it_is_never_fought() -> None:
    link = Link()
    control = GimbalControl(link, Clock())
    control.take()
    control.heard(status(1, 191))
    control.heard(status(255, 190))
    assert not control.ours
    assert "component 190 of system 255 took the gimbal" in control.lost
    control.point(1.0, 0.0)
    control.release()
    assert link.angles() == []
    assert link.released() == 0


def test_a_status_of_before_our_control_takes_nothing_away() -> None:
    control = GimbalControl(Link(), Clock())
    control.heard(status(255, 190))
    control.take()
    control.heard(status(255, 190))
    control.heard(status(0, 0))
    assert control.ours
    assert control.lost == ""
    control.heard(status(1, 191))
    control.heard(status(0, 0))
    assert not control.ours


def test_it_is_given_back_once() -> None:
    link = Link()
    control = GimbalControl(link, Clock())
    control.take()
    control.release()
    control.release()
    assert link.released() == 1
    assert control.lost == ""
