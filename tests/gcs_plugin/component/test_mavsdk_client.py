"""MAVSDK's camera client, a real one that speaks as QGroundControl does, against the component on a real link."""

from __future__ import annotations

import statistics
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal

import pytest
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.camera import camera as client
from mavsdk.plugins.mavlink_direct.mavlink_direct import MavlinkDirect
from mavsdk.system import System
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority import Authority
from gcs_plugin.component import CameraComponent, Identity, LocateOrder, Order, Picture, StationLink
from gcs_plugin.component.tracking import TrackedBox
from mission.records import Box
from mission.settings import MissionSettings, OrderSettings
from mission.track import Track
from mission.vehicle.mavlink.link import MavlinkLink
from mission.vehicle.pilot.loopback import loopback_socket

BOX = Box(160.0, 120.0, 64.0, 240.0)


@dataclass
class Served:
    """The component in its loop, with a procedure that tracks until it is stopped or told to find the target."""

    refusal: str = ""
    answer: bool = False
    box: Literal["locate", "track"] = "locate"
    orders: list[Order] = field(default_factory=list)
    stopped: int = 0

    def __post_init__(self) -> None:
        sock = loopback_socket()
        self.port = int(sock.getsockname()[1])
        self._link = MavlinkLink(sock, source_system=1, source_component=193, target_system=1, heartbeat=False)
        self._station = StationLink(self._link, 100)
        settings = MissionSettings(orders=OrderSettings(box=self.box))
        self._component = CameraComponent(
            self._station,
            Identity(1),
            Picture(640, 480, 1.1, "rtsp://camera/stream"),
            settings,
            Authority(settings.authority),
            lambda _: self.refusal,
        )
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self._link.close()

    def _run(self) -> None:
        with self._component as component:
            while not self._end.is_set():
                order = component.attend(0.05)
                if order is not None:
                    self.orders.append(order)
                    component.ended(self._carry_out(component))

    def _carry_out(self, component: CameraComponent) -> int:
        index = 0
        while not component.should_stop() and not self._end.is_set():
            index += 1
            track = Track(index, time.monotonic(), "tracking", BOX, BOX.centre_px, 1.0, 240.0, 0.03, 1.0)
            component.tracking(TrackedBox(track, 640, 480))
            component.step(0.05)
            if self.answer:
                geo = mavlink.MAVLink_camera_tracking_geo_status_message(1, 473977642, 85457195, *([1.0] * 10))
                self._station.send(geo)
                return 0
        self.stopped += 1
        return 6


@dataclass
class Client:
    """A ground station."""

    mavsdk: Mavsdk
    system: System
    camera: client.Camera

    @property
    def id(self) -> int:
        return int(self.camera.camera_list().cameras[0].component_id)


@pytest.fixture
def served(request: pytest.FixtureRequest) -> Iterator[Served]:
    served = Served(box=getattr(request, "param", "locate"))
    yield served
    served.close()


@pytest.fixture
def station(served: Served) -> Iterator[Client]:
    mavsdk = Mavsdk(Configuration.create_manual(245, 190, True))
    mavsdk.add_any_connection(f"udpout://127.0.0.1:{served.port}")
    deadline = time.monotonic() + 10.0
    while not (systems := mavsdk.get_systems()) and time.monotonic() < deadline:
        time.sleep(0.02)  # looks again until the deadline
    camera = client.Camera(systems[0])
    while not camera.camera_list().cameras and time.monotonic() < deadline:
        time.sleep(0.02)  # looks again until the deadline
    yield Client(mavsdk, systems[0], camera)
    camera.destroy()
    mavsdk.destroy()


def until(condition: Callable[[], object], timeout_s: float = 5.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)  # looks again until the deadline
    return bool(condition())


def test_the_camera_is_discovered_by_its_name(station: Client) -> None:
    (camera,) = station.camera.camera_list().cameras
    assert (camera.vendor_name, camera.model_name) == ("Sidestep", "Person locator")
    assert camera.component_id == 100
    assert (camera.horizontal_resolution_px, camera.vertical_resolution_px) == (640, 480)


def test_a_box_is_accepted_and_starts_a_locate(served: Served, station: Client) -> None:
    station.camera.track_rectangle(station.id, 0.25, 0.25, 0.5, 0.75)
    assert until(lambda: served.orders)
    order = served.orders[0]
    assert isinstance(order, LocateOrder)
    assert order.mark is not None
    assert (order.mark.left, order.mark.bottom) == (0.25, 0.75)


def test_the_stop_button_stops_it_and_the_next_click_starts_anew(served: Served, station: Client) -> None:
    station.camera.track_point(station.id, 0.5, 0.5, 0.1)
    assert until(lambda: served.orders)
    station.camera.track_stop(station.id)
    assert until(lambda: served.stopped == 1)
    station.camera.track_point(station.id, 0.25, 0.5, 0.1)
    assert until(lambda: len(served.orders) == 2)


def test_what_cannot_be_flown_is_refused(served: Served, station: Client) -> None:
    served.refusal = "the vehicle is not armed and airborne"
    with pytest.raises(client.CameraError) as refused:
        station.camera.track_rectangle(station.id, 0.25, 0.25, 0.5, 0.75)
    assert refused.value.result is client.CameraResult.DENIED or refused.value.result is client.CameraResult.BUSY


def test_the_client_gets_the_box_at_the_rate_it_asks_for_and_the_answer(served: Served, station: Client) -> None:
    direct = MavlinkDirect(station.system)
    got: dict[str, list[str]] = {"CAMERA_TRACKING_IMAGE_STATUS": [], "CAMERA_TRACKING_GEO_STATUS": []}
    for name, found in got.items():
        direct.subscribe_message(name, lambda message, _, found=found: found.append(message.fields_json))
    station.camera.track_rectangle(station.id, 0.25, 0.25, 0.5, 0.75)
    assert until(lambda: len(got["CAMERA_TRACKING_IMAGE_STATUS"]) >= 2)
    assert '"rec_top_x":0.25' in got["CAMERA_TRACKING_IMAGE_STATUS"][0].replace(" ", "")
    served.answer = True
    assert until(lambda: got["CAMERA_TRACKING_GEO_STATUS"])
    assert "473977642" in got["CAMERA_TRACKING_GEO_STATUS"][0]
    direct.destroy()


@pytest.mark.parametrize("served", ["track"], indirect=True)  # flights in a minute are limited
def test_from_box_to_acknowledgement_in_a_tenth_of_a_second(served: Served, station: Client) -> None:
    took = []
    for i in range(15):
        began = time.monotonic()
        station.camera.track_rectangle(station.id, 0.25, 0.25, 0.5, 0.5 + i / 100.0)
        took.append(time.monotonic() - began)
        wanted = i + 1
        assert until(lambda: len(served.orders) == wanted)  # noqa: B023  asked at once
        station.camera.track_stop(station.id)
        assert until(lambda: served.stopped == wanted)  # noqa: B023  asked at once
    assert statistics.median(took) < 0.1
