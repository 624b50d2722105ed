"""The one record that flows: Frame -> Detection -> Sighting -> Estimate (-> Geotag, in `gcs_plugin.geotags.log`).

Units are in the field names. Frames of reference:

- world: local ENU (east, north, up), metres, around `GeodeticOrigin`.
- body: forward, right, down.
- camera: x right, y down, z out of the lens.

Rotations are named ``world_from_body`` and so on, as unit quaternions (w, x, y, z), so that they chain by reading.
Times are seconds of the program's monotonic clock (`time.monotonic`) unless a field says otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""A float array; its shape is stated where it is used."""
Matrix = NDArray[np.float64]
"""A two-dimensional float array; its shape is stated where it is used."""
Image = NDArray[np.uint8]
"""BGR picture, shape (height, width, 3)."""

ClassHeight = Literal["use", "compare", "never"]
"""What the usual height of the target's class is for."""
Datum = Literal["ellipsoid", "amsl", "home"]
"""What an altitude is measured from: the WGS 84 ellipsoid, mean sea level, or the home position."""


@dataclass(frozen=True, slots=True)
class GeodeticOrigin:
    """Where east = north = up = 0, WGS 84."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    datum: Datum = "ellipsoid"


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One picture of the video and the time at which the middle of its exposure was taken."""

    image: Image
    t_s: float
    index: int


@dataclass(frozen=True, slots=True)
class Box:
    """An upright rectangle in an image, pixels; (0, 0) is the outer corner of the top left pixel."""

    left_px: float
    top_px: float
    width_px: float
    height_px: float

    @property
    def centre_px(self) -> tuple[float, float]:
        """Middle of the box (x, y)."""
        return self.left_px + self.width_px / 2.0, self.top_px + self.height_px / 2.0

    @property
    def right_px(self) -> float:
        """The right side's x."""
        return self.left_px + self.width_px

    @property
    def bottom_px(self) -> float:
        """The lower side's y."""
        return self.top_px + self.height_px

    def contains(self, x_px: float, y_px: float) -> bool:
        """Whether the point lies inside."""
        return self.left_px <= x_px <= self.right_px and self.top_px <= y_px <= self.bottom_px

    def overlap(self, other: Box) -> float:
        """Intersection over union, 0 to 1."""
        w = min(self.right_px, other.right_px) - max(self.left_px, other.left_px)
        h = min(self.bottom_px, other.bottom_px) - max(self.top_px, other.top_px)
        if w <= 0.0 or h <= 0.0:
            return 0.0
        inter = w * h
        return inter / (self.width_px * self.height_px + other.width_px * other.height_px - inter)


@dataclass(frozen=True, slots=True)
class Detection:
    """A person found in a frame."""

    box: Box
    score: float


@dataclass(frozen=True, slots=True)
class CameraIntrinsics:
    """Pinhole with OpenCV's distortion; pixels, (0, 0) = outer corner of the top left pixel.

    (OpenCV's own functions put (0, 0) at the centre of the top left pixel: cx and cy here are larger by 0.5.)
    """

    width_px: int
    height_px: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3."""


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """The noise of a flight's sightings (sightings-format, field for field; defaults are the documented ones)."""

    pixel_sigma_px: float = 1.5
    pixel_correlation_s: float = 0.3
    size_sigma: float = 0.04
    size_correlation_s: float = 0.3
    position_sigma_m: float = 0.02
    position_walk_m_per_sqrt_s: float = 0.03
    heading_bias_sigma_rad: float = 0.035
    tilt_bias_sigma_rad: float = 0.009
    heading_sigma_rad: float = 0.004
    heading_correlation_s: float = 2.0
    tilt_sigma_rad: float = 0.003
    tilt_correlation_s: float = 2.0
    position_scale_sigma: float = 0.0
    """Relative: the whole reported path may be too long or too short by this, and everything seen from it with it."""
    world_heading_sigma_rad: float = 0.0
    """Path and attitudes may be turned together about the vertical by this, and everything seen with them."""
    world_tilt_sigma_rad: float = 0.0
    """The same about each horizontal axis."""


@dataclass(frozen=True, slots=True)
class TargetPrior:
    """What is known of the target before it is seen (sightings-format)."""

    speed_sigma_m_s: float = 1.0
    vertical_speed_sigma_m_s: float = 0.05
    acceleration_psd_m2_s3: float = 0.0
    ground_up_m: float | None = None
    """Where it was measured, with its sigma: up coordinate of the ground under the target at the first sighting."""
    ground_sigma_m: float | None = None
    centre_above_ground_m: float = 0.85
    """Of the point that is sighted, the target's centre; used with `ground_up_m` only."""
    height_m: float | None = None
    """Where it is known, with its sigma: the target's true height."""
    height_sigma_m: float | None = None
    class_height: ClassHeight = "never"
    """Of a detected person: whether an adult's height counts as a measurement, with children and others as
    alternatives; "compare" says in the answer's notes what it would be with it."""


@dataclass(frozen=True, slots=True)
class Sighting:
    """The target seen once: where the camera was, and where and how tall the target is in the image."""

    t_s: float
    position_enu_m: tuple[float, float, float]
    world_from_camera_wxyz: tuple[float, float, float, float]
    pixel: tuple[float, float]
    """Centre of the target in the distorted image, pixels, (0, 0) = outer corner of the top left pixel."""
    height_px: float | None = None
    pixel_sigma_px: float | None = None
    size_sigma: float | None = None


@dataclass(frozen=True, slots=True)
class FlightSightings:
    """One flight's worth of sightings with all that decides an estimate: a replay gives the same answer."""

    id: str
    origin: GeodeticOrigin
    camera: CameraIntrinsics
    sightings: tuple[Sighting, ...]
    noise: NoiseModel = field(default_factory=NoiseModel)
    prior: TargetPrior = field(default_factory=TargetPrior)
    continues: str | None = None
    """Id of the flight before it past the same target, in the same frame and on the same clock."""


@dataclass(frozen=True, slots=True, eq=False)
class FirstPosition:
    """The target's position at the first sighting."""

    t_s: float
    position_enu_m: Vector
    covariance: Matrix
    """3 x 3, m2."""


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Where the target is and how it moves at `t_s` (the last sighting), with its covariance."""

    id: str
    method: str
    model: str
    t_s: float
    position_enu_m: Vector
    velocity_enu_m_s: Vector | None
    covariance: Matrix | None
    """6 x 6, position then velocity, m and m/s; None only for closed forms, which have none."""
    first: FirstPosition | None
    depth_m: float
    """Horizontal distance from the first camera position to the target at the first sighting."""
    sightings: int
    rejected: int
    chi2: float | None
    dof: int | None
    notes: tuple[str, ...] = ()
    """What the operator should know: assumptions made, poor geometry, which motion model the data support."""
