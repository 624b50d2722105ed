"""The steady view and the background's trails on the contact sheet."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest

from gcs_plugin.flight_report.attitude_view import residuals_deg, steady_view
from gcs_plugin.flight_report.contact_sheet import MOVING, STILL, contact_sheet
from mission.bundle import AttitudeCurves, BundleSolution, PointTrails
from mission.records import Box, Image, NoiseModel
from mission.track import Track


def _curves(frames: int = 60) -> AttitudeCurves:
    t_s = 100.0 + np.arange(frames) / 20.0
    steadied = np.stack([3.1 + 0.1 * (t_s - 100.0), 0.02 * np.sin(t_s), -0.1 * np.cos(t_s)], 1)
    reported = steadied + np.stack([0.3 + 0.02 * np.sin(2.0 * t_s), 0.01 * np.ones(frames), np.zeros(frames)], 1)
    return AttitudeCurves(t_s, np.arctan2(np.sin(reported), np.cos(reported)), steadied, np.full(frames, 80))


def _steadied() -> BundleSolution:
    return BundleSolution((), NoiseModel(), _curves(), None, 0.4, 0.9)


def _pixels(png: bytes) -> Image:
    return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), np.uint8)


def test_only_changes_count_and_the_heading_may_pass_south() -> None:
    away = residuals_deg(_curves())
    np.testing.assert_allclose(away.mean(axis=0), 0.0, atol=1e-9)
    assert away[:, 0].std() == pytest.approx(np.degrees(0.02) / np.sqrt(2.0), rel=0.15)
    assert np.abs(away[:, 1:]).max() < 1e-6


def test_the_view_is_a_picture_of_the_size_asked_for_with_curves_in_it() -> None:
    picture = _pixels(steady_view(_steadied(), "20261122T120006Z-3f9a1c-1", size_px=(900, 600)))
    assert picture.shape == (600, 900, 3)
    red = (picture[:, :, 2] > 180) & (picture[:, :, 1] < 120) & (picture[:, :, 0] < 130)
    assert np.count_nonzero(red.any(axis=0)) > 500


def test_a_flight_that_was_not_steadied_says_why() -> None:
    refused = replace(_steadied(), curves=None, reason="only 3 % of the pictures show enough texture")
    plain, told = (
        _pixels(steady_view(refused if refused_too else replace(refused, reason="x"), "flight"))
        for refused_too in (False, True)
    )
    top = slice(60, 130)
    assert np.count_nonzero(told[top] < 128) > np.count_nonzero(plain[top] < 128)


@dataclass(frozen=True)
class Picture:
    image: Image
    t_s: float
    track: Track


def _sheet(trails: PointTrails | None) -> Image:
    box = Box(10.0, 10.0, 20.0, 40.0)
    track = Track(0, 5.0, "tracking", box, box.centre_px, 1.0, 40.0, 0.03, 1.0)
    grey = np.full((300, 400, 3), 128, np.uint8)
    return _pixels(contact_sheet([Picture(grey, 5.0, track)], started_s=5.0, trails=trails))


def _near(picture: Image, colour: tuple[int, int, int]) -> tuple[float, float] | None:
    found = np.abs(picture.astype(int) - colour).max(axis=2) < 60
    if not found.any():
        return None
    rows, columns = np.nonzero(found)
    return float(columns.mean()), float(rows.mean())


def test_the_contact_sheet_shows_which_points_stand_still_and_which_move() -> None:
    trails = PointTrails(
        t_s=np.array([4.8, 5.0, 4.8, 5.0, 3.0]),
        track=np.array([1, 1, 2, 2, 3]),
        pixel=np.array([[200.0, 100.0], [240.0, 100.0], [200.0, 200.0], [240.0, 200.0], [100.0, 250.0]]),
        still=np.array([True, True, False, False, True]),
    )
    still, moving = _near(_sheet(trails), STILL), _near(_sheet(trails), MOVING)
    assert still is not None
    assert moving is not None
    assert still[1] == pytest.approx(108.0, abs=3.0)
    assert moving[1] == pytest.approx(208.0, abs=3.0)
    assert 205.0 < still[0] < 255.0


def test_without_trails_there_are_none() -> None:
    assert _near(_sheet(None), STILL) is None
