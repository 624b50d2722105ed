"""Between the pages and the loop that serves the vehicle: orders in, news out; neither side ever waits for the other.

The vehicle's loop calls `turn` in each of its rounds. Whatever a page orders goes through the component's own desk,
with its limits, exactly like an order that comes over the link.
"""

from __future__ import annotations

import math
import queue
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Final, Protocol

from gcs_plugin.component.orders import Follow, HandToAutopilot, LocateOrder, Order, point, rectangle
from gcs_plugin.console.pictures import Pictures
from gcs_plugin.console.scene import Scene
from gcs_plugin.console.targets import TargetList
from mission.camera import Camera
from mission.procedure.result import Stage
from mission.records import FlightSightings, Frame
from mission.settings import MissionSettings
from mission.track import Track
from mission.vehicle.drone import Drone, Telemetry
from mission.video import VideoSource, VideoStats

OLD_PICTURE_S: Final = 4.0
"""Who was marked in a picture older than this may be anywhere by now."""
FOLLOWED_S: Final = 1.5
"""Who is followed was seen this recently, or may be somewhere else."""
ANSWER_S: Final = 3.0
LOOK_S: Final = 0.2
_MOST_WAITING: Final = 20
_MOST_NEWS: Final = 40


class Orders(Protocol):
    """Where orders are given (`gcs_plugin.component.CameraComponent`)."""

    @property
    def settings(self) -> MissionSettings:
        """Of now."""
        ...

    @property
    def busy(self) -> bool:
        """Whether an order waits or runs."""
        ...

    @property
    def flying(self) -> bool:
        """Whether an order to fly waits or runs."""
        ...

    def order(self, order: Order) -> str:
        """Take an order; why not, or empty."""
        ...

    def abort(self) -> None:
        """End what runs."""
        ...


@dataclass(frozen=True, slots=True)
class News:
    """A line for the operator."""

    number: int
    t_s: float
    text: str


@dataclass(frozen=True, slots=True)
class Flight:
    """How far an order has come."""

    stage: str = ""
    text: str = ""
    since_s: float = 0.0
    left_s: float | None = None
    """Seconds that it usually still takes; None where that is not known."""


@dataclass(frozen=True, slots=True)
class _Request:
    order: Order | None
    """None: abort."""
    answer: Future[str]


@dataclass(frozen=True, slots=True)
class _Vehicle:
    drone: Drone
    orders: Orders
    camera: Camera


@dataclass(frozen=True, slots=True)
class Status:
    """What the vehicle and its video say of themselves."""

    t_s: float
    telemetry: Telemetry
    name: str
    busy: bool
    flying: bool
    video: VideoStats | None


