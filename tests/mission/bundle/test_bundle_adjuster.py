"""From pictures to steadied poses, and honestly back to the telemetry where the pictures do not help."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mission.bundle import BundleAdjuster, BundleSolution
from mission.bundle.bundle_adjuster import _key_frames
from mission.bundle.pose_covariance import drawn_by_movers
from mission.camera import Camera
from mission.camera.mounting import Mounting
from mission.pose.buffer import Pose
from mission.procedure.flight_record import FlightRecord
from mission.records import Box, Detection, Frame, GeodeticOrigin, Image, Matrix, NoiseModel, TargetPrior, Vector
from mission.track import Track
from tests.support.bundle_worlds import ROUGH

CAMERA = Camera.from_field_of_view(640, 480, 1.1, Mounting.tilted(0.0))
WALL_M, PX_PER_M = 9.0, 40.0
DURATION_S, FPS, OFFSET_S = 4.0, 12.0, 0.1
GROUND_M = 1.6


def true_pose(t_s: float) -> Pose:
    """Two metres west and back before a wall to the north, level but for some roll, turning a little."""
    way = 0.5 * (1.0 - np.cos(2.0 * np.pi * t_s / DURATION_S))
    rate = np.pi / DURATION_S * np.sin(2.0 * np.pi * t_s / DURATION_S)
    attitude = Rotation.from_rotvec([0.0, 0.0, -0.15 * way]) * _NORTH * Rotation.from_rotvec([0.08 * np.sin(t_s), 0, 0])
    return _pose(t_s, np.array([-2.0 * way, 0.0, GROUND_M]), np.array([-2.0 * rate, 0.0, 0.0]), attitude)


def reported_pose(t_s: float) -> Pose:
    """The same with a compass that swings by two degrees and a position that drifts."""
    true = true_pose(t_s)
    swing = Rotation.from_rotvec([0.004 * np.sin(t_s), 0.008 * np.sin(0.7 * t_s), 0.035 * np.sin(1.1 * t_s + 0.5)])
    attitude = swing * Rotation.from_quat(true.world_from_body_wxyz, scalar_first=True)
    drift = np.array([0.1 * np.sin(0.9 * t_s), 0.08 * np.cos(t_s), 0.05 * np.sin(1.2 * t_s)])
    return _pose(t_s, true.position_enu_m + drift, true.velocity_enu_m_s, attitude)


_NORTH = Rotation.from_matrix(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]))


def _pose(t_s: float, position: Vector, velocity: Vector, attitude: Rotation) -> Pose:
    return Pose(t_s, position, velocity, attitude.as_quat(scalar_first=True), np.eye(3), np.eye(3))


def picture(t_s: float, texture: Image) -> Image:
    """What the camera sees of a textured ground and a textured wall."""
    pose = true_pose(t_s)
    rotation = CAMERA.mounting.world_from_camera_wxyz(pose)
    camera_from_world = Rotation.from_quat(rotation, scalar_first=True).inv().as_matrix()
    lens = CAMERA.intrinsics
    matrix = np.array([[lens.fx, 0, lens.cx - 0.5], [0, lens.fy, lens.cy - 0.5], [0, 0, 1.0]])
    height, width = texture.shape[:2]
    seen = np.full((480, 640, 3), 200, np.uint8)
    # Texture pixel (u, v) to a place: on the wall (u, WALL, top - v), on the ground (u, v, 0).
    wall = _plane([1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [-0.5 * width / PX_PER_M, WALL_M, 0.9 * height / PX_PER_M])
    ground = _plane([1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [-0.5 * width / PX_PER_M, WALL_M, 0.0])
    for plane, patch in ((wall, texture), (ground, texture[: int((WALL_M - 1.0) * PX_PER_M), ::-1])):
        homography = matrix @ camera_from_world @ (plane - np.outer(pose.position_enu_m, [0.0, 0.0, 1.0]))
        drawn = cv2.warpPerspective(patch, homography, (640, 480), flags=cv2.INTER_AREA)
        inside = cv2.warpPerspective(np.full(patch.shape[:2], 255, np.uint8), homography, (640, 480)) > 128
        seen[inside] = drawn[inside]
    return seen


def _plane(u: list[float], v: list[float], origin: list[float]) -> Matrix:
    return np.stack([np.array(u) / PX_PER_M, np.array(v) / PX_PER_M, np.array(origin)], axis=1)


@lru_cache(maxsize=1)
def street_pictures() -> tuple[Frame, ...]:
    """The flight's frames; their times are late by the video's offset."""
    rng = np.random.default_rng(0)
    noise = cv2.GaussianBlur(rng.uniform(0.0, 255.0, (400, 1200)).astype(np.float32), (0, 0), 2.5)
    grey = np.clip(128.0 + 3.5 * (noise - noise.mean()), 0.0, 255.0).astype(np.uint8)
    texture: Image = np.repeat(grey[:, :, None], 3, axis=2)
    times = np.arange(round(DURATION_S * FPS)) / FPS
    return tuple(Frame(picture(float(t), texture), float(t) + OFFSET_S, k) for k, t in enumerate(times))


def steadied(
    frames: tuple[Frame, ...], pose_at: Callable[[float], Pose | None] = reported_pose, noise: NoiseModel = ROUGH
) -> BundleSolution:
    """The answer for some frames."""
    steadier = BundleAdjuster(CAMERA)
    for frame in frames:
        steadier.add(frame, (Box(300.0, 150.0, 40.0, 120.0),))
    return steadier.solve(pose_at, OFFSET_S, noise)


def test_a_swinging_compass_is_steadied_by_the_street() -> None:
    found = steadied(street_pictures())
    assert found.reason is None
    assert len(found.poses) == len(street_pictures())
    assert all(pose.source == "steadied" and pose.points >= 12 for pose in found.poses)
    before, after = [], []
    for pose in found.poses:
        true = Rotation.from_quat(
            CAMERA.mounting.world_from_camera_wxyz(true_pose(pose.t_s - OFFSET_S)), scalar_first=True
        )
        told = CAMERA.mounting.world_from_camera_wxyz(reported_pose(pose.t_s - OFFSET_S))
        before.append((Rotation.from_quat(told, scalar_first=True) * true.inv()).as_rotvec())
        after.append((Rotation.from_matrix(pose.world_from_camera) * true.inv()).as_rotvec())
    wandered, left = (np.degrees(np.std(e, axis=0)) for e in (before, after))
    assert wandered[2] > 1.0
    assert left.max() < 0.1
    assert found.noise.heading_sigma_rad < 0.1 * ROUGH.heading_sigma_rad
    assert 0.0 < found.noise.position_scale_sigma < 0.15
    assert "steadied by the background" in found.note()


def test_the_path_gets_its_shape_from_the_pictures() -> None:
    found = steadied(street_pictures())
    path = np.array([pose.position_enu_m for pose in found.poses])
    true = np.array([true_pose(pose.t_s - OFFSET_S).position_enu_m for pose in found.poses])
    told = np.array([reported_pose(pose.t_s - OFFSET_S).position_enu_m for pose in found.poses])
    left, before = (p - p.mean(axis=0) - (true - true.mean(axis=0)) for p in (path, told))
    assert np.sqrt(np.mean(left**2)) < 0.6 * np.sqrt(np.mean(before**2))


def test_curves_and_trails_are_there_for_people() -> None:
    found = steadied(street_pictures())
    assert found.curves is not None
    assert found.trails is not None
    swing = found.curves.reported_rad[:, 0] - found.curves.steadied_rad[:, 0]
    assert np.degrees(np.ptp(swing)) > 2.0
    assert len(found.trails.pixel) == len(found.trails.still) == len(found.trails.t_s) > 500
    assert found.trails.still.mean() > 0.8


@pytest.mark.parametrize("grey", [5, 200])
def test_without_texture_it_says_so_and_changes_nothing(grey: int) -> None:
    rng = np.random.default_rng(1)
    frames = tuple(
        Frame(np.clip(grey + rng.normal(0.0, 2.0, (480, 640, 3)), 0, 255).astype(np.uint8), k / FPS, k)
        for k in range(24)
    )
    found = steadied(frames)
    assert found.reason is not None
    assert found.poses == ()
    assert found.noise == ROUGH
    assert "not steadied" in found.note()


def test_without_telemetry_it_says_so() -> None:
    found = steadied(street_pictures(), lambda _: None)
    assert found.reason == "too few frames with telemetry"


def crowded(frames: tuple[Frame, ...], share: float) -> tuple[Frame, ...]:
    """The same pictures with a textured crowd before their left part, which goes its own way."""
    rng = np.random.default_rng(11)
    cells = rng.integers(0, 255, (70, 110), dtype=np.uint8)
    crowd = cv2.cvtColor(cv2.resize(cells, None, fx=10, fy=10, interpolation=cv2.INTER_CUBIC), cv2.COLOR_GRAY2BGR)
    width = round(640 * share)
    found = []
    for frame in frames:
        right, down = (120.0 + 90.0 * np.array([np.sin(1.7 * frame.t_s), np.cos(1.3 * frame.t_s)])).tolist()
        image = frame.image.copy()
        image[:, :width] = cv2.getRectSubPix(crowd, (width, 480), (right + 0.5 * width, down + 240.0))
        found.append(Frame(image, frame.t_s, frame.index))
    return tuple(found)


def test_the_more_moves_the_less_is_promised_of_the_attitude() -> None:
    alone, among = steadied(street_pictures()), steadied(crowded(street_pictures(), 0.36))
    assert alone.reason is None
    assert among.reason is None
    assert alone.still_share > 0.65 > among.still_share
    drawn = drawn_by_movers(among.still_share)
    assert among.noise.heading_sigma_rad > drawn * ROUGH.heading_sigma_rad > 2.0 * alone.noise.heading_sigma_rad
    assert among.noise.tilt_sigma_rad > drawn * ROUGH.tilt_sigma_rad
    assert among.noise.heading_bias_sigma_rad > among.noise.heading_sigma_rad


@pytest.mark.parametrize(("still", "drawn"), [(1.0, 0.0), (0.65, 0.0), (0.525, 0.5), (0.4, 1.0), (0.0, 1.0)])
def test_what_moves_may_draw_the_attitude_as_far_as_the_telemetry_lets_it(still: float, drawn: float) -> None:
    assert drawn_by_movers(still) == pytest.approx(drawn)


def test_pictures_of_different_places_do_not_make_a_path() -> None:
    rng = np.random.default_rng(2)
    frames = tuple(
        Frame(
            np.asarray(cv2.GaussianBlur(rng.integers(0, 255, (480, 640, 3), dtype=np.uint8), (0, 0), 3.0), np.uint8),
            k / FPS,
            k,
        )
        for k in range(20)
    )
    assert steadied(frames).reason is not None


@dataclass
class Finder:
    """Finds people where it is told."""

    boxes: tuple[Box, ...]
    asked: int = 0
    name: str = "told"

    def detect(self, image: Image, region: Box | None = None) -> list[Detection]:
        self.asked += 1
        return [Detection(box, 1.0) for box in self.boxes]


def recorded(frames: tuple[Frame, ...]) -> FlightRecord:
    record = FlightRecord("x", CAMERA, 0.3)
    for frame in frames:
        box = Box(300.0, 150.0, 40.0, 120.0)
        record.add(frame, Track(frame.index, frame.t_s, "tracking", box, box.centre_px, 1.0, 120.0, 0.04, 1.0))
    return record


def test_people_are_left_out_where_much_of_the_picture_moves() -> None:
    finder = Finder((Box(0.0, 0.0, 0.36 * 640.0, 480.0),))
    record = recorded(crowded(street_pictures(), 0.36))
    before = record.steadier.solve(reported_pose, OFFSET_S, ROUGH)
    found = record.steadied(reported_pose, OFFSET_S, ROUGH, lambda: finder)
    assert finder.asked == len(record.key_frames) > 5
    assert found.reason is None
    assert found.still_share > 0.65 > before.still_share
    assert found.noise.heading_sigma_rad < 0.5 * before.noise.heading_sigma_rad
    assert found.trails is not None
    assert np.mean(found.trails.pixel[:, 0] < 0.36 * 640.0) < 0.02, "points there have no part in it"


def test_nobody_is_looked_for_where_the_world_stands_still_or_shows_nothing() -> None:
    finder = Finder(())
    assert recorded(street_pictures()).steadied(reported_pose, OFFSET_S, ROUGH, lambda: finder).reason is None
    bare = tuple(Frame(np.full((480, 640, 3), 120, np.uint8), k / FPS, k) for k in range(20))
    assert recorded(bare).steadied(reported_pose, OFFSET_S, ROUGH, lambda: finder).reason is not None
    assert finder.asked == 0


def test_sightings_are_taken_from_the_steadied_poses() -> None:
    record = recorded(street_pictures())
    found = record.steadier.solve(reported_pose, OFFSET_S, ROUGH)
    args = (GeodeticOrigin(0.0, 0.0, 0.0), reported_pose, OFFSET_S, ROUGH, TargetPrior())
    plain, steady = record.sightings(*args), record.sightings(*args, found)
    assert [s.t_s for s in plain.sightings] == [s.t_s for s in steady.sightings]
    for sighting, pose in zip(steady.sightings, found.poses, strict=True):
        np.testing.assert_allclose(sighting.position_enu_m, pose.position_enu_m)
    assert steady.noise.heading_sigma_rad == found.noise.heading_sigma_rad
    assert steady.noise.position_scale_sigma > 0.0
    assert plain.noise.heading_sigma_rad == ROUGH.heading_sigma_rad


@pytest.mark.parametrize(("frames", "keys"), [(121, 30), (37, 10), (20, 8), (5, 5)])
def test_key_frames_are_a_fifth_of_a_second_apart_and_span_the_flight(frames: int, keys: int) -> None:
    chosen = _key_frames(np.arange(frames) / 20.0)
    assert len(chosen) == pytest.approx(keys, abs=1)
    assert (chosen[0], chosen[-1]) == (0, frames - 1)
