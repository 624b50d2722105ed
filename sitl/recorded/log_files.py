"""The same reports as a telemetry log, an ArduPilot log, a PX4 log, DJI subtitles and CSV, byte by byte as specified.

Formats: MAVLink tlog (8-byte big-endian microseconds before each frame); DataFlash (ArduPilot AP_Logger
LogStructure.h); ULog (PX4 docs, "ULog File Format"); SRT of the Phantom 4 RTK and M30 family.
"""

from __future__ import annotations

import csv
import math
import struct
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import all as mavlink

from mission.records import Matrix
from sitl.recorded.reports import Reports

_GPS_EPOCH_S, _LEAP_S, _WEEK_S = 315964800.0, 18.0, 604800.0


def write_tlog(path: Path, reports: Reports) -> None:
    """As a ground station writes it: positions, attitudes, heartbeats, GPS, each with the time of its arrival."""
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=mavlink.MAV_COMP_ID_AUTOPILOT1)
    lines: list[bytes] = []
    second = -1

    def put(message: mavlink.MAVLink_message, t_s: float) -> None:
        microseconds = round((reports.utc_at_zero_s + t_s + 0.01) * 1e6)
        lines.append(struct.pack(">Q", microseconds) + message.pack(link))
        link.seq = (link.seq + 1) % 256

    for i, t_s in enumerate(reports.t_s.tolist()):
        lat, lon, amsl = reports.lat_lon_amsl[i].tolist()
        if math.floor(t_s) != second:
            second = math.floor(t_s)
            put(link.heartbeat_encode(2, mavlink.MAV_AUTOPILOT_PX4, 129, 0, 4), t_s)
            gps = (round(lat * 1e7), round(lon * 1e7), round(amsl * 1e3))
            put(
                link.gps_raw_int_encode(
                    round(t_s * 1e6),
                    3,
                    *gps,
                    100,
                    100,
                    0,
                    0,
                    12,
                    alt_ellipsoid=round((amsl + reports.geoid_separation_m) * 1e3),
                    h_acc=round(reports.accuracy_m * 1e3),
                ),
                t_s,
            )
        boot_ms = math.floor(t_s * 1e3 + 1e-6)
        east, north, up = reports.velocity_enu_m_s[i].tolist()
        roll, pitch, yaw = reports.roll_pitch_yaw_rad[i].tolist()
        put(
            link.global_position_int_encode(
                boot_ms,
                round(lat * 1e7),
                round(lon * 1e7),
                round(amsl * 1e3),
                round(float(reports.height_m[i]) * 1e3),
                round(north * 100),
                round(east * 100),
                round(-up * 100),
                round(math.degrees(yaw) % 360.0 * 100) % 36000,
            ),
            t_s,
        )
        put(link.attitude_encode(boot_ms, roll, pitch, math.remainder(yaw, 2.0 * math.pi), 0.0, 0.0, 0.0), t_s)
    path.write_bytes(b"".join(lines))


