from __future__ import annotations

import pytest

from mission.errors import SettingsError
from mission.vehicle.mavlink.url import mavsdk_url


@pytest.mark.parametrize(
    ("written", "mavsdk"),
    [
        ("udpin://0.0.0.0:14540", "udpin://0.0.0.0:14540"),
        ("udp://:14540", "udpin://0.0.0.0:14540"),
        ("udp://127.0.0.1:14550", "udpin://127.0.0.1:14550"),
        ("udp://192.168.1.7:14550", "udpout://192.168.1.7:14550"),
        ("udpout://drone.local:14550", "udpout://drone.local:14550"),
        ("tcp://127.0.0.1:5760", "tcpout://127.0.0.1:5760"),
        ("TCPOUT://127.0.0.1:5760", "tcpout://127.0.0.1:5760"),
        ("tcpin://:5760", "tcpin://0.0.0.0:5760"),
        ("serial:///dev/ttyACM0:57600", "serial:///dev/ttyACM0:57600"),
        ("serial:///dev/ttyUSB0", "serial:///dev/ttyUSB0:57600"),
        ("serial://COM3:115200", "serial://COM3:115200"),
    ],
)
def test_addresses_as_operators_write_them(written: str, mavsdk: str) -> None:
    assert mavsdk_url(written) == mavsdk


@pytest.mark.parametrize(
    ("written", "says"),
    [
        ("", "no scheme"),
        ("/dev/ttyACM0", "no scheme"),
        ("udpin:0.0.0.0:14540", "no scheme"),
        ("http://localhost:80", "unknown scheme"),
        ("udpin://0.0.0.0", "HOST:PORT"),
        ("udpin://0.0.0.0:70000", "outside 1 to 65535"),
        ("udpout://:14550", "no host"),
        ("tcp://a b:1", "HOST:PORT"),
        ("serial://", "DEVICE:BAUD"),
        ("serial:///dev/ttyACM0:7", "baud rate 7"),
    ],
)
def test_nonsense_is_refused_with_an_example(written: str, says: str) -> None:
    with pytest.raises(SettingsError, match=says) as caught:
        mavsdk_url(written)
    assert "udpin://0.0.0.0:14540" in caught.value.remedy
