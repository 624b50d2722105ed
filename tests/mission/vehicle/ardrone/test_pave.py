"""PaVE: a header worked out by hand from `video_encapsulation.h`, and streams that are broken."""

from __future__ import annotations

import random
import time

import pytest

from mission.vehicle.ardrone.pave import HEADER_SIZE, FrameType, PaveFrame, PaveSplitter

# Version 3, H.264 (4), header 64 bytes, payload 5; encoded 640 x 368, shown 640 x 360; frame 258, 4660 ms; 1 chunk, the
# 0th; P-frame (3); no control; byte position 0; stream 1; 1 slice, the 0th; no SPS, no PPS; 2 + 4 + 12 bytes reserved.
GOLDEN = (
    bytes.fromhex(
        "50615645 03 04 4000 05000000 8002 7001 8002 6801 02010000 34120000"
        "01 00 03 00 00000000 00000000 0100 01 00 00 00 0000 00000000"
    )
    + bytes(12)
    + b"hello"
)


def frame(number: int, payload: bytes = b"\x00\x00\x00\x01\x65picture", kind: FrameType = FrameType.P) -> bytes:
    """A whole frame, made from the golden one."""
    head = bytearray(GOLDEN[:HEADER_SIZE])
    head[8:12] = len(payload).to_bytes(4, "little")
    head[20:24] = number.to_bytes(4, "little")
    head[24:28] = (number * 33).to_bytes(4, "little")
    head[30] = int(kind)
    return bytes(head) + payload


def numbers(frames: list[PaveFrame]) -> list[int]:
    return [f.number for f in frames]


def test_golden() -> None:
    assert HEADER_SIZE == 64
    (found,) = PaveSplitter().feed(GOLDEN)
    assert found == PaveFrame(4, FrameType.P, 258, pytest.approx(4.66), 640, 360, 0, 1, b"hello")  # type: ignore[arg-type]
    assert not found.key


def test_golden_truncated() -> None:
    splitter = PaveSplitter()
    for length in range(len(GOLDEN)):
        assert PaveSplitter().feed(GOLDEN[:length]) == []
    assert splitter.feed(GOLDEN[:-1]) == []
    assert len(splitter.feed(GOLDEN[-1:])) == 1


@pytest.mark.parametrize(
    ("at", "value"),
    [(0, 0x51), (4, 0), (5, 9), (6, 0), (7, 0xFF), (11, 0xFF), (30, 9), (17, 0xFF), (13, 0)],
)
def test_golden_corrupted_is_passed_over(at: int, value: int) -> None:
    damaged = bytearray(GOLDEN)
    damaged[at] = value
    splitter = PaveSplitter()
    assert numbers(splitter.feed(bytes(damaged) + frame(9))) == [9]
    assert splitter.skipped_bytes >= len(GOLDEN)


def test_a_longer_header_of_later_firmware() -> None:
    longer = GOLDEN[:6] + (76).to_bytes(2, "little") + GOLDEN[8:64] + bytes(12) + b"hello"
    (found,) = PaveSplitter().feed(longer)
    assert found.payload == b"hello"


@pytest.mark.parametrize("size", [1, 7, 63, 64, 65, 1000])
def test_pieces_of_any_size(size: int) -> None:
    stream = b"".join(frame(n) for n in range(20))
    splitter = PaveSplitter()
    found = [f for at in range(0, len(stream), size) for f in splitter.feed(stream[at : at + size])]
    assert numbers(found) == list(range(20))
    assert splitter.skipped_bytes == 0


def test_joined_in_the_middle() -> None:
    stream = b"".join(frame(n) for n in range(3))
    assert numbers(PaveSplitter().feed(stream[30:])) == [1, 2]


def test_a_frame_that_claims_too_much_does_not_swallow_the_next_ones() -> None:
    greedy = bytearray(frame(1))
    greedy[8:12] = (900_000).to_bytes(4, "little")
    splitter = PaveSplitter()
    assert numbers(splitter.feed(bytes(greedy) + frame(2) + frame(3))) == [2, 3]
    assert splitter.damaged == 1


def test_a_signature_inside_a_picture_is_no_header() -> None:
    payload = b"xxPaVExx" + bytes(100)
    (found,) = PaveSplitter().feed(frame(1, payload))
    assert found.payload == payload


def test_broken_streams_never_raise_and_heal_with_the_next_frames(mutations: int) -> None:
    rng = random.Random(5555)
    began = time.perf_counter()
    streams = max(1, mutations // 20)
    for _ in range(streams):
        stream = bytearray(b"".join(frame(n, rng.randbytes(rng.randint(1, 400))) for n in range(10)))
        for _ in range(rng.randint(1, 10)):
            at = rng.randrange(len(stream))
            if rng.random() < 0.5:
                stream[at] = rng.randrange(256)
            else:
                del stream[at : at + rng.randint(1, 200)]
        splitter = PaveSplitter()
        at = 0
        while at < len(stream):
            step = rng.randint(1, 500)
            splitter.feed(bytes(stream[at : at + step]))
            at += step
        after = numbers(splitter.feed(b"".join(frame(n) for n in range(1000, 1003))))
        assert after[-2:] == [1001, 1002]
    assert time.perf_counter() - began < 0.02 * streams + 5.0
