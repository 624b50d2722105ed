"""Scenarios: what is flown, what is seen and in which light, read from a TOML file.

::

    name = "demo"                    # letters, digits, - and _
    seed = 1                         # scenery, clothes, noise: the same seed gives the same flight
    scenery = true                   # houses, trees and street furniture around

    [home]                           # the take-off point; the local frame (ENU) starts here, on the ground
    lat_deg = 47.397742
    lon_deg = 8.545594
    alt_m = 488.0                    # above mean sea level

    [autopilot]
    flavour = "px4"                  # px4 | ardupilot
    noise = "good"                   # good | rough | wide (drawn by the seed): how well it knows its pose
    wind_m_s = 1.0                   # mean wind, the way it blows FROM, and the standard deviation of the gusts
    wind_from_deg = 250.0
    gust_m_s = 0.3

    [vehicle]
    kind = "mavlink"                 # mavlink | ardrone
    heading_deg = 20.0               # at the start, clockwise from true north
    take_off_height_m = 1.6

    [ardrone]                        # only of kind = "ardrone"; [autopilot] still gives noise and wind
    gps = false                      # the GPS edition's receiver is plugged in
    declination_deg = 0.0            # of magnetic north, clockwise from true north
    video = "720p"                   # 360p | 720p: the live stream's lines, which [camera]'s picture is scaled to
    scaled_to_px = [640, 480]        # what the mission scales the stream's pictures to
    wifi = { loss = 0.0, duplicate = 0.0, reorder = 0.0 }   # shares of the commands and of the navdata

    [gimbal]                         # optional: carries the camera, whose tilt_down_deg then means nothing
    kind = "stabilised"              # stabilised | servo
    tells = "nose"                   # yaw: nose (flag 32) | north (64) | nose-delta (32, delta_yaw) | older (none)
    rate_hz = 20.0
    age_ms = 50.0
    yaw_bias_deg = 3.0               # left out: drawn from N(0, 5) by the seed
    start_pitch_deg = -20.0

    [camera]
    width_px = 640
    height_px = 480
    horizontal_fov_deg = 63.56       # either this ...
    # fx = 516.5                     # ... or these four, pixels; (0, 0) is the outer corner of the top left pixel
    # fy = 516.5
    # cx = 320.0
    # cy = 240.0
    distortion = { k1 = -0.05, k2 = 0.01, p1 = 0.0, p2 = 0.0, k3 = 0.0 }   # OpenCV's
    tilt_down_deg = 5.0              # from the body's forward axis
    position_body_m = [0.10, 0.0, 0.03]   # of the lens: forward, right, down of the centre of gravity
    fps = 20.0
    exposure_ms = 8.0
    readout_ms = 16.0                # from the first to the last row; 0 is a global shutter
    renderings = 2                   # per picture, spread over the exposure: 1 (no motion blur, cheapest), 2 or 4
    noise_grey = 2.5                 # standard deviation of the sensor's noise, grey levels of 255
    exposure_wander = 0.06           # slow drift of the automatic exposure, relative
    bitrate_kbit_s = 4000
    extra_latency_ms = 80.0          # added to what encoding really takes

    [light]
    brightness = 1.0                 # 0.2 (dusk) to 1.5
    sun_azimuth_deg = 220.0          # where the sun stands, clockwise from north
    sun_elevation_deg = 40.0

    [[people]]
    distance_m = 5.5                 # from the drone's start, over the ground
    bearing_deg = 24.0               # from the drone's start, clockwise from true north
    speed_m_s = 0.6                  # 0: stands (and sways a little)
    walk_from_line_of_sight_deg = 135.0   # 0 = away from the drone, 90 = to the right as it sees it, 180 = towards it
    # walk_heading_deg = 90.0        # instead: clockwise from true north. People who stand face this way
    at = "start"                     # walks from the first frame on
    # when = "drone-turns"           # instead: from when the drone, in the air, first turns (mark 0 of the truth)
    # when = "drone-moves"           # instead: from when it flies sideways; all who wait wait for the same
    stop_after_s = 30.0              # optional, after the walk began
    turns = [{ after_s = 4.0, by_deg = -90.0 }]   # optional, clockwise, after the walk began
    # walks = "real-like"            # instead of speed, stop and turns: as people walk (real-like, calm, turns, ...)
    # walk_seed = 1                  # which such walk
    height_m = 1.75                  # 1.5 to 1.95
    build = 1.0                      # breadth and depth of the body for its height, 0.8 to 1.3
    stride = 1.0                     # length of the steps for the speed, 0.8 to 1.25: longer ones are fewer
    clothes = { shirt = "#b02a30", trousers = "#27324f", hair = "#2b211a", skin = "#c08a66" }   # any may be left out

    [[obstacles]]
    kind = "wall"                    # wall | hedge | tree
    distance_m = 4.0                 # of its middle, from the drone's start
    bearing_deg = 30.0
    width_m = 1.5                    # a tree's is that of its trunk
    height_m = 2.2
    turn_deg = 0.0                   # 0 stands square to the line of sight

    [marker_wall]                    # ArUco markers 0, 1, 2, ... of DICT_4X4_50, for `sidestep calibrate baseline`
    distance_m = 4.0
    bearing_deg = 30.0
    markers = 18
    marker_m = 0.4                   # side of one
    spacing_m = 0.8
    left_m = 11.0                    # marker 0, from the point straight ahead
    middle_m = 1.0                   # above the ground

Everything but `name` and the people's `distance_m` and `bearing_deg` has a default.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, ValidationError, model_validator

from mission.errors import SettingsError
from mission.records import CameraIntrinsics, GeodeticOrigin
from sitl.autopilot.gimbal_settings import GimbalSettings
from sitl.scenario.scene import Light, MarkerWall, Obstacle, Person
from sitl.scenario.table import Degrees, Table


class Home(Table):
    """The take-off point."""

    lat_deg: float = Field(default=47.397742, ge=-89.0, le=89.0)
    lon_deg: float = Field(default=8.545594, ge=-180.0, le=180.0)
    alt_m: float = Field(default=488.0, ge=-500.0, le=9000.0)
    """Above mean sea level."""

    @property
    def origin(self) -> GeodeticOrigin:
        """The origin of the local frame."""
        return GeodeticOrigin(self.lat_deg, self.lon_deg, self.alt_m, "amsl")


class Autopilot(Table):
    """Which autopilot flies, how well it knows where it is, and the wind."""

    flavour: Literal["px4", "ardupilot"] = "px4"
    noise: Literal["good", "rough", "wide"] = "good"
    wind_m_s: float = Field(default=0.0, ge=0.0, le=15.0)
    wind_from_deg: Degrees = 270.0
    gust_m_s: float = Field(default=0.0, ge=0.0, le=5.0)


class Vehicle(Table):
    """What flies, and how the flight starts."""

    kind: Literal["mavlink", "ardrone"] = "mavlink"
    heading_deg: Degrees = 0.0
    take_off_height_m: float = Field(default=1.6, ge=0.8, le=60.0)


class Wifi(Table):
    """Faults of the radio link: shares of its datagrams, both ways."""

    loss: float = Field(default=0.0, ge=0.0, le=1.0)
    duplicate: float = Field(default=0.0, ge=0.0, le=1.0)
    reorder: float = Field(default=0.0, ge=0.0, le=1.0)


class Ardrone(Table):
    """What only an AR.Drone has."""

    gps: bool = False
    declination_deg: Degrees = 0.0
    video: Literal["360p", "720p"] = "720p"
    scaled_to_px: tuple[int, int] = (640, 480)
    wifi: Wifi = Wifi()


class Distortion(Table):
    """OpenCV's lens distortion."""

    k1: float = Field(default=0.0, ge=-0.6, le=0.6)
    k2: float = Field(default=0.0, ge=-0.6, le=0.6)
    p1: float = Field(default=0.0, ge=-0.05, le=0.05)
    p2: float = Field(default=0.0, ge=-0.05, le=0.05)
    k3: float = Field(default=0.0, ge=-0.6, le=0.6)


