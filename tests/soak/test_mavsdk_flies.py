"""Real MAVSDK and real pymavlink against the autopilot alone: one flight for each flavour, both at once."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor

import pytest
from mavsdk.asyncio.mavsdk import Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.component_type import ComponentType
from mavsdk.mavsdk import Configuration
from mavsdk.plugins.mission_raw import MissionItem
from mavsdk.plugins.offboard import VelocityNedYaw
from mavsdk.plugins.telemetry import FlightMode
from pymavlink import mavutil

from sitl.aircraft.truth import TruthRing
from sitl.autopilot import AutopilotConfig, AutopilotProcess, start_autopilot
from sitl.autopilot.config import FlavourName

pytestmark = [pytest.mark.soak, pytest.mark.timeout(120)]


async def until(what: str, found: Callable[[], Awaitable[bool]], timeout_s: float = 15.0) -> None:
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        if await found():
            return
        await asyncio.sleep(0.1)
    pytest.fail(f"{what}: not within {timeout_s} s")


def height(ring: TruthRing) -> float:
    newest = ring.newest()
    assert newest is not None
    return float(newest.position_enu_m[2])


def speed(ring: TruthRing) -> float:
    newest = ring.newest()
    assert newest is not None
    return math.hypot(*newest.velocity_enu_m_s[:2])


def plan(px4: bool) -> list[MissionItem]:
    items = [] if px4 else [(37.2276, 126.8405, 0.0)]  # ArduPilot: home first
    items += [(37.2277, 126.8405, 10.0), (37.2278, 126.8406, 12.0)]
    nan = math.nan
    return [
        MissionItem(i, 6, 16, int(i == 0), 1, 0.0, 0.0, 0.0, nan if px4 else 0.0, round(x * 1e7), round(y * 1e7), z, 0)
        for i, (x, y, z) in enumerate(items)
    ]


async def fly(flavour: FlavourName, autopilot: AutopilotProcess, ring: TruthRing) -> None:
    px4 = flavour == "px4"
    companion = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
    await companion.add_any_connection(autopilot.url)
    system = await companion.first_autopilot(10.0)
    assert system is not None
    telemetry, action, offboard = TelemetryAsync(system), ActionAsync(system), OffboardAsync(system)
    if not px4:
        await telemetry.set_rate_health(5.0)  # ArduPilot's health stays unknown without
    await telemetry.set_rate_position(20.0)
    await telemetry.set_rate_in_air(5.0)
    await until("healthy", telemetry.health_all_ok)

    missions = MissionRawAsync(system)
    sent = plan(px4)
    await missions.upload_mission(sent)
    back = await missions.download_mission()
    assert [(i.x, i.y, i.z) for i in back][-2:] == [(i.x, i.y, i.z) for i in sent][-2:]
    assert len(back) == len(sent)

    await action.set_takeoff_altitude(1.5)
    await action.arm()
    await action.takeoff()

    async def up() -> bool:
        return height(ring) > 1.3 and await telemetry.in_air()

    await until("at 1.5 m", up)

    await offboard.set_velocity_ned(VelocityNedYaw(0.0, 1.5, 0.0, 0.0))
    await offboard.start()
    assert await offboard.is_active()

    async def moving() -> bool:
        return speed(ring) > 0.8

    await until("it moves", moving)

    operator = mavutil.mavlink_connection(autopilot.operator_url.replace("://", ":"), source_system=254)
    operator.mav.heartbeat_send(6, 8, 0, 0, 4)
    assert operator.wait_heartbeat(timeout=5.0) is not None
    main, sub = (4, 3) if px4 else (5, 0)
    operator.mav.command_long_send(1, 1, 176, 0, 1, main, sub, 0, 0, 0, 0)
    assert operator.recv_match(type="COMMAND_ACK", blocking=True, timeout=5.0).result == 0

    async def taken() -> bool:
        return bool(await telemetry.flight_mode() == FlightMode.HOLD)

    await until("the take-over is seen", taken)
    assert autopilot.state()["mode"] == "hold"

    async def stopped() -> bool:
        return speed(ring) < 0.3

    await until("it stands still", stopped)
    assert height(ring) > 1.0
    operator.close()
    companion.destroy()


def flown(flavour: FlavourName) -> list[float]:
    """Fly one autopilot; the times of its true states."""
    hold = (("COM_OBL_RC_ACT", 5.0),) if flavour == "px4" else ()
    ring = TruthRing.create(seconds=60.0, rate_hz=200.0)
    autopilot = start_autopilot(AutopilotConfig(flavour=flavour, ready_after_s=1.0, parameters=hold), ring.name)
    try:
        asyncio.run(fly(flavour, autopilot, ring))
        return [truth.t_s for truth in ring.history()]
    finally:
        autopilot.stop()
        ring.close()
        ring.unlink()


def test_mavsdk_flies_both_and_an_operator_takes_over() -> None:
    flavours: tuple[FlavourName, ...] = ("px4", "ardupilot")
    with ThreadPoolExecutor(2) as pool:
        for times in pool.map(flown, flavours):
            assert (len(times) - 1) / (times[-1] - times[0]) == pytest.approx(200.0, abs=5.0)