class ConsoleDesk:
    """The console's side of the vehicle's loop.

    Args:
        targets: the list that pages show.
        clock: the program's clock, seconds.
    """

    def __init__(self, targets: TargetList, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.targets = targets
        self.pictures = Pictures(clock)
        self.scene = Scene()
        self._requests: queue.Queue[_Request] = queue.Queue(maxsize=_MOST_WAITING)
        self._vehicle: _Vehicle | None = None
        self._source: VideoSource | None = None
        self._news: deque[News] = deque(maxlen=_MOST_NEWS)
        self._lock = threading.Lock()
        self._count = 0
        self._next_look_s = -math.inf
        self.flight = Flight()
        self.status: Status | None = None
        self._followed: tuple[float, tuple[float, float, float, float]] | None = None

    # What pages ask for.

    def order(self, order: Order | None) -> Future[str]:
        """Leave an order, or an abort for None. The answer says why it is not taken; it is empty where it is."""
        request = _Request(order, Future())
        try:
            self._requests.put_nowait(request)
        except queue.Full:
            request.answer.set_result("too many orders wait; is the drone connected?")
        return request.answer

    def mark(self, picture: int, box: tuple[float, float, float, float]) -> Order | str:
        """The order to follow, from this picture on, who was marked in it, without flying; or why there is none."""
        exposed_s = self.pictures.time_of(picture)
        if exposed_s is None or self._clock() - exposed_s > OLD_PICTURE_S:
            return "the picture in which you marked is too old; mark again"
        left, top, right, bottom = box
        found = point(left, top) if (left, top) == (right, bottom) else rectangle(left, top, right, bottom)
        return "the mark is outside the picture, or too thin" if found is None else Follow(found)

    def news(self, after: int) -> list[News]:
        """Lines after the one with this number."""
        with self._lock:
            return [line for line in self._news if line.number > after]

    @property
    def idle(self) -> bool:
        """Whether nothing flies."""
        return self.status is None or not self.status.busy

    @property
    def following(self) -> bool:
        """Whether somebody who was marked is followed in the picture, was just seen there, and nothing flies."""
        followed = self._followed
        if self.status is None or not self.status.busy or self.status.flying or followed is None:
            return False
        return self._clock() - followed[0] < FOLLOWED_S

    def locate(self) -> Order | str:
        """The order to locate who is followed, where they were just seen, and nobody else; or why there is none."""
        followed = self._followed
        if not self.following or followed is None:
            return "nobody is followed; mark somebody first"
        found = rectangle(*followed[1])
        return "who is followed has left the picture" if found is None else LocateOrder(found)

    # What the vehicle's loop tells.

    def attach(self, drone: Drone, orders: Orders, camera: Camera) -> None:
        """This vehicle is served from now on."""
        self._vehicle = _Vehicle(drone, orders, camera)

    def detach(self) -> None:
        """The vehicle is gone; orders are refused until another one comes."""
        self._vehicle, self.status = None, None
        self.play(None, None)
        self._refuse_all("the drone is not connected")

    def turn(self) -> None:
        """A round of the vehicle's loop."""
        vehicle = self._vehicle
        if vehicle is None:
            return
        while True:
            try:
                request = self._requests.get_nowait()
            except queue.Empty:
                break
            if request.order is None:
                vehicle.orders.abort()
                self.said("abort ordered: the drone stops and holds its place")
                request.answer.set_result("")
            else:
                request.answer.set_result(vehicle.orders.order(request.order))
        now_s = self._clock()
        if now_s >= self._next_look_s:
            self._next_look_s = now_s + LOOK_S
            self._look(vehicle, now_s)

    def play(self, source: VideoSource | None, camera: Camera | None) -> None:
        """The video that is open now."""
        self._source = source
        self.pictures.play(source)
        if self._vehicle is not None and camera is not None:
            self._vehicle = _Vehicle(self._vehicle.drone, self._vehicle.orders, camera)

    def stage(self, stage: Stage, text: str) -> None:
        """A new stage of the flight, or news of the present one."""
        now_s = self._clock()
        same = self.flight.stage == stage.value
        left_s = self._usual_s(stage)
        self.flight = Flight(stage.value, text, self.flight.since_s if same else now_s, left_s)
        self.said(f"{stage.value}: {text}")
        if self._vehicle is not None and stage is Stage.DETECT and not same:
            self.scene.begin()
        if self._vehicle is not None and stage is Stage.HOVER and not same:
            radius_m = self._vehicle.orders.settings.limits.radius_m
            self.scene.fence_around(self._vehicle.drone, radius_m, now_s)

    def frame(self, frame: Frame, track: Track | None) -> None:
        """A picture of the flight's loop."""
        self.pictures.offer(frame, track)
        if track is not None and track.state == "tracking" and not self.flight.stage:
            height, width = frame.image.shape[:2]
            box = track.box
            corners = box.left_px / width, box.top_px / height, box.right_px / width, box.bottom_px / height
            self._followed = self._clock(), corners
        if track is not None and self._vehicle is not None and self.flight.stage == Stage.SIDESTEP.value:
            self.scene.sight(frame, track, self._vehicle.drone, self._vehicle.camera)

    def measured(self, flight: FlightSightings) -> None:
        """The sightings that an answer was made from."""
        if self._vehicle is not None:
            self.scene.measured(flight, self._vehicle.camera)

    def said(self, text: str) -> None:
        """A line for the operator."""
        with self._lock:
            self._count += 1
            self._news.append(News(self._count, self._clock(), text))

    def ended(self) -> None:
        """The order has ended."""
        self.flight, self._followed = Flight(), None

    def close(self) -> None:
        """The program ends."""
        self._refuse_all("the program ends")
        self.pictures.close()

    def _look(self, vehicle: _Vehicle, now_s: float) -> None:
        busy = vehicle.orders.busy
        if self.pictures.wanted or busy:  # else the link is spared
            self.scene.look(vehicle.drone, vehicle.camera, now_s, flying=bool(self.flight.stage))
        stats = None if self._source is None else self._source.stats()
        self.status = Status(now_s, vehicle.drone.telemetry(), vehicle.drone.name, busy, vehicle.orders.flying, stats)

    def _usual_s(self, stage: Stage) -> float | None:
        if self._vehicle is None:
            return None
        pattern = self._vehicle.orders.settings.pattern
        legs = {"out-and-back": 2, "s": 4}.get(pattern.kind)
        flown = None if legs is None else legs * pattern.leg_duration_s * pattern.passes + 1.0
        usual: dict[Stage, float | None] = {
            Stage.DETECT: 2.0,
            Stage.HOVER: 2.0,
            Stage.CENTRE: 4.0,
            Stage.SIDESTEP: flown,
            Stage.ESTIMATE: 4.0,
            Stage.REPORT: 1.0,
        }
        return usual.get(stage)

    def _refuse_all(self, why: str) -> None:
        while True:
            try:
                self._requests.get_nowait().answer.set_result(why)
            except queue.Empty:
                return


def hand_to_autopilot(what: str) -> HandToAutopilot | None:
    """The order to give the last answer to the autopilot: look at it, or a waypoint beside it."""
    return {
        "roi": HandToAutopilot(roi=True, waypoint=False),
        "waypoint": HandToAutopilot(roi=False, waypoint=True),
    }.get(what)