class CameraSettings(Table):
    """The camera and the way its pictures travel."""

    width_px: int = Field(default=640, ge=160, le=1920, multiple_of=2)
    height_px: int = Field(default=480, ge=120, le=1080, multiple_of=2)
    horizontal_fov_deg: float | None = Field(default=None, ge=20.0, le=110.0)
    fx: float | None = Field(default=None, gt=50.0, le=5000.0)
    fy: float | None = Field(default=None, gt=50.0, le=5000.0)
    cx: float | None = Field(default=None, ge=0.0, le=1920.0)
    cy: float | None = Field(default=None, ge=0.0, le=1080.0)
    distortion: Distortion = Distortion()
    tilt_down_deg: float = Field(default=0.0, ge=-30.0, le=90.0)
    position_body_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fps: float = Field(default=20.0, ge=1.0, le=60.0)
    exposure_ms: float = Field(default=6.0, ge=0.0, le=40.0)
    readout_ms: float = Field(default=0.0, ge=0.0, le=60.0)
    renderings: Literal[1, 2, 4] = 2
    noise_grey: float = Field(default=2.5, ge=0.0, le=30.0)
    exposure_wander: float = Field(default=0.05, ge=0.0, le=0.4)
    bitrate_kbit_s: int = Field(default=4000, ge=100, le=50000)
    extra_latency_ms: float = Field(default=0.0, ge=0.0, le=2000.0)

    @model_validator(mode="after")
    def _one_focal_length(self) -> Self:
        given = [name for name in ("fx", "fy", "cx", "cy") if getattr(self, name) is not None]
        if given and len(given) < 4:
            raise ValueError(f"give all of fx, fy, cx and cy (only {', '.join(given)} found)")
        if given and self.horizontal_fov_deg is not None:
            raise ValueError("give either horizontal_fov_deg or fx, fy, cx and cy, not both")
        return self

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """Pinhole and distortion, pixels from the outer corner of the top left pixel."""
        d = self.distortion
        focal = self.width_px / 2.0 / math.tan(math.radians(self.horizontal_fov_deg or 63.56) / 2.0)
        return CameraIntrinsics(
            width_px=self.width_px,
            height_px=self.height_px,
            fx=focal if self.fx is None else self.fx,
            fy=focal if self.fy is None else self.fy,
            cx=self.width_px / 2.0 if self.cx is None else self.cx,
            cy=self.height_px / 2.0 if self.cy is None else self.cy,
            distortion=(d.k1, d.k2, d.p1, d.p2, d.k3),
        )


