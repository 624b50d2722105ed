"""Navdata packets worked out by hand from `navdata_common.h`, their truncated and their corrupted twins."""

from __future__ import annotations

import math
import random
import struct
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.vehicle.ardrone.navdata import DroneState, Malformed, Navdata, decode_navdata
from mission.vehicle.ardrone.navdata_options import MASK, Control
from tests.support.navdata_packets import ALTITUDE, DEMO, GPS, MAGNETO, TIME, WATCHDOG, WIFI, packet

FULL = (DEMO, TIME, ALTITUDE, MAGNETO, WIFI, WATCHDOG, GPS)
# Header 0x55667788, state 0x00000800 (bootstrap), sequence 1, vision 0; checksum 0x88+0x77+0x66+0x55+0x08+0x01 = 451.
BOOTSTRAP = bytes.fromhex("88776655 00080000 01000000 00000000 ffff0800 c3010000")


def good(data: bytes) -> Navdata:
    found = decode_navdata(data)
    assert isinstance(found, Navdata), found
    return found


def fault(data: bytes) -> str:
    found = decode_navdata(data)
    assert isinstance(found, Malformed), found
    return found.reason


def test_bootstrap_has_a_state_and_no_option() -> None:
    found = good(BOOTSTRAP)
    assert found.says(DroneState.NAVDATA_BOOTSTRAP)
    assert not found.says(DroneState.FLYING)
    assert found.sequence == 1
    assert found.demo is None


def test_bootstrap_corrupted() -> None:
    assert fault(BOOTSTRAP[:4] + b"\x01" + BOOTSTRAP[5:]) == "checksum 451, the bytes sum to 452"


def test_demo() -> None:
    found = good(packet(DEMO))
    demo = found.demo
    assert demo is not None
    assert (demo.control, demo.control_minor) == (Control.FLYING, 0)
    assert demo.battery_fraction == 0.87
    assert demo.pitch_rad == pytest.approx(math.radians(-2.5))
    assert demo.roll_rad == pytest.approx(math.radians(10.25))
    assert demo.yaw_rad == pytest.approx(math.radians(-90.0))
    assert demo.altitude_m == pytest.approx(1.742)
    assert demo.velocity_m_s == pytest.approx((0.2505, -1.0, 0.0))
    assert found.sequence == 4711
    assert found.says(DroneState.FLYING)


def test_every_option_of_the_gps_edition_and_one_that_is_skipped() -> None:
    found = good(packet(*FULL))
    assert found.time is not None
    assert found.time.seconds == pytest.approx(5.25)
    assert found.altitude is not None
    assert found.altitude.vision_m == pytest.approx(1.8)
    assert found.altitude.vertical_speed_m_s == pytest.approx(-0.125)
    assert (found.altitude.reference_m, found.altitude.raw_m) == pytest.approx((2.0, 1.795))
    assert found.magneto is not None
    assert found.magneto.fused_heading_rad == pytest.approx(math.radians(450.0))
    assert found.magneto.calibrated
    assert found.wifi is not None
    assert found.wifi.link_quality == 42
    gps = found.gps
    assert gps is not None
    assert (gps.lat_deg, gps.lon_deg, gps.elevation_m, gps.hdop) == (48.5, 2.25, 120.0, 1.5)
    assert (gps.satellites, gps.frame_ms, gps.state, gps.plugged, gps.fixed) == (7, 77000, 1, True, True)
    assert found.unknown == (17,)


def test_the_mask_asks_for_what_is_read() -> None:
    assert MASK == 1 << 0 | 1 << 1 | 1 << 10 | 1 << 22 | 1 << 26 | 1 << 27


@pytest.mark.parametrize("length", range(len(packet(*FULL))))
def test_truncated_anywhere(length: int) -> None:
    fault(packet(*FULL)[:length])


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "0 bytes, less than a header"),
        (bytes(5000), "5000 bytes, more than 4096"),
        (bytes(24), "header 0x00000000"),
        (packet(DEMO)[:-8], "no checksum at the end"),
        (packet(DEMO)[:-1], "option 65535 says 8 bytes, 7 are left"),
        (packet(DEMO) + b"\x00", "the checksum is not the end"),
        (packet(bytes.fromhex("00000000")), "option 0 says 0 bytes, 12 are left"),
        (packet(bytes.fromhex("0100ffff00000000")), "option 1 says 65535 bytes, 16 are left"),
        (packet(bytes.fromhex("00000800") + DEMO[4:8]), "option Demo has 4 bytes, 144 are needed"),
        (packet(GPS[:2] + bytes.fromhex("0c00") + GPS[4:12]), "option Gps has 8 bytes, 212 are needed"),
    ],
)
def test_malformed(data: bytes, reason: str) -> None:
    assert fault(data) == reason


@pytest.mark.parametrize("offset", [12, 16, 20, 28, 32, 36])
def test_an_angle_or_speed_that_is_not_a_number_is_refused(offset: int) -> None:
    for value in (math.nan, math.inf):
        wrong = DEMO[:offset] + struct.pack("<f", value) + DEMO[offset + 4 :]
        assert fault(packet(wrong)) == "option Demo has a value that is not a number"


@given(st.integers(0, len(packet(*FULL)) - 1), st.integers(1, 255))
def test_no_single_byte_can_change_unnoticed(at: int, change: int) -> None:
    data = bytearray(packet(*FULL))
    data[at] = (data[at] + change) % 256
    fault(bytes(data))


def test_options_may_be_longer_than_known() -> None:
    longer = WIFI[:2] + bytes.fromhex("0c00") + WIFI[4:] + bytes(4)
    wifi = good(packet(longer)).wifi
    assert wifi is not None
    assert wifi.link_quality == 42


def test_a_gps_without_fix_is_no_position() -> None:
    for at, wrong in ((36, "00000000"), (80, "00000000"), (196, "00000000"), (28, "0000000000000000")):
        changed = bytearray(GPS)
        changed[at : at + len(wrong) // 2] = bytes.fromhex(wrong)
        gps = good(packet(bytes(changed))).gps
        assert gps is not None
        assert not gps.fixed


def mutated(rng: random.Random, data: bytes) -> bytes:
    """Bytes changed, cut, doubled or swapped; half of them with a checksum that is right again."""
    wrong = bytearray(data)
    for _ in range(rng.randint(1, 8)):
        at = rng.randrange(len(wrong) + 1)
        kind = rng.randrange(4)
        if kind == 0 and at < len(wrong):
            wrong[at] = rng.randrange(256)
        elif kind == 1:
            del wrong[at : at + rng.randint(1, 30)]
        elif kind == 2:
            wrong[at:at] = rng.randbytes(rng.randint(1, 30))
        else:
            wrong[at:at] = wrong[max(0, at - 20) : at]
    if rng.random() < 0.5 and len(wrong) > 8:
        body = bytes(wrong[:-8])
        wrong = bytearray(body + bytes.fromhex("ffff0800") + sum(body).to_bytes(4, "little"))
    return bytes(wrong)


def test_mutated_packets_never_raise_and_take_no_time(mutations: int) -> None:
    rng = random.Random(5554)
    whole = packet(*FULL)
    began = time.perf_counter()
    outcomes = [decode_navdata(mutated(rng, whole)) for _ in range(mutations)]
    assert time.perf_counter() - began < 1e-3 * mutations + 5.0
    kept = [found for found in outcomes if isinstance(found, Navdata)]
    assert 0 < len(kept) < mutations
    for found in kept:
        if found.demo is not None:
            assert all(math.isfinite(v) for v in found.demo.velocity_m_s)
    good(whole)
