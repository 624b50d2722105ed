"""`Drone`: the one interface that every aircraft shares.

It is drawn for two: a MAVLink autopilot (position setpoints, global position) and the AR.Drone 2.0 (roll, pitch and
yaw-rate commands only, perhaps no GPS fix). Orders return at once with an `Order` that the caller watches; nothing here
blocks on the flight. The aircraft is flown by a process of its own (`mission.vehicle.mavlink.pilot`) that stops it when
this one falls silent.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Literal, Protocol

from mission.pose.buffer import Pose, PoseAt
from mission.records import GeodeticOrigin, NoiseModel

Offset = tuple[float, float, float]
"""East, north, up, metres, relative to where the path starts."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """The room that a flight may use; checked before it starts and at every setpoint."""

    radius_m: float = 15.0
    """Horizontal distance from where control was taken."""
    min_height_m: float = 1.0
    """Above home."""
    max_height_m: float = 30.0
    """Above home."""
    max_speed_m_s: float = 3.0
    max_duration_s: float = 60.0
    """From taking control to giving it back."""


@dataclass(frozen=True, slots=True)
class Knot:
    """A point of a path: where to be and how fast at `t_s` after the path's start."""

    t_s: float
    offset_enu_m: Offset
    velocity_enu_m_s: Offset


@dataclass(frozen=True, slots=True)
class Path:
    """A bounded path: knots joined by cubic Hermite segments, first at t = 0 with offset 0, last at rest."""

    knots: tuple[Knot, ...]

    @property
    def duration_s(self) -> float:
        """Time from the first knot to the last."""
        return self.knots[-1].t_s


class OrderState(Enum):
    """How far an order has come."""

    PENDING = "pending"
    FLYING = "flying"
    DONE = "done"
    REFUSED = "refused"
    ENDED = "ended"
    """Stopped before it was done: pilot, failsafe, abort or a lost link; see the reason."""


class Order(Protocol):
    """A watched order; every state but PENDING and FLYING is final."""

    @property
    def kind(self) -> str:
        """take-off, hover, turn, path, hold or land."""
        ...

    @property
    def state(self) -> OrderState:
        """How far it has come."""
        ...

    @property
    def reason(self) -> str:
        """Why it was refused or ended, in words for the operator."""
        ...

    @property
    def started_s(self) -> float | None:
        """Program time at which it began to be flown."""
        ...

    @property
    def ended_s(self) -> float | None:
        """Program time at which it became final."""
        ...


EventKind = Literal[
    "mode",  # the flight mode changed as ordered
    "pilot",  # somebody else took the aircraft: a mode change or override that we did not order
    "failsafe",  # the autopilot's own failsafe, or low battery
    "deadman",  # the pilot process stopped the aircraft because we were silent
    "link-lost",
    "link-back",
    "slow-link",
    "gimbal-lost",  # the camera is on a gimbal, and that tells its attitude no more
    "pilot-process-lost",
    "refused",
    "caution",  # what the operator may not expect: of the autopilot before a flight, of others on the link in it
    "statustext",
]


@dataclass(frozen=True, slots=True)
class DroneEvent:
    """Something that the pilot, the failsafes or the link did."""

    t_s: float
    kind: EventKind
    text: str


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What this aircraft can do."""

    position_setpoints: bool
    global_position: bool
    """Whether answers can be given in latitude and longitude."""
    max_speed_m_s: float


@dataclass(frozen=True, slots=True)
class Telemetry:
    """The newest of what the aircraft reports; None where it has not yet."""

    t_s: float
    connected: bool
    armed: bool
    in_air: bool
    mode: str
    battery_fraction: float | None
    height_m: float | None
    """Above home (or above the take-off point)."""
    heading_rad: float | None
    """Clockwise from true north."""
    position_ok: bool
    heading_ok: bool
    pose_rate_hz: float
    """Rate at which positions and attitudes arrive (the smaller one)."""
    geoid_separation_m: float | None = None
    """Ellipsoid height minus AMSL height, where the aircraft tells both."""
    packet_loss: float | None = None
    """Fraction of the aircraft's packets that do not arrive, over the last seconds; None where that is not known."""
    gimbal: str = ""
    """What tells that the aircraft carries a gimbal; empty where nothing does."""
    gimbal_trouble: str = ""
    """Of a camera that is told to be on the gimbal: why its attitude is not known; empty where it is."""
    gimbal_doubt: str = ""
    """Of the same: why its attitude is only believed when the pictures confirm it; empty where it is measured."""


