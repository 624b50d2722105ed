"""An aircraft and a camera that note on a tape what they answer, for the procedure that flies with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from mission.observation.tape import AllPoses, OrderTape, Tape
from mission.pose.buffer import Pose, PoseAt
from mission.pose.history import PoseHistory
from mission.records import Frame, GeodeticOrigin, NoiseModel
from mission.vehicle.drone import (
    Bounds,
    CameraPointer,
    Capabilities,
    Drone,
    DroneEvent,
    Order,
    OrderState,
    Path,
    Telemetry,
)
from mission.video import VideoSource, VideoStats

FINAL = (OrderState.DONE, OrderState.REFUSED, OrderState.ENDED)


class RecordedVideo:
    """A `VideoSource` whose pictures are noted; the flight closes the source itself.

    Args:
        source: of the pictures.
        tape: noted on.
        clock: the program's clock, seconds.
    """

    def __init__(self, source: VideoSource, tape: Tape, clock: Callable[[], float]) -> None:
        self._source, self._tape, self._clock = source, tape, clock
        self._given = False

    def latest(self, after_index: int, timeout_s: float) -> Frame | None:
        """See `VideoSource.latest`."""
        self._given = False
        frame = self._source.latest(after_index, timeout_s)
        if frame is not None:
            self._tape.give(frame, self._clock())
            self._given = True
        return frame

    def clock(self) -> float:
        """The program's clock for the procedure that is given these pictures: what it reads is noted, too.

        While it waits for a picture it reads the clock as often as it happens to; that decides nothing.
        """
        now_s = self._clock()
        if self._given:
            self._tape.given[-1].read_s.append(now_s)
        return now_s

    def stats(self) -> VideoStats:
        """See `VideoSource.stats`."""
        stats = self._source.stats()
        self._tape.video_note = stats.note
        return stats

    def close(self) -> None:
        """See `VideoSource.close`."""
        self._source.close()


@dataclass(slots=True)
class RecordedOrder:
    """An order whose fate is noted when it is first seen."""

    order: Order
    tape: OrderTape
    given: list[object] = field(default_factory=list)
    """The tape's pictures: their number is the time."""

    @property
    def kind(self) -> str:
        """See `Order`."""
        return self.order.kind

    @property
    def state(self) -> OrderState:
        """See `Order`."""
        state = self.order.state
        if state in FINAL and self.tape.ended_at < 0:
            self.tape.state, self.tape.reason, self.tape.ended_at = state.value, self.order.reason, len(self.given)
            self.tape.ended_s = self.order.ended_s
        return state

    @property
    def reason(self) -> str:
        """See `Order`."""
        return self.order.reason

    @property
    def started_s(self) -> float | None:
        """See `Order`."""
        started_s = self.order.started_s
        if started_s is not None and self.tape.started_at < 0:
            self.tape.started_s, self.tape.started_at = started_s, len(self.given)
        return started_s

    @property
    def ended_s(self) -> float | None:
        """See `Order`."""
        return self.order.ended_s


class RecordedDrone:
    """A `Drone` that notes what decides an answer, and hands everything through.

    Args:
        drone: the aircraft.
        tape: noted on.
    """

    def __init__(self, drone: Drone, tape: Tape) -> None:
        self._drone, self._tape = drone, tape

    @property
    def name(self) -> str:
        """See `Drone`."""
        return self._drone.name

    @property
    def capabilities(self) -> Capabilities:
        """See `Drone`."""
        return self._drone.capabilities

    @property
    def gimbal(self) -> CameraPointer | None:
        """See `Drone`."""
        return self._drone.gimbal

    @property
    def origin(self) -> GeodeticOrigin | None:
        """See `Drone`."""
        self._tape.origin = self._drone.origin
        if self._tape.all_poses:
            self._tape.all_poses[-1].origin = self._tape.origin
        return self._tape.origin

    def connect(self, timeout_s: float) -> None:
        """See `Drone`."""
        self._drone.connect(timeout_s)

    def close(self) -> None:
        """See `Drone`."""
        self._drone.close()

    def keep_alive(self) -> None:
        """See `Drone`."""
        self._drone.keep_alive()

    def telemetry(self) -> Telemetry:
        """See `Drone`."""
        telemetry = self._drone.telemetry()
        if self._tape.telemetry is None or not self._tape.given:
            self._tape.telemetry = telemetry
        return telemetry

    def pose_at(self, t_s: float) -> Pose | None:
        """See `Drone`."""
        pose = self._drone.pose_at(t_s)
        self._tape.poses.append((t_s, pose))
        return pose

    def poses(self) -> PoseAt:
        """See `Drone`."""
        known = self._drone.poses()
        history = getattr(known, "__self__", None)
        if isinstance(history, PoseHistory):
            self._tape.all_poses.append(AllPoses(history))
        return known

    def noise(self) -> NoiseModel:
        """See `Drone`."""
        noise = self._drone.noise()
        if self._tape.all_poses:
            self._tape.all_poses[-1].noise = noise
        return noise

    def pose_note(self) -> str:
        """See `Drone`."""
        note = self._drone.pose_note()
        if self._tape.all_poses:
            self._tape.all_poses[-1].note = note
        return note

    def begin(self, bounds: Bounds) -> None:
        """See `Drone`."""
        self._drone.begin(bounds)

    def take_off(self, height_m: float) -> Order:
        """See `Drone`."""
        return self._noted(self._drone.take_off(height_m))

    def hover(self) -> Order:
        """See `Drone`."""
        return self._noted(self._drone.hover())

    def turn_to(self, heading_rad: float) -> Order:
        """See `Drone`."""
        return self._noted(self._drone.turn_to(heading_rad))

    def fly(self, path: Path) -> Order:
        """See `Drone`."""
        return self._noted(self._drone.fly(path))

    def aim(self, heading_rad: float) -> None:
        """See `Drone`."""
        self._drone.aim(heading_rad)

    def hold(self) -> Order:
        """See `Drone`."""
        return self._noted(self._drone.hold())

    def land(self) -> Order:
        """See `Drone`."""
        return self._noted(self._drone.land())

    def events(self) -> list[DroneEvent]:
        """See `Drone`."""
        return self._drone.events()

    def _noted(self, order: Order) -> RecordedOrder:
        tape = OrderTape(order.kind)
        self._tape.orders.append(tape)
        given: list[object] = self._tape.given  # type: ignore[assignment]  # a list is invariant
        return RecordedOrder(order, tape, given)
