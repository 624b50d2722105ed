"""Transport streams with MISB ST 0601 metadata beside the pictures, as tactical video has it."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.packet import Packet

from sitl.recorded.reports import Reports

_KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
_TICKS = 90000


def write_transport_stream(path: Path, video: Path, reports: Reports, every: int = 2) -> None:
    """The video's packets, not encoded again, with a local set beside every so many of them.

    Args:
        path: the .ts file.
        video: H.264 without B-frames.
        reports: one for each frame, at its exposure.
        every: pictures per local set.
    """
    with av.open(str(video)) as source, av.open(str(path), "w", format="mpegts") as out:
        pictures = source.streams.video[0]
        stream = out.add_stream_from_template(pictures)
        data = out.add_data_stream("klv")
        number = 0
        for packet in source.demux(pictures):
            if packet.dts is None or packet.pts is None or packet.time_base is None:
                continue
            at_s = float(packet.pts * packet.time_base)
            if number % every == 0 and number < len(reports.t_s):
                beside = Packet(local_set(reports, number))
                beside.stream = data
                beside.pts = beside.dts = round(at_s * _TICKS)
                beside.time_base = Fraction(1, _TICKS)
                out.mux(beside)
            packet.stream = stream
            out.mux(packet)
            number += 1


def local_set(reports: Reports, i: int) -> bytes:
    """One report as a local set with its checksum."""
    lat, lon, amsl = reports.lat_lon_amsl[i].tolist()
    roll, pitch, yaw = np.degrees(reports.roll_pitch_yaw_rad[i]).tolist()
    east, north, _ = reports.velocity_enu_m_s[i].tolist()
    time_us = round((reports.utc_at_zero_s + float(reports.t_s[i])) * 1e6)
    body = b"".join(
        [
            _field(2, time_us.to_bytes(8, "big")),
            _field(5, _unsigned(yaw % 360.0, 0.0, 360.0, 2)),
            _field(90, _signed(pitch, 90.0, 4)),
            _field(91, _signed(roll, 90.0, 4)),
            _field(13, _signed(lat, 90.0, 4)),
            _field(14, _signed(lon, 180.0, 4)),
            _field(15, _unsigned(amsl, -900.0, 19000.0, 2)),
            _field(18, _unsigned(0.0, 0.0, 360.0, 4)),
            _field(19, _signed(-math.degrees(reports.tilt_down_rad), 180.0, 4)),
            _field(20, _unsigned(0.0, 0.0, 360.0, 4)),
            _field(65, bytes([19])),
            _field(79, _signed(north, 327.0, 2)),
            _field(80, _signed(east, 327.0, 2)),
        ]
    )
    whole = _KEY + _length(len(body) + 4) + body + b"\x01\x02"
    total = sum(byte << (8 if place % 2 == 0 else 0) for place, byte in enumerate(whole))
    return whole + (total & 0xFFFF).to_bytes(2, "big")


def _field(tag: int, value: bytes) -> bytes:
    return bytes([tag, len(value)]) + value


def _length(size: int) -> bytes:
    return bytes([size]) if size < 128 else b"\x82" + size.to_bytes(2, "big")


def _signed(value: float, most: float, size: int) -> bytes:
    return round(value / most * ((1 << (8 * size - 1)) - 1)).to_bytes(size, "big", signed=True)


def _unsigned(value: float, low: float, high: float, size: int) -> bytes:
    return round((value - low) / (high - low) * ((1 << (8 * size)) - 1)).to_bytes(size, "big")
