"""Navdata bytes worked out by hand from navdata_common.h."""

from __future__ import annotations

import struct

import pytest

from sitl.ardrone import navdata
from sitl.ardrone.navdata import Magnetometer, Motion, Tag
from sitl.ardrone.state import ControlState, StateBit

MOTION = Motion(ControlState.HOVERING, 87, -1500.0, 2250.0, -90000.0, 1012, 125.0, -250.0, 0.0)


def test_bootstrap_packet_is_header_and_checksum() -> None:
    state = StateBit.NAVDATA_BOOTSTRAP | StateBit.CAMERA_READY
    expected = bytes.fromhex("88776655 80080000 01000000 01000000 ffff 0800")
    # 0x88 + 0x77 + 0x66 + 0x55 + 0x80 + 0x08 + 1 + 1 = 580
    assert navdata.packet(state, 1, []) == expected + struct.pack("<I", 0x88 + 0x77 + 0x66 + 0x55 + 0x80 + 0x08 + 2)
    # The checksum option's own tag and size are not part of the sum.


def test_demo_option_has_its_documented_layout() -> None:
    data = navdata.demo_option(MOTION, 77)
    assert len(data) == 148
    assert data[:4] == bytes.fromhex("0000 9400")
    assert data[4:12] == bytes.fromhex("00000400 57000000")  # hovering is 4 in the upper half; 87 %
    assert data[12:24] == bytes.fromhex("0080bbc4 00a00c45 00c8afc7")  # -1500, 2250, -90000 as floats
    assert data[24:28] == bytes.fromhex("f4030000")  # 1012
    assert data[28:40] == bytes.fromhex("0000fa42 00007ac3 00000000")  # 125, -250, 0
    assert data[40:44] == bytes.fromhex("4d000000")


def test_time_option_packs_seconds_above_microseconds() -> None:
    # 3.25 s: 3 << 21 | 250000 = 6291456 + 250000 = 6541456 = 0x0063D090
    assert navdata.time_option(3.25) == bytes.fromhex("0100 0800 90d06300")


def test_time_wraps_after_2048_seconds() -> None:
    assert navdata.time_option(2048.0 + 3.25) == navdata.time_option(3.25)


@pytest.mark.parametrize(
    ("option", "tag", "size"),
    [
        (navdata.euler_option(1.0, 2.0), Tag.EULER_ANGLES, 12),
        (navdata.trims_option(0.0, 0.0), Tag.TRIMS, 16),
        (navdata.altitude_option(900, 10.0, 1000, 905), Tag.ALTITUDE, 56),
        (navdata.vision_detect_option(), Tag.VISION_DETECT, 328),
        (navdata.magneto_option(Magnetometer(1.0, 2.0, 3.0, (200.0, 0.0, 430.0), True)), Tag.MAGNETO, 75),
        (navdata.wifi_option(9), Tag.WIFI, 8),
    ],
)
def test_option_has_its_documented_length(option: bytes, tag: Tag, size: int) -> None:
    assert struct.unpack_from("<HH", option) == (tag, size)
    assert len(option) == size


def test_magnetometer_headings_are_where_the_header_file_has_them() -> None:
    data = navdata.magneto_option(Magnetometer(10.0, 20.0, 30.0, (200.0, -100.0, 430.0), True))
    assert struct.unpack_from("<hhh", data, 4) == (200, -100, 430)
    assert struct.unpack_from("<fff", data, 4 + 6 + 36) == (10.0, 20.0, 30.0)
    assert data[4 + 6 + 36 + 12] == 1


def test_gps_option_has_the_layout_of_the_gps_edition() -> None:
    fix = navdata.GpsFix(
        *(47.1, 8.2, 47.3, 8.4, 480.0, 47.5, 8.6, 1.25, 9, 0.5, 90.0),
        *((0.25, 0.5, -0.75), (1.0, 2.0, 3.0), 12.5, 1820, True),
    )
    data = navdata.gps_option(fix)
    assert struct.unpack_from("<HHdddd", data) == (27, 480, 47.1, 8.2, 480.0, 1.25)
    assert struct.unpack_from("<dddd", data, 48) == (47.5, 8.6, 47.3, 8.4)
    assert struct.unpack_from("<i", data, 196) == (1,)
    assert struct.unpack_from("<dHBB", data, 308) == (12.5, 1820, 1, 9)
    assert struct.unpack_from("<6d", data, 344) == (0.25, 0.5, -0.75, 1.0, 2.0, 3.0)


def test_checksum_covers_all_options() -> None:
    data = navdata.packet(StateBit.NAVDATA_DEMO, 5, [navdata.demo_option(MOTION, 0), navdata.wifi_option(3)])
    assert data[-8:-4] == bytes.fromhex("ffff 0800")
    assert struct.unpack("<I", data[-4:])[0] == sum(data[:-8])