class Scenario(Table):
    """A whole scenario."""

    name: str = Field(pattern=r"^[A-Za-z0-9_-]{1,60}$")
    seed: int = Field(default=1, ge=0, le=2**31)
    scenery: bool = True
    home: Home = Home()
    autopilot: Autopilot = Autopilot()
    vehicle: Vehicle = Vehicle()
    ardrone: Ardrone = Ardrone()
    camera: CameraSettings = CameraSettings()
    gimbal: GimbalSettings | None = None
    light: Light = Light()
    people: tuple[Person, ...] = Field(default=(), max_length=8)
    obstacles: tuple[Obstacle, ...] = Field(default=(), max_length=20)
    marker_wall: MarkerWall | None = None

    @model_validator(mode="after")
    def _one_signal_and_known_noise(self) -> Self:
        if len({person.when for person in self.people if person.when is not None}) > 1:
            raise ValueError("all people who wait for the drone must wait for the same, drone-moves or drone-turns")
        if self.vehicle.kind == "ardrone" and self.autopilot.noise == "wide":
            raise ValueError('noise = "wide" is of MAVLink autopilots; an AR.Drone has good or rough')
        return self

    @property
    def walks_on_turn(self) -> bool:
        """Whether those who wait walk as soon as the drone turns."""
        return any(person.when == "drone-turns" for person in self.people)


def parse_scenario(text: str, source: str = "scenario") -> Scenario:
    """Read a scenario from the text of a TOML file.

    Raises:
        SettingsError: it is not TOML, a key is unknown or missing, or a value is out of its range; names all faults.
    """
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SettingsError(f"{source} is not a TOML file: {error}", "correct the line named") from error
    return check_scenario(content, source)


def check_scenario(content: Mapping[str, object], source: str) -> Scenario:
    """A scenario from the decoded file.

    Raises:
        SettingsError: a key is unknown or missing, or a value is out of its range; names all faults.
    """
    try:
        return Scenario.model_validate(content)
    except ValidationError as error:
        faults = [
            f"{'.'.join(str(part) for part in fault['loc']) or 'file'}: {fault['msg']}" for fault in error.errors()
        ]
        raise SettingsError(f"{source}: {'; '.join(faults)}", "see the schema in sitl/scenario/schema.py") from error


def read_scenario(path: Path) -> Scenario:
    """Read a scenario's file.

    Raises:
        SettingsError: the file cannot be read, or does not follow the schema.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SettingsError(f"cannot read the scenario {path}: {error}", "name an existing TOML file") from error
    return parse_scenario(text, path.name)