# Name: message type, format characters, column names.
_DATAFLASH = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "ATT": (1, "Qccccccccc", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
    "POS": (2, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "XKF1": (3, "QBccCffffffff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,OH"),
    "GPS": (4, "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
    "GPA": (5, "QBCCCCfBI", "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS"),
}
_CHARACTERS = {
    "B": "B",
    "H": "H",
    "I": "I",
    "Q": "Q",
    "c": "h",
    "C": "H",
    "e": "i",
    "L": "i",
    "f": "f",
    "n": "4s",
    "N": "16s",
    "Z": "64s",
}
_SCALED = {"c": 100.0, "C": 100.0, "e": 100.0, "L": 1e7}


def write_dataflash(path: Path, reports: Reports) -> None:
    """As ArduPilot writes it: FMT, then ATT, POS, XKF1 at each report, GPS and GPA each fifth of a second."""
    parts = [
        _dataflash("FMT", number, _length(form), name.encode(), form.encode(), columns.encode())
        for name, (number, form, columns) in _DATAFLASH.items()
    ]
    last = -math.inf
    for i, t_s in enumerate(reports.t_s.tolist()):
        us = round(t_s * 1e6)
        lat, lon, amsl = reports.lat_lon_amsl[i].tolist()
        east, north, up = reports.velocity_enu_m_s[i].tolist()
        roll, pitch, yaw = np.degrees(reports.roll_pitch_yaw_rad[i]).tolist()
        yaw, height = math.remainder(yaw, 360.0), float(reports.height_m[i])
        # ATT's yaw is 0 to 360 degrees in an unsigned number; here as c, which holds 327.67 at most.
        if t_s >= last + 0.2:
            last = t_s
            since = reports.utc_at_zero_s + t_s - _GPS_EPOCH_S + _LEAP_S
            week, ms = int(since // _WEEK_S), round(since % _WEEK_S * 1e3)
            parts.append(_dataflash("GPS", us, 0, 3, ms, week, 12, 0.8, lat, lon, amsl, 0.0, 0.0, 0.0, 0.0, 1))
            parts.append(_dataflash("GPA", us, 0, 1.0, reports.accuracy_m, 0.5, 0.1, 0.0, 1, ms % 2**32))
        parts.append(_dataflash("ATT", us, 0.0, roll, 0.0, pitch, 0.0, yaw, 0.0, 0.0, 0.0))
        parts.append(_dataflash("XKF1", us, 0, roll, pitch, yaw % 360.0, north, east, -up, *[0.0] * 5))
        parts.append(_dataflash("POS", us, lat, lon, amsl, height, height))
    path.write_bytes(b"".join(parts))


def _length(form: str) -> int:
    return 3 + struct.calcsize("<" + "".join(_CHARACTERS[c] for c in form))


def _dataflash(name: str, *values: float | bytes) -> bytes:
    number, form, _ = _DATAFLASH[name]
    cells = [
        round(value * _SCALED[c]) if c in _SCALED and not isinstance(value, bytes) else value
        for c, value in zip(form, values, strict=True)
    ]
    return struct.pack("<BBB" + "".join(_CHARACTERS[c] for c in form), 0xA3, 0x95, number, *cells)


_ULOG_TOPICS = {
    "vehicle_attitude": "uint64_t timestamp;uint64_t timestamp_sample;float[4] q;",
    "vehicle_global_position": (
        "uint64_t timestamp;uint64_t timestamp_sample;double lat;double lon;float alt;float eph;"
    ),
    "vehicle_local_position": "uint64_t timestamp;uint64_t timestamp_sample;float vx;float vy;float vz;float ref_alt;",
    "vehicle_gps_position": (
        "uint64_t timestamp;uint64_t time_utc_usec;float eph;int32_t alt;int32_t alt_ellipsoid;uint8_t fix_type;"
    ),
}


def write_ulog(path: Path, reports: Reports) -> None:
    """As PX4 writes it: attitude at each report, positions at each second one, GPS each fifth of a second."""
    begin = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", round(float(reports.t_s[0]) * 1e6))
    parts = [begin, _ulog("B", bytes(40))]
    for name, fields in _ULOG_TOPICS.items():
        parts.append(_ulog("F", f"{name}:{fields}".encode()))
    for number, name in enumerate(_ULOG_TOPICS):
        parts.append(_ulog("A", struct.pack("<BH", 0, number) + name.encode()))
    last = -math.inf
    for i, t_s in enumerate(reports.t_s.tolist()):
        us = round(t_s * 1e6)
        stamps = struct.pack("<QQ", us, us)
        parts.append(
            _ulog("D", struct.pack("<H", 0) + stamps + struct.pack("<4f", *_ned(reports.roll_pitch_yaw_rad[i])))
        )
        lat, lon, amsl = reports.lat_lon_amsl[i].tolist()
        if i % 2 == 0:
            east, north, up = reports.velocity_enu_m_s[i].tolist()
            ground = amsl - float(reports.height_m[i])
            parts.append(_ulog("D", struct.pack("<H", 1) + stamps + struct.pack("<ddff", lat, lon, amsl, 0.5)))
            parts.append(_ulog("D", struct.pack("<H", 2) + stamps + struct.pack("<4f", north, east, -up, ground)))
        if t_s >= last + 0.2:
            last = t_s
            utc = round((reports.utc_at_zero_s + t_s) * 1e6)
            heights = round(amsl * 1e3), round((amsl + reports.geoid_separation_m) * 1e3)
            parts.append(
                _ulog("D", struct.pack("<H", 3) + struct.pack("<QQfiiB", us, utc, reports.accuracy_m, *heights, 3))
            )
    path.write_bytes(b"".join(parts))


def _ulog(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def _ned(roll_pitch_yaw: Matrix) -> Sequence[float]:
    """Quaternion (w, x, y, z) from the body to north-east-down."""
    cr, cp, cy = np.cos(roll_pitch_yaw / 2.0).tolist()
    sr, sp, sy = np.sin(roll_pitch_yaw / 2.0).tolist()
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def write_dji_srt(path: Path, reports: Reports, video_s: Sequence[float]) -> None:
    """As a Phantom 4 RTK writes it, one cue a frame.

    Args:
        path: the .SRT file.
        reports: at the frames' exposures (`Reports.at`).
        video_s: the frames' times in the video.
    """
    step = 1.0 / 30.0 if len(video_s) < 2 else video_s[1] - video_s[0]
    cues = []
    for i, at_s in enumerate(video_s):
        lat, lon, _ = reports.lat_lon_amsl[i].tolist()
        roll, pitch, yaw = np.degrees(reports.roll_pitch_yaw_rad[i]).tolist()
        yaw, height = math.remainder(yaw, 360.0), float(reports.height_m[i])
        camera = pitch - math.degrees(reports.tilt_down_rad)
        cues.append(
            f"{i + 1}\n{_stamp(at_s)} --> {_stamp(at_s + step)}\n"
            f"F/5.6, SS 400, ISO 100, EV 0, GPS ({lon:.6f}, {lat:.6f}, 15), "
            f"HOME ({reports.lat_lon_amsl[0][1]:.6f}, {reports.lat_lon_amsl[0][0]:.6f}, 12.00m), D 0.00m, "
            f"H {height:.2f}m, H.S 0.00m/s, V.S 0.00m/s, "
            f"F.PRY ({pitch:.1f}°, {roll:.1f}°, {yaw:.1f}°), G.PRY ({camera:.1f}°, {roll:.1f}°, {yaw:.1f}°)\n"
        )
    path.write_text("\n".join(cues), encoding="utf-8")


def _stamp(t_s: float) -> str:
    ms = round(t_s * 1e3)
    return f"{ms // 3600000:02d}:{ms // 60000 % 60:02d}:{ms // 1000 % 60:02d},{ms % 1000:03d}"


def write_csv(path: Path, reports: Reports) -> None:
    """The columns of docs/recorded-flights.md."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(
            ["t_s", "time_utc", "lat_deg", "lon_deg", "amsl_m", "height_m", "roll_deg", "pitch_deg", "yaw_deg"]
            + [f"velocity_{axis}_m_s" for axis in ("east", "north", "up")]
            + ["accuracy_m"]
        )
        for i, t_s in enumerate(reports.t_s.tolist()):
            utc = datetime.fromtimestamp(reports.utc_at_zero_s + t_s, UTC).isoformat()
            lat, lon, amsl = reports.lat_lon_amsl[i].tolist()
            angles = [f"{angle:.4f}" for angle in np.degrees(reports.roll_pitch_yaw_rad[i])]
            speed = [f"{v:.3f}" for v in reports.velocity_enu_m_s[i]]
            place = [f"{lat:.9f}", f"{lon:.9f}", f"{amsl:.3f}", f"{reports.height_m[i]:.3f}"]
            rows.writerow([f"{t_s:.4f}", utc, *place, *angles, *speed, f"{reports.accuracy_m:.2f}"])
