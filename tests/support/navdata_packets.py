"""Navdata as bytes, put together field by field from the layout in the AR.Drone SDK 2.0, not by the code under test."""

from __future__ import annotations

HEADER = bytes.fromhex("88776655")

# NAVDATA_DEMO, tag 0, 148 bytes: flying (3) in the upper, "ok" (0) in the lower half of ctrl_state, battery 87 %,
# theta -2500, phi 10250, psi -90000 millidegrees, altitude 1742 mm, vx 250.5, vy -1000, vz 0 mm/s, frame 1234.
DEMO = bytes.fromhex(
    "0000 9400"  # tag, size
    "00000300"  # ctrl_state
    "57000000"  # battery
    "00401cc5"  # theta  -2500.0
    "00282046"  # phi    10250.0
    "00c8afc7"  # psi   -90000.0
    "ce060000"  # altitude
    "00807a43"  # vx  250.5
    "00007ac4"  # vy -1000.0
    "00000000"  # vz
    "d2040000"  # num_frames
) + bytes(104)  # the deprecated matrices, all zero

# NAVDATA_TIME, tag 1, 8 bytes: 5 s << 21 | 250000 us = 0x00A3D090
TIME = bytes.fromhex("0100 0800 90d0a300")

# NAVDATA_ALTITUDE, tag 10, 56 bytes: vision 1800 mm, vz -125.0 mm/s, reference 2000 mm, raw 1795 mm.
ALTITUDE = bytes.fromhex("0a00 3800 08070000 0000fac2 d0070000 03070000") + bytes(36)

# NAVDATA_MAGNETO, tag 22, 83 bytes: heading_fusion_unwrapped 450.0 degrees, calibrated.
MAGNETO = bytes.fromhex("1600 5300") + bytes(6 + 36 + 8) + bytes.fromhex("0000e143 01") + bytes(4 + 20)

# NAVDATA_WIFI, tag 26, 8 bytes.
WIFI = bytes.fromhex("1a00 0800 2a000000")

# NAVDATA_GPS, tag 27, 216 bytes: 48.5 N, 2.25 E, 120 m, hdop 1.5, data available, state 1, frame 77000, 7 satellites,
# plugged.
GPS = (
    bytes.fromhex("1b00 d800 0000000000404840 0000000000000240 0000000000005e40 000000000000f83f")
    + bytes.fromhex("01000000")  # data_available
    + bytes(8)  # zero_validated, wpt_validated
    + bytes(32)  # lat0, long0, lat_fused, long_fused
    + bytes.fromhex("01000000")  # gps_state
    + bytes(40)  # trajectory and tilt terms
    + bytes(16)  # vdop, pdop
    + bytes(4)  # speed
    + bytes.fromhex("c82c0100")  # lastFrameTimestamp
    + bytes(16)  # degree, degree_magnetic, ehpe, ehve
    + bytes(4)  # c_n0
    + bytes.fromhex("07000000")  # nbsat
    + bytes(24)  # channels
    + bytes.fromhex("01000000")  # is_gps_plugged
    + bytes(16)  # ephemeris, vx_traj, vy_traj, firmware
)

# An option of the SDK that is of no use here: NAVDATA_WATCHDOG, tag 17.
WATCHDOG = bytes.fromhex("1100 0800 11223344")


def packet(*options: bytes, state: int = 0x0F400001, sequence: int = 4711) -> bytes:
    """A packet with its checksum option."""
    body = HEADER + state.to_bytes(4, "little") + sequence.to_bytes(4, "little") + bytes(4) + b"".join(options)
    return body + bytes.fromhex("ffff 0800") + sum(body).to_bytes(4, "little")
