"""AT commands against lines worked out by hand from the AR.Drone SDK 2.0 Developer Guide, chapter 6."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.vehicle.ardrone.at import (
    MAX_DATAGRAM,
    AtCommand,
    CtrlMode,
    Sequencer,
    Tilt,
    clamped,
    comwdg,
    config,
    config_ids,
    ctrl,
    float_as_int,
    ftrim,
    pcmd,
    ref,
)


@pytest.mark.parametrize(
    ("command", "line"),
    [
        # 290717696 = bits 18, 20, 22, 24 and 28; + 512 = take-off; + 256 = emergency.
        (ref(fly=False), b"AT*REF=7,290717696\r"),
        (ref(fly=True), b"AT*REF=7,290718208\r"),
        (ref(fly=False, emergency=True), b"AT*REF=7,290717952\r"),
        (pcmd(None), b"AT*PCMD=7,0,0,0,0,0\r"),
        # -1.0 = 0xBF800000 = -1082130432; 0.5 = 0x3F000000 = 1056964608; -0.8 = 0xBF4CCCCD = -1085485875.
        (
            pcmd(Tilt(roll=-1.0, pitch=0.5, gaz=-0.8, yaw=1.0)),
            b"AT*PCMD=7,1,-1082130432,1056964608,-1085485875,1065353216\r",
        ),
        (ftrim(), b"AT*FTRIM=7\r"),
        (comwdg(), b"AT*COMWDG=7\r"),
        (config("general:navdata_demo", "TRUE"), b'AT*CONFIG=7,"general:navdata_demo","TRUE"\r'),
        (config_ids("d2e081a3", "be27e2e4", "d87f7e0c"), b'AT*CONFIG_IDS=7,"d2e081a3","be27e2e4","d87f7e0c"\r'),
        (ctrl(CtrlMode.ACKNOWLEDGE), b"AT*CTRL=7,5,0\r"),
        (ctrl(CtrlMode.GET_CONFIGURATION), b"AT*CTRL=7,4,0\r"),
    ],
)
def test_line(command: AtCommand, line: bytes) -> None:
    assert command.encode(7) == line


@pytest.mark.parametrize("share", [1.0001, -1.5, math.nan, math.inf])
def test_a_share_beyond_the_maximum_is_refused(share: float) -> None:
    with pytest.raises(ValueError, match="from -1 to 1"):
        float_as_int(share)


@pytest.mark.parametrize("value", ['a"b', "a\rAT*REF=1,290718208", "grün"])
def test_a_value_cannot_smuggle_a_second_command(value: str) -> None:
    with pytest.raises(ValueError, match="AT command"):
        config("general:name", value)


def test_sequence_numbers_begin_at_one_and_rise_over_datagrams() -> None:
    sequencer = Sequencer()
    assert sequencer.datagrams([comwdg(), ftrim()]) == [b"AT*COMWDG=1\rAT*FTRIM=2\r"]
    assert sequencer.datagrams([comwdg()]) == [b"AT*COMWDG=3\r"]
    with pytest.raises(ValueError, match="begin at 1"):
        comwdg().encode(0)


def test_no_datagram_exceeds_the_limit_and_none_splits_a_line() -> None:
    datagrams = Sequencer().datagrams([config("general:name", "x" * 200)] * 20)
    assert len(datagrams) > 1
    assert all(len(d) <= MAX_DATAGRAM and d.endswith(b"\r") for d in datagrams)
    with pytest.raises(ValueError, match="more than 1024"):
        Sequencer().datagrams([config("general:name", "x" * 1024)])


@given(st.floats())
def test_clamped_is_always_a_share(value: float) -> None:
    assert -1.0 <= clamped(value) <= 1.0
    float_as_int(clamped(value))
