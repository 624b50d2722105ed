"""The baseline table from pictures of a wall with markers, rendered from known places."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mission.calibration.baseline import (
    BaselineTable,
    WallRun,
    baseline_table,
    reckoning_scale,
    travel_of,
    video_delay,
)
from mission.calibration.wall import MarkerWall, WallSight
from mission.camera import CameraModel
from mission.errors import CalibrationError
from mission.planning.pattern import PAPER_BASELINE_M
from mission.records import CameraIntrinsics, Image, Vector

LENS = CameraIntrinsics(640, 480, 516.0, 514.0, 312.0, 247.0)
MARKER_M, SPACING_M, MARKERS = 0.3, 0.5, 30
WALL = MarkerWall("4X4_50", MARKER_M, SPACING_M)
_PX_PER_M = 200
_MARGIN_M = 0.5


@pytest.fixture(scope="module")
def wall_picture() -> Image:
    """The wall itself, 200 pixels to the metre."""
    width = round(((MARKERS - 1) * SPACING_M + 2 * _MARGIN_M) * _PX_PER_M)
    picture = np.full((round(2 * _MARGIN_M * _PX_PER_M), width), 210, np.uint8)
    side = round(MARKER_M * _PX_PER_M)
    for number in range(MARKERS):
        left = round((_MARGIN_M + number * SPACING_M - MARKER_M / 2) * _PX_PER_M)
        top = round((_MARGIN_M - MARKER_M / 2) * _PX_PER_M)
        marker = cv2.aruco.generateImageMarker(WALL.dictionary, number, side)
        picture[top : top + side, left : left + side] = marker
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def photograph(wall: Image, place: Vector, turn_deg: tuple[float, float, float], rng: np.random.Generator) -> Image:
    """What a camera at a place sees, turned by pitch, yaw and roll from looking straight at the wall."""
    camera_from_wall = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix().T
    scale, first = 1.0 / _PX_PER_M, 0.5 / _PX_PER_M - _MARGIN_M
    wall_from_picture = np.array([[scale, 0.0, first], [0.0, scale, first], [0.0, 0.0, 1.0]])
    plane = np.column_stack([camera_from_wall[:, 0], camera_from_wall[:, 1], -camera_from_wall @ place])
    view = CameraModel(LENS).matrix @ plane @ wall_from_picture
    size = (LENS.width_px, LENS.height_px)
    seen = cv2.warpPerspective(wall, view, size, flags=cv2.INTER_AREA, borderValue=(120, 120, 120))
    soft = cv2.GaussianBlur(seen, (0, 0), 0.7).astype(np.float32)
    noise = rng.standard_normal(soft.shape[:2], dtype=np.float32)
    return np.asarray(np.clip(soft + 3.0 * noise[..., None], 0, 255), dtype=np.uint8)


@pytest.mark.parametrize("turn_deg", [(0.0, 0.0, 0.0), (4.0, -8.0, 6.0)])
def test_a_picture_says_where_the_camera_was(wall_picture: Image, turn_deg: tuple[float, float, float]) -> None:
    place = np.array([6.0, -0.2, -3.0])
    sight = WALL.look(photograph(wall_picture, place, turn_deg, np.random.default_rng(1)), LENS)
    assert sight is not None
    assert sight.markers >= 4
    assert sight.rms_px < 0.5
    assert sight.position_m == pytest.approx(place, abs=0.03)


def test_a_picture_without_markers_says_nothing(wall_picture: Image) -> None:
    rng = np.random.default_rng(2)
    assert WALL.look(np.full((480, 640, 3), 128, np.uint8), LENS) is None
    lone = photograph(wall_picture, np.array([0.0, 0.0, -0.45]), (0.0, 0.0, 0.0), rng)
    assert WALL.look(lone, LENS) is None, "one marker alone is not enough"


def test_markers_that_stand_elsewhere_than_told_are_noticed(wall_picture: Image) -> None:
    wrong = MarkerWall("4X4_50", MARKER_M, SPACING_M * 1.2)
    picture = photograph(wall_picture, np.array([6.0, 0.0, -3.0]), (0.0, 0.0, 0.0), np.random.default_rng(3))
    assert wrong.look(picture, LENS) is None


def test_the_papers_table_comes_out_of_pictures(wall_picture: Image) -> None:
    """Three flights to the left, four pictures a second; each run is a little longer or shorter than the table."""
    rng = np.random.default_rng(4)
    table_m = np.cumsum(PAPER_BASELINE_M)
    travels = []
    for scale in (0.96, 1.0, 1.04):
        times, sights = [], []
        for t_s in np.arange(0.0, 5.3, 0.25) + 0.03:
            travel = scale * float(np.interp(t_s, 0.5 * np.arange(12), [*table_m, table_m[-1] + 1.9]))
            place = np.array([12.0 - travel, 0.05 * np.sin(t_s), -3.0])
            turn = (1.0, 2.0, -4.0)
            sight = WALL.look(photograph(wall_picture, place, turn, rng), LENS)
            if sight is not None:
                times.append(100.0 + t_s)
                sights.append(sight)
        travels.append(travel_of(WallRun(100.0, np.array(times), tuple(sights))))
    table = baseline_table(travels)
    assert len(table) == 11
    assert table.step_m == pytest.approx(PAPER_BASELINE_M, abs=0.05)
    assert table.travel_m[-1] == pytest.approx(table_m[-1], abs=0.05)
    assert table.travel_sigma_m[-1] == pytest.approx(0.04 * table_m[-1], rel=0.2)


def run(travel: Vector, *, rate_hz: float = 20.0, started_s: float = 50.0, drop: slice = slice(0, 0)) -> WallRun:
    """A run whose camera was where the travel says, seen without error."""
    times = started_s + np.arange(-0.2, 5.2, 1.0 / rate_hz)
    along = np.interp(times - started_s, 0.5 * np.arange(len(travel)), travel)
    kept = np.delete(np.arange(len(times)), drop)
    sights = tuple(WallSight(np.array([8.0 - along[k], 0.0, -3.0]), 0.2, 5) for k in kept)
    return WallRun(started_s, times[kept], sights)


LINE = np.linspace(0.0, 5.0, 11)


def test_travel_is_positive_whichever_way_is_flown() -> None:
    assert travel_of(run(LINE)) == pytest.approx(LINE, abs=1e-9)
    assert travel_of(run(-LINE)) == pytest.approx(LINE, abs=1e-9)


def test_where_the_wall_was_not_seen_the_travel_is_unknown() -> None:
    travel = travel_of(run(LINE, drop=slice(40, 60)))  # 1.8 to 2.8 s after the start
    assert np.isnan(travel[4:6]).all()
    assert np.isfinite(travel[[0, 1, 2, 3, 6, 7, 10]]).all()


def test_unseen_at_the_start_is_refused() -> None:
    with pytest.raises(CalibrationError, match="when a run began"):
        travel_of(run(LINE, drop=slice(0, 20)))


def test_a_flight_towards_the_wall_is_refused() -> None:
    times = 50.0 + np.arange(0.0, 5.0, 0.1)
    sights = tuple(WallSight(np.array([8.0 - 0.1 * k / 10, 0.0, -4.0 + 0.04 * k]), 0.2, 5) for k in range(len(times)))
    with pytest.raises(CalibrationError, match="direction"):
        travel_of(WallRun(50.0, times, sights))


def test_two_runs_are_too_few() -> None:
    with pytest.raises(CalibrationError, match="2 runs"):
        baseline_table([LINE, LINE])


def test_the_table_ends_where_too_few_runs_saw_the_wall() -> None:
    short = LINE.copy()
    short[8:] = np.nan
    table = baseline_table([LINE, LINE * 1.1, short])
    assert isinstance(table, BaselineTable)
    assert len(table) == 8
    assert table.runs.tolist() == [3] * 8
    assert table.step_sigma_m[0] == 0.0


def test_the_scale_of_the_aircrafts_own_velocity() -> None:
    scale, sigma = reckoning_scale([LINE * 0.95, LINE * 0.93, LINE * 0.97], [LINE, LINE, LINE])
    assert scale == pytest.approx(0.95)
    assert sigma == pytest.approx(0.02)
    with pytest.raises(CalibrationError):
        reckoning_scale([LINE * 0.0] * 3, [LINE * 0.0] * 3)


SLOW_START_S = np.arange(0.0, 8.0, 0.02)
SLOW_START_M = 0.35 * np.clip(SLOW_START_S - 1.0, 0.0, 5.0) ** 2


@pytest.mark.parametrize("delay_s", [0.0, 0.2, 0.45])
def test_the_video_s_delay_is_told_by_the_travel_that_both_describe(delay_s: float) -> None:
    pictures_s = np.arange(1.0, 7.0, 1.0 / 12.0)
    noise = 0.01 * np.random.default_rng(4).standard_normal(len(pictures_s))
    # The wall counts to the right and from its first marker, and the aircraft's scale is wrong.
    along = 13.6 - np.interp(pictures_s - delay_s, SLOW_START_S, SLOW_START_M) + noise
    assert video_delay(pictures_s, along, SLOW_START_S, 0.93 * SLOW_START_M) == pytest.approx(delay_s, abs=0.015)


def test_gaps_in_the_poses_do_not_matter() -> None:
    pictures_s = np.arange(1.0, 7.0, 1.0 / 12.0)
    along = np.interp(pictures_s - 0.2, SLOW_START_S, SLOW_START_M)
    told = np.where((SLOW_START_S > 3.0) & (SLOW_START_S < 3.3), np.nan, SLOW_START_M)
    assert video_delay(pictures_s, along, SLOW_START_S, told) == pytest.approx(0.2, abs=0.015)


def test_without_pictures_or_travel_no_delay_is_told() -> None:
    with pytest.raises(CalibrationError, match="too few pictures"):
        video_delay(SLOW_START_S[:3], SLOW_START_M[:3], SLOW_START_S, SLOW_START_M)
    with pytest.raises(CalibrationError, match="did not move"):
        video_delay(SLOW_START_S, SLOW_START_M, SLOW_START_S, np.zeros(len(SLOW_START_S)))


def test_a_last_look_at_the_wall_in_the_hover_before_the_run_is_image_0() -> None:
    times = np.array([9.6, 10.4, 10.6, 10.8, 11.0])
    sights = tuple(WallSight(np.array([x, 0.0, -4.0]), 0.3, 4) for x in (13.6, 13.55, 13.45, 13.3, 13.1))
    travel = travel_of(WallRun(10.0, times, sights), images=3)
    assert travel == pytest.approx([0.0, 0.1, 0.5])
    with pytest.raises(CalibrationError, match="when a run began"):
        travel_of(WallRun(10.0, times[1:], sights[1:]), images=3)
