"""The aircraft's rules: link, configuration, flight states. No sockets, no clock."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from sitl.ardrone.config import ArdroneConfig
from sitl.ardrone.drone import TICK_S, Ardrone
from sitl.ardrone.state import StateBit

TAKE_OFF = 0x11540200
LAND = 0x11540000
EMERGENCY = 0x11540100
TABLE_II_M = np.cumsum([0.0, 0.0, 0.4750, 0.5175, 0.7575, 0.9125, 1.0050, 1.0875, 1.2675, 1.4650, 1.8925])


def bits(value: float) -> int:
    found: int = struct.unpack("<i", struct.pack("<f", value))[0]
    return found


class Pilot:
    """Sends with growing numbers and lets time pass."""

    def __init__(self, config: ArdroneConfig | None = None) -> None:
        self.drone = Ardrone(config or ArdroneConfig(noise="none"), 100.0)
        self.now_s = 100.0
        self.sequence = 0

    def send(self, name: str, *arguments: object) -> None:
        self.sequence += 1
        text = "".join(f',"{a}"' if isinstance(a, str) else f",{a}" for a in arguments)
        self.drone.receive(f"AT*{name}={self.sequence}{text}\r".encode(), self.now_s)

    def move(self, roll: float = 0.0, pitch: float = 0.0, gaz: float = 0.0, yaw: float = 0.0) -> None:
        self.send("PCMD", 1, bits(roll), bits(pitch), bits(gaz), bits(yaw))

    def wait(self, seconds: float, *, heartbeat: bool = True) -> None:
        for i in range(round(seconds / TICK_S)):
            if heartbeat and i % 40 == 0:
                self.send("COMWDG")
            self.now_s += TICK_S
            self.drone.step(self.now_s)

    def fly_to_hover(self) -> None:
        self.send("FTRIM")
        self.send("REF", TAKE_OFF)
        for _ in range(100):
            self.wait(0.1)
            if self.state == "HOVERING":
                break
        self.wait(1.0)
        assert self.state == "HOVERING"

    @property
    def state(self) -> str:
        return self.drone.commander.state.name

    @property
    def position(self) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.array(self.drone.aircraft.position_enu_m)


def test_starts_in_bootstrap_and_leaves_it_with_the_choice_of_navdata() -> None:
    pilot = Pilot()
    assert len(pilot.drone.navdata_packet()) == 24
    assert pilot.drone.state_bits & StateBit.NAVDATA_BOOTSTRAP
    pilot.send("CONFIG", "general:navdata_demo", "TRUE")
    assert not pilot.drone.state_bits & StateBit.NAVDATA_BOOTSTRAP
    assert pilot.drone.state_bits & StateBit.NAVDATA_DEMO
    assert len(pilot.drone.navdata_packet()) == 16 + 148 + 328 + 8


def test_command_bit_stays_until_it_is_acknowledged() -> None:
    pilot = Pilot()
    pilot.send("CONFIG", "general:navdata_demo", "TRUE")
    assert pilot.drone.state_bits & StateBit.COMMAND
    pilot.send("CTRL", 0, 0)
    assert pilot.drone.state_bits & StateBit.COMMAND
    pilot.send("CTRL", 5, 0)
    assert not pilot.drone.state_bits & StateBit.COMMAND


def test_full_navdata_follows_the_option_mask() -> None:
    pilot = Pilot()
    pilot.send("CONFIG", "general:navdata_demo", "FALSE")
    pilot.send("CONFIG", "general:navdata_options", str(1 << 0 | 1 << 1 | 1 << 22))
    assert len(pilot.drone.navdata_packet()) == 16 + 148 + 8 + 75 + 8
    assert pilot.drone.navdata_period_s == 0.005


def test_gps_option_is_there_only_with_the_receiver() -> None:
    for gps in (False, True):
        pilot = Pilot(ArdroneConfig(noise="none", gps=gps))
        pilot.send("CONFIG", "general:navdata_demo", "FALSE")
        pilot.send("CONFIG", "general:navdata_options", str(1 << 27))
        assert len(pilot.drone.navdata_packet()) == 16 + (480 if gps else 0) + 8


def test_old_and_repeated_commands_are_ignored_and_one_starts_anew() -> None:
    drone = Ardrone(ArdroneConfig(noise="none"), 0.0)
    drone.receive(b"AT*REF=10,290718208\r", 0.0)
    drone.receive(b"AT*REF=9,290717696\r", 0.0)
    drone.receive(b"AT*REF=10,290717696\r", 0.0)
    assert drone.state_bits & StateBit.USER_FEEDBACK
    drone.receive(b"AT*REF=1,290717696\r", 0.0)
    assert not drone.state_bits & StateBit.USER_FEEDBACK
    drone.receive(b"AT*REF=2,290718208\r", 0.0)
    assert drone.state_bits & StateBit.USER_FEEDBACK


def test_watchdog_bit_comes_after_50_ms_and_goes_with_comwdg() -> None:
    pilot = Pilot()
    pilot.send("REF", LAND)
    pilot.wait(0.045, heartbeat=False)
    assert not pilot.drone.state_bits & StateBit.COM_WATCHDOG
    pilot.wait(0.02, heartbeat=False)
    assert pilot.drone.state_bits & StateBit.COM_WATCHDOG
    pilot.send("REF", LAND)
    assert pilot.drone.state_bits & StateBit.COM_WATCHDOG
    pilot.send("COMWDG")
    assert not pilot.drone.state_bits & StateBit.COM_WATCHDOG


def test_hovers_when_the_pilot_is_silent_for_two_seconds() -> None:
    pilot = Pilot()
    pilot.fly_to_hover()
    pilot.move(roll=-1.0)
    pilot.wait(1.9, heartbeat=False)
    assert pilot.state == "FLYING"
    pilot.wait(0.2, heartbeat=False)
    assert pilot.drone.state_bits & StateBit.COM_LOST
    assert pilot.state != "FLYING"
    pilot.wait(4.0, heartbeat=False)
    assert pilot.state == "HOVERING"
    assert np.linalg.norm(pilot.drone.aircraft.velocity_enu_m_s) < 0.1
    # Any number is new to an aircraft that lost its pilot.
    pilot.sequence = 4
    pilot.send("REF", LAND)
    assert pilot.state == "LANDING"
    assert not pilot.drone.state_bits & StateBit.COM_LOST


def test_takes_off_to_about_a_metre_and_lands() -> None:
    pilot = Pilot()
    pilot.send("REF", TAKE_OFF)
    assert pilot.state == "TAKING_OFF"
    pilot.wait(0.5)
    assert pilot.drone.state_bits & StateBit.FLYING
    pilot.wait(6.0)
    assert pilot.state == "HOVERING"
    assert pilot.position[2] == pytest.approx(0.9, abs=0.15)
    pilot.send("REF", LAND)
    assert pilot.state == "LANDING"
    pilot.wait(5.0)
    assert pilot.state == "LANDED"
    assert pilot.drone.aircraft.grounded
    assert not pilot.drone.state_bits & StateBit.FLYING


def test_movement_is_ignored_while_taking_off_and_landing() -> None:
    pilot = Pilot()
    pilot.send("REF", TAKE_OFF)
    for _ in range(20):
        pilot.move(roll=1.0)
        pilot.wait(0.1)
    assert pilot.state == "TAKING_OFF"
    assert np.linalg.norm(pilot.position[:2]) < 0.05


@pytest.mark.parametrize(
    ("command", "east_sign", "north_sign"),
    [((-1.0, 0.0), -1, 0), ((1.0, 0.0), 1, 0), ((0.0, -1.0), 0, 1), ((0.0, 1.0), 0, -1)],
)
def test_roll_and_pitch_move_it_as_the_guide_says(
    command: tuple[float, float], east_sign: int, north_sign: int
) -> None:
    pilot = Pilot(ArdroneConfig(noise="none", heading_rad=0.0))
    pilot.fly_to_hover()
    start = pilot.position
    pilot.move(roll=command[0], pitch=command[1])
    pilot.wait(1.5)
    moved = pilot.position - start
    assert moved[0] == pytest.approx(east_sign * abs(moved[:2]).max(), abs=0.1)
    assert moved[1] == pytest.approx(north_sign * abs(moved[:2]).max(), abs=0.1)
    assert abs(moved[:2]).max() > 0.5


def test_full_speed_left_follows_table_two_of_the_paper() -> None:
    pilot = Pilot()
    pilot.fly_to_hover()
    start = pilot.position
    travelled = [0.0]
    pilot.move(roll=-1.0)
    for _ in range(10):
        pilot.wait(0.5)
        travelled.append(float(np.linalg.norm((pilot.position - start)[:2])))
    off = np.array(travelled) - TABLE_II_M
    assert np.sqrt(np.mean(off**2)) < 0.35
    assert np.all(np.abs(off[4:]) < 0.1 * TABLE_II_M[4:])


def test_tilt_climb_and_turn_obey_their_configured_limits() -> None:
    pilot = Pilot()
    pilot.send("CONFIG", "control:euler_angle_max", "0.1")
    pilot.send("CONFIG", "control:control_vz_max", "500")
    pilot.send("CONFIG", "control:control_yaw", "1.0")
    pilot.fly_to_hover()
    pilot.move(roll=-1.0)
    pilot.wait(1.0)
    assert pilot.drone.aircraft.euler[0] == pytest.approx(-0.1, abs=0.01)
    pilot.move(gaz=1.0)
    pilot.wait(1.0)
    before = pilot.position[2]
    pilot.wait(0.5)
    assert pilot.position[2] - before == pytest.approx(0.25, abs=0.05)
    pilot.move(yaw=0.5)
    pilot.wait(0.5)
    heading = pilot.drone.aircraft.euler[2]
    pilot.wait(1.0)
    assert pilot.drone.aircraft.euler[2] - heading == pytest.approx(0.5, abs=0.1)


def test_altitude_limit_stops_the_climb() -> None:
    pilot = Pilot()
    pilot.send("CONFIG", "control:altitude_max", "1500")
    pilot.fly_to_hover()
    pilot.move(gaz=1.0)
    pilot.wait(4.0)
    assert pilot.position[2] == pytest.approx(1.5, abs=0.2)


def test_flag_zero_hovers_whatever_else_the_command_says() -> None:
    pilot = Pilot()
    pilot.fly_to_hover()
    pilot.move(roll=-1.0)
    pilot.wait(1.5)
    pilot.send("PCMD", 0, bits(1.0), bits(1.0), bits(1.0), bits(1.0))
    pilot.wait(0.01)
    assert pilot.state == "GOING_TO_FIX"
    pilot.wait(3.0)
    assert pilot.state == "HOVERING"
    assert np.linalg.norm(pilot.drone.aircraft.velocity_enu_m_s) < 0.1


def test_absolute_control_moves_along_the_pilots_own_heading() -> None:
    pilot = Pilot(ArdroneConfig(noise="none", heading_rad=math.radians(90.0)))
    pilot.fly_to_hover()
    start = pilot.position
    pilot.send("PCMD_MAG", 1 | 1 << 2, 0, bits(-1.0), 0, 0, bits(0.0), 0)  # forwards, to a pilot who faces north
    pilot.wait(1.5)
    east, north, _ = pilot.position - start
    assert north > 0.5
    assert abs(east) < 0.1 * north


def test_emergency_cuts_the_motors_and_only_its_own_toggle_ends_it() -> None:
    pilot = Pilot()
    pilot.fly_to_hover()
    pilot.send("REF", EMERGENCY)
    pilot.wait(1.0)
    assert pilot.drone.aircraft.grounded
    assert pilot.drone.state_bits & StateBit.EMERGENCY
    pilot.send("REF", TAKE_OFF)
    pilot.wait(0.5)
    assert pilot.state == "LANDED"
    pilot.send("REF", EMERGENCY)
    pilot.send("REF", EMERGENCY)  # a bit that stays is one request
    assert not pilot.drone.state_bits & StateBit.EMERGENCY
    pilot.send("REF", LAND)
    pilot.send("REF", TAKE_OFF)
    assert pilot.state == "TAKING_OFF"


def test_emergency_is_not_reset_while_it_falls() -> None:
    pilot = Pilot()
    pilot.fly_to_hover()
    pilot.send("REF", EMERGENCY)
    pilot.wait(0.1)
    pilot.send("REF", LAND)
    pilot.send("REF", EMERGENCY)
    assert pilot.drone.state_bits & StateBit.EMERGENCY


def test_flat_trim_is_refused_in_the_air() -> None:
    pilot = Pilot()
    pilot.send("FTRIM")
    assert pilot.drone.commander.trims == 1
    pilot.fly_to_hover()
    trims = pilot.drone.commander.trims
    pilot.send("FTRIM")
    assert pilot.drone.commander.trims == trims


def test_empty_battery_lands_it_and_keeps_it_down() -> None:
    pilot = Pilot(ArdroneConfig(noise="none", battery_percent=4.0, battery_endurance_s=500.0))
    assert pilot.drone.state_bits & StateBit.BATTERY_LOW
    pilot.send("REF", TAKE_OFF)
    pilot.wait(12.0)
    assert pilot.state in ("LANDING", "LANDED")
    pilot.wait(4.0)
    pilot.send("REF", TAKE_OFF)
    assert pilot.state == "LANDED"


def test_control_listing_is_sent_on_request() -> None:
    pilot = Pilot()
    assert pilot.drone.take_listing() is None
    pilot.send("CTRL", 4, 0)
    listing = pilot.drone.take_listing()
    assert listing is not None
    assert b"control:euler_angle_max = 2.0943951e-01\n" in listing
    assert listing.endswith(b"\0")
    pilot.send("CONFIG", "custom:session_id", "d2e081a3")
    pilot.send("CTRL", 6, 0)
    assert pilot.drone.take_listing() == b"[applications]\n[profiles]\n[sessions]\nd2e081a3\n\0"


def test_signs_of_the_reported_motion() -> None:
    pilot = Pilot(ArdroneConfig(noise="none", heading_rad=0.5))
    pilot.fly_to_hover()
    pilot.move(roll=0.5, pitch=-0.5)
    pilot.wait(1.2)
    m = pilot.drone.motion()
    assert m.phi_mdeg > 3000.0  # right
    assert m.theta_mdeg < -3000.0  # nose down
    assert m.vx_mm_s > 300.0  # forwards
    assert m.vy_mm_s > 300.0  # to the right
    assert m.psi_mdeg == pytest.approx(1000.0 * math.degrees(0.5), abs=1000.0)


@pytest.mark.parametrize("gibberish", [b"", b"\0" * 50, b"AT*", b"AT*REF=1,99999999999999\r", b"AT*PCMD=5\r" * 300])
def test_gibberish_changes_nothing(gibberish: bytes) -> None:
    pilot = Pilot()
    before = pilot.drone.commander.state, pilot.drone.configuration.listing()
    pilot.drone.receive(gibberish, pilot.now_s)
    pilot.wait(0.1, heartbeat=False)
    assert (pilot.drone.commander.state, pilot.drone.configuration.listing()) == before
