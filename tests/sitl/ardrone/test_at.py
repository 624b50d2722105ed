"""AT strings worked out by hand from the Developer Guide (SDK 2.0), each with its truncated and its corrupted twin."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl.ardrone.at import (
    Comwdg,
    Config,
    ConfigIds,
    Ctrl,
    Ftrim,
    Other,
    Pcmd,
    Ref,
    parse_datagram,
)

GOLDEN = [
    # 290718208 = 0x11540200: the bits that are always set (18, 20, 22, 24, 28) and bit 9
    (b"AT*REF=101,290718208\r", Ref(101, 0x11540200)),
    (b"AT*REF=102,290717952\r", Ref(102, 0x11540100)),
    # -0.8 is 0xBF4CCCCD, as a signed integer -1085485875 (the guide's own example, section 6.6)
    (b"AT*PCMD=368,1,0,0,0,-1085485875\r", Pcmd(368, 1, 0.0, 0.0, 0.0, -0.800000011920929)),
    # -1.0 is 0xBF800000, 0.5 is 0x3F000000
    (b"AT*PCMD=7,1,-1082130432,1056964608,0,0\r", Pcmd(7, 1, -1.0, 0.5, 0.0, 0.0)),
    (b"AT*PCMD_MAG=8,5,0,0,0,0,1056964608,0\r", Pcmd(8, 5, 0.0, 0.0, 0.0, 0.0, 0.5)),
    (b"AT*FTRIM=3\r", Ftrim(3)),
    (b"AT*FTRIM=3,\r", Ftrim(3)),
    (b"AT*COMWDG=4\r", Comwdg(4)),
    (b"AT*CTRL=5,5,0\r", Ctrl(5, 5)),
    (b"AT*CTRL=6,4\r", Ctrl(6, 4)),
    (b'AT*CONFIG=605,"general:navdata_demo","TRUE"\r', Config(605, "general:navdata_demo", "TRUE")),
    (b'AT*CONFIG=9,"custom:session_desc","a,b \\"c\\""\r', Config(9, "custom:session_desc", 'a,b "c"')),
    (b'AT*CONFIG_IDS=604,"aaaaaaaa","bbbbbbbb","cccccccc"\r', ConfigIds(604, "aaaaaaaa", "bbbbbbbb", "cccccccc")),
    (b"AT*LED=11,2,1073741824,4\r", Other(11, "LED")),
]


@pytest.mark.parametrize(("text", "command"), GOLDEN)
def test_golden_string_is_read(text: bytes, command: object) -> None:
    assert parse_datagram(text) == [command]


@pytest.mark.parametrize(
    "text",
    [
        b"AT*REF=101,\r",
        b"AT*REF=101,2907182x8\r",
        b"AT*REF=,290718208\r",
        b"AT*REF\r",
        b"AT*PCMD=368,1,0,0,0\r",
        b"AT*PCMD=368,1,0,0,0,-1085485875,0\r",
        b"AT*PCMD=368,1,0,0,0,2143289344\r",  # not a number
        b"AT*PCMD=368,1,0,0,0,2139095040\r",  # infinite
        b'AT*CONFIG=605,"general:navdata_demo"\r',
        b'AT*CONFIG=605,"general:navdata_demo","TRUE\r',
        b"AT*CONFIG=605,general:navdata_demo,TRUE\r",
        b'AT*CONFIG_IDS=604,"aaaaaaaa","bbbbbbbb"\r',
        b"at*ref=1,290718208\r",
        b"\xff\xfe\x00",
        b"",
    ],
)
def test_truncated_or_corrupted_string_is_ignored(text: bytes) -> None:
    assert parse_datagram(text) == []


def test_several_commands_travel_in_one_datagram_and_a_bad_one_spoils_only_itself() -> None:
    data = b"AT*PCMD=21625,1,0,0,0,0\rAT*REF=oops\rAT*REF=21626,290717696\r"
    assert parse_datagram(data) == [Pcmd(21625, 1, 0.0, 0.0, 0.0, 0.0), Ref(21626, 290717696)]


def test_too_long_a_command_is_rejected_as_a_whole() -> None:
    value = "x" * 1024
    assert parse_datagram(f'AT*CONFIG=1,"general:ardrone_name","{value}"\r'.encode()) == []


def test_fractions_beyond_the_limits_are_cut() -> None:
    (command,) = parse_datagram(b"AT*PCMD=1,1,1092616192,0,0,0\r")  # 10.0
    assert isinstance(command, Pcmd)
    assert command.roll == 1.0


@settings(deadline=None, derandomize=True)
@given(st.binary(max_size=300))
def test_any_bytes_are_survived(data: bytes) -> None:
    parse_datagram(data)
    parse_datagram(b"AT*" + data)
    parse_datagram(b"AT*CONFIG=1," + data + b"\r")
