"""PaVE, the "Parrot Video Encapsulation": the header before each picture (or slice of one) on the video port.

Source: ARDroneLib, video_encapsulation.h (64 bytes, little-endian, version 2), and the Developer Guide's section 7.3.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

SIGNATURE = b"PaVE"
VERSION = 2
H264 = 4
"""CODEC_MPEG4_AVC."""
HEADER_BYTES = 64

_HEADER = struct.Struct("<4sBBHIHHHHIIBBBBIIHBBBB2xI12x")


class FrameType(IntEnum):
    """What follows the header."""

    IDR = 1
    """Parameter sets, then a picture that needs no other."""
    I = 2  # noqa: E741 (the standard's name)
    P = 3
    HEADERS = 4


@dataclass(frozen=True, slots=True)
class Pave:
    """The fields that vary."""

    payload_bytes: int
    encoded_width_px: int
    encoded_height_px: int
    display_width_px: int
    display_height_px: int
    frame_number: int
    timestamp_ms: int
    """Since the aircraft's start."""
    frame_type: FrameType
    stream_position: int
    """Bytes of payload sent before this one."""
    stream_id: int = 1
    slices: int = 1
    slice_index: int = 0
    sps_bytes: int = 0
    """Length of the sequence parameter set at the payload's start; 0 when there is none."""
    pps_bytes: int = 0

    def pack(self, header_bytes: int = HEADER_BYTES) -> bytes:
        """The header; longer than 64 bytes it ends in zeros, as later firmware's does."""
        packed = _HEADER.pack(
            *(SIGNATURE, VERSION, H264, header_bytes, self.payload_bytes),
            *(self.encoded_width_px, self.encoded_height_px, self.display_width_px, self.display_height_px),
            *(self.frame_number & 0xFFFFFFFF, self.timestamp_ms & 0xFFFFFFFF, 1, 0, self.frame_type, 0),
            *(self.stream_position & 0xFFFFFFFF, self.stream_position >> 32 & 0xFFFFFFFF, self.stream_id),
            *(self.slices, self.slice_index, self.sps_bytes & 0xFF, self.pps_bytes & 0xFF, 0),
        )
        return packed.ljust(header_bytes, b"\0")


def nal_units(payload: bytes) -> list[bytes]:
    """The units of an Annex B byte stream, each with its start code."""
    starts = []
    at = payload.find(b"\0\0\1")
    while at >= 0:
        starts.append(at - 1 if at > 0 and payload[at - 1] == 0 else at)
        at = payload.find(b"\0\0\1", at + 3)
    return [payload[a:b] for a, b in zip(starts, [*starts[1:], len(payload)], strict=True)]


def nal_type(unit: bytes) -> int:
    """Type of a unit with its start code: 1 is a slice, 5 an IDR slice, 6 SEI, 7 SPS, 8 PPS."""
    return unit[unit.index(b"\1") + 1] & 0x1F
