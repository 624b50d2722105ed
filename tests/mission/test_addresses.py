"""No spelling of an address carries its password into what is shown; harmless addresses stay as they are."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mission.addresses import has_secret, shown_address, without_secrets
from mission.errors import SettingsError, VideoError

SPELLINGS = [
    "rtsp://pilot:s3cr3t@camera/live",
    "RTSP://pilot:s3cr3t@camera:554/live",
    "rtsp://s3cr3t@camera/live",
    "rtsp://:s3cr3t@camera/live",
    "rtsp://pilot:a@s3cr3t@camera/live",
    "rtsp://pilot:a/s3cr3t@camera/live",
    "rtsp://pilot:12/s3cr3t@camera/live",
    "rtsp://pilot:a?s3cr3t@camera/live",
    "rtsp://pilot:a#s3cr3t@camera/live",
    "rtsp://pilot:a s3cr3t@camera/live",
    "rtsp://pilot:s3cr3t%40camera/live",
    "rtsp://pilot%3As3cr3t@camera/live",
    "rtsp%3A%2F%2Fpilot%3As3cr3t%40camera%2Flive",
    "rtsp%253A%252F%252Fpilot%253As3cr3t%2540camera%252Flive",
    "rtsp:/pilot:s3cr3t@camera/live",
    "rtsp:pilot:s3cr3t@camera/live",
    "pilot:s3cr3t@camera/live",
    "http://camera/video?user=pilot&password=s3cr3t",
    "http://camera/video?channel=1;pwd=s3cr3t",
    "http://camera/video?s3cr3t",
    "http://camera/video?s3cr3t=",
    "http://camera/video?channel=s3cr3t%26",
    "http://camera/video?TOKEN=s3cr3t",
    "http://camera/video?p%61ssword=s3cr3t",
    "http://camera/video%3Ftoken%3Ds3cr3t",
    "http://camera/video#s3cr3t",
    "http://proxy/?src=rtsp%3A%2F%2Fpilot%3As3cr3t%40camera",
    "camera/video.cgi?loginuse=pilot&loginpas=s3cr3t",
    "rtsp://camera:554/user=pilot_password=s3cr3t_channel=1_stream=0.sdp?real_stream",
    "srt://camera:9000?mode=caller&passphrase=s3cr3t",
    "https://camera/hls;token=s3cr3t/live.m3u8",
    "udpout://pilot:s3cr3t@10.0.0.2:14550",
    "rtsp://pilot:s3cr3t\uff20camera/live",
    "http://camera/token/s3cr3t/live.m3u8",
    "http://camera/API_KEY/s3cr3t",
    "rtsps://camera:7441/aBs3cr3t45fGhI78",
    "rtsps://camera:7441/aBs3cr3t45fGhI78?enableSrtp",
    "rtmp://camera/live/s3cr3t",
    "ardrone://pilot:s3cr3t@192.168.1.1",
]
HARMLESS = [
    "",
    "udp://127.0.0.1:5600",
    "udp://@239.1.1.1:5600",
    "udp://239.1.1.1:5600?localaddr=10.0.0.2&pkt_size=1316",
    "rtsp://[fe80::1]:554/Streaming/Channels/101",
    "rtsp://192.168.0.10:8554/main.264",
    "rtsp://192.168.0.10/h264Preview_01_main",
    "rtsp://192.168.0.10/Streaming/tracks/key.264",
    "/home/me/aB12cD34eF56gH78/flight.mp4",
    "session.sdp",
    "/dev/video0",
    "flight/%04d.png",
    "/home/me/user@home/flight.mp4",
    "serial:///dev/ttyACM0:57600",
    "ardrone://192.168.1.1?at=5556&navdata=5554&declination=-3.5&size=640x360",
]


@pytest.mark.parametrize("address", SPELLINGS)
def test_the_password_is_not_shown_in_any_spelling(address: str) -> None:
    assert "s3cr3t" not in shown_address(address)
    assert has_secret(address)


@pytest.mark.parametrize("address", SPELLINGS)
def test_neither_in_a_sentence_nor_in_an_error(address: str) -> None:
    assert "s3cr3t" not in without_secrets(f"The video '{address}' is away: look at {address}.")
    error = VideoError(f"No video arrives at {address}", f"Is {address!r} right?")
    assert "s3cr3t" not in f"{error} {error.cause} {error.remedy} {error!r}"


@pytest.mark.parametrize("address", HARMLESS)
def test_an_address_without_a_secret_stays_as_it_is(address: str) -> None:
    assert shown_address(address) == address
    assert not has_secret(address)
    assert without_secrets(f"at '{address}', again") == f"at '{address}', again"


def test_what_helps_the_operator_is_still_there() -> None:
    assert shown_address("rtsp://pilot:secret@camera/live?channel=1&token=4") == "rtsp://***@camera/live?channel=1&***"
    assert (
        str(SettingsError("no camera at rtsp://a:b@cam:554/1", "Look.")) == "no camera at rtsp://***@cam:554/1. Look."
    )


@given(
    user=st.text("ab@:/?#%& =;x", max_size=8),
    password=st.text("@:/?#%&=;\\'\"[]", max_size=6),
    scheme=st.sampled_from(["rtsp://", "http://", "tcp:/", ""]),
)
def test_any_character_may_stand_in_a_password(user: str, password: str, scheme: str) -> None:
    assert "s3cr3t" not in shown_address(f"{scheme}{user}:{password}s3cr3t{password}@camera/live")


@given(st.text())
def test_any_text_is_taken_and_hiding_twice_changes_nothing(text: str) -> None:
    assert shown_address(shown_address(text)) == shown_address(text)
    assert isinstance(without_secrets(text), str)
