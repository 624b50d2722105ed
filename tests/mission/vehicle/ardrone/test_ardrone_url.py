"""The address of an AR.Drone, as operators write it."""

from __future__ import annotations

import math

import pytest

from mission.errors import SettingsError
from mission.vehicle.ardrone.url import ArdroneAddress, ardrone_address, is_ardrone
from mission.vehicle.make import make_drone


def test_the_plain_address_has_the_ports_of_the_sdk() -> None:
    assert ardrone_address("ardrone://192.168.1.1") == ArdroneAddress("192.168.1.1", 5556, 5554, 5555)


def test_everything_can_be_set() -> None:
    found = ardrone_address(
        "ardrone://127.0.0.1?at=1&navdata=2&video=3&declination=-2.5&scale=0.95&codec=720p&size=640x480"
    )
    assert found == ArdroneAddress("127.0.0.1", 1, 2, 3, math.radians(-2.5), 0.95, 0x83, (640, 480))


@pytest.mark.parametrize(
    "url",
    [
        "udpin://0.0.0.0:14540",
        "ardrone://",
        "ardrone://host:5556",
        "ardrone://host/path",
        "ardrone://host?at=0",
        "ardrone://host?at=65536",
        "ardrone://host?at=x",
        "ardrone://host?at",
        "ardrone://host?speed=9",
        "ardrone://host?declination=nan",
        "ardrone://host?scale=0",
        "ardrone://host?codec=4k",
        "ardrone://host?size=640",
        "ardrone://host?size=1x1",
    ],
)
def test_wrong_addresses_are_refused_with_a_remedy(url: str) -> None:
    with pytest.raises(SettingsError) as caught:
        ardrone_address(url)
    assert "ardrone://192.168.1.1" in caught.value.remedy


def test_the_factory_tells_the_aircraft_apart() -> None:
    assert is_ardrone("ARDRONE://192.168.1.1")
    assert make_drone("ardrone://192.168.1.1").name == "ardrone-192.168.1.1"
    assert make_drone("udpin://127.0.0.1:14540").capabilities.position_setpoints
    with pytest.raises(SettingsError):
        make_drone("ardrone://")