class CameraPointer(Protocol):
    """What points a camera that is on a gimbal (`mission.gimbal.control.GimbalControl`)."""

    @property
    def ours(self) -> bool:
        """Whether we point it."""
        ...

    @property
    def lost(self) -> str:
        """Who took it from us, in words for the operator; empty while nobody did."""
        ...

    def take(self) -> str:
        """Ask for control and wait for the answer: why we cannot point it, empty when we can."""
        ...

    def point(self, azimuth_rad: float, elevation_rad: float) -> None:
        """Look there: clockwise from north, up."""
        ...

    def release(self) -> None:
        """Give control back."""
        ...


class Drone(Protocol):
    """One aircraft. Every method may be called from one thread; none raises for what the link sends.

    Work in another thread gets what it needs handed in (`poses`, `origin`, `noise`) and does not call the drone.
    """

    @property
    def name(self) -> str:
        """What the operator calls it: autopilot and system id, or the AR.Drone's address."""
        ...

    @property
    def capabilities(self) -> Capabilities:
        """What it can do; known after `connect`."""
        ...

    @property
    def gimbal(self) -> CameraPointer | None:
        """What points the camera; None where that is fixed to the airframe."""
        ...

    @property
    def origin(self) -> GeodeticOrigin | None:
        """Origin of the local frame, fixed at the first healthy position; None without a global position."""
        ...

    def connect(self, timeout_s: float) -> None:
        """Open the link, wait for a healthy heartbeat and for the pose rates.

        Raises:
            LinkError: no heartbeat or no pose at the wanted rate within the time.
        """
        ...

    def close(self) -> None:
        """Give control back (hold) if it is ours, and close the link. Safe to call twice."""
        ...

    def keep_alive(self) -> None:
        """Say that the program's own loop is alive; `telemetry`, `events` and every order do so, too.

        While it is flown by us the aircraft is stopped after 0.5 s without any of them: call at 10 Hz or more, from the
        loop whose hanging must stop the aircraft. Only the thread that called `begin` is that loop; from any other
        thread this does nothing, since another thread would outlive a loop that hangs.
        """
        ...

    def telemetry(self) -> Telemetry:
        """The newest report."""
        ...

    def pose_at(self, t_s: float) -> Pose | None:
        """Pose at a program time, interpolated; None across gaps of more than 0.3 s or beyond the newest message."""
        ...

    def poses(self) -> PoseAt:
        """`pose_at` as of now, for work in other threads: a snapshot that later messages do not change."""
        ...

    def noise(self) -> NoiseModel:
        """How good this aircraft's reported pose is (the pose fields of the noise model)."""
        ...

    def pose_note(self) -> str:
        """What was wrong with the poses of the last `poses` and was put right; empty where nothing was."""
        ...

    def begin(self, bounds: Bounds) -> None:
        """A new order by the operator: from here the flight is bounded by `bounds`, and control may be taken once.

        Without it no other order flies; after the pilot took over it is needed again.

        Raises:
            LinkError: not connected.
        """
        ...

    def take_off(self, height_m: float) -> Order:
        """Arm and climb to a height above home."""
        ...

    def hover(self) -> Order:
        """Take control and stay at this place and heading; DONE when it stands still under our control."""
        ...

    def turn_to(self, heading_rad: float) -> Order:
        """Turn on the spot; DONE when the heading is reached."""
        ...

    def fly(self, path: Path) -> Order:
        """Fly a path from here, at the heading of the latest `aim`; DONE at its end, at rest."""
        ...

    def aim(self, heading_rad: float) -> None:
        """The heading to keep from now on, while hovering or flying a path; call it as often as it changes."""
        ...

    def hold(self) -> Order:
        """Stop and give control back to the autopilot's own hold mode."""
        ...

    def land(self) -> Order:
        """Land here."""
        ...

    def events(self) -> list[DroneEvent]:
        """What happened since the last call, oldest first."""
        ...
