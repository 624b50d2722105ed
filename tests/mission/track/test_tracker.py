"""The same person, or "lost"; never somebody else."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from mission.detect.nanodet import NanoDet
from mission.errors import DetectionError
from mission.records import Box, Frame
from mission.track import Track, Tracker
from tests.support.people import Shot, film, hidden, person

BLUE = 'clothes = { shirt = "#3050b0", trousers = "#303030" }\n'
RED = 'clothes = { shirt = "#b03030", trousers = "#404a40" }\n'


@pytest.fixture(scope="module")
def network() -> NanoDet:
    return NanoDet()


def follow(
    shots: Sequence[Shot], network: NanoDet, change: Callable[[Shot], Frame] = lambda shot: shot.frame
) -> list[Track]:
    tracker = Tracker(network)
    tracker.start(shots[0].frame, shots[0].box, shots[0].roll_rad)
    return [tracker.update(change(shot), roll_rad=shot.roll_rad) for shot in shots[1:]]


def away(track: Track, shot: Shot) -> float:
    """How far the track is from the person, in body heights."""
    return float(np.hypot(*np.subtract(track.pixel, shot.truth.pixel))) / shot.truth.height_px


@pytest.mark.parametrize(
    ("distance_m", "walk_deg"), [(5.0, 90.0), (9.0, 225.0), (13.0, 0.0)], ids=["across", "nearer", "far-away"]
)
def test_a_walker_is_followed_and_the_reported_sigmas_hold(
    distance_m: float, walk_deg: float, network: NanoDet
) -> None:
    shots = film(person(distance_m, -4.0, walk_deg), 40)
    tracks = follow(shots, network)
    assert {t.state for t in tracks} == {"tracking"}
    error = np.array([np.subtract(t.pixel, s.truth.pixel) for t, s in zip(tracks, shots[1:], strict=True)])
    sigma = np.array([t.pixel_sigma_px for t in tracks])
    # The offset of the body's centre is the same in all frames, and harmless.
    assert np.abs(error.mean(axis=0)).max() < 0.04 * shots[0].truth.height_px
    assert np.mean(((error - error.mean(axis=0)) / sigma[:, None]) ** 2) < 2.5
    ratio = np.log([t.height_px or np.nan for t in tracks]) + np.log([s.truth.depth_m for s in shots[1:]])
    sizes = np.array([t.size_sigma or np.nan for t in tracks])
    assert np.mean(((ratio - ratio.mean()) / sizes) ** 2) < 3.0


def test_a_camera_that_rolls_sees_the_same_size_and_place(network: NanoDet) -> None:
    tracks = {roll: follow(film(person(5.0), 12, roll_deg=roll), network)[-1] for roll in (0.0, 10.0)}
    shots = {roll: film(person(5.0), 12, roll_deg=roll)[-1] for roll in (0.0, 10.0)}
    heights = [tracks[roll].height_px for roll in (0.0, 10.0)]
    assert heights[0] is not None
    assert heights[1] == pytest.approx(heights[0], rel=0.04)
    assert all(away(tracks[roll], shots[roll]) < 0.04 for roll in tracks)


def test_somebody_who_passes_behind_something_is_coasted_and_picked_up_again(network: NanoDet) -> None:
    shots = film(person(6.0, -12.0, 90.0, speed_m_s=1.2) + BLUE, 56)
    board = Box(290.0, 0.0, 70.0, 480.0)
    tracks = follow(shots, network, lambda shot: hidden(shot.frame, board))
    states = [t.state for t in tracks]
    assert "coasting" in states
    assert "lost" not in states
    assert states[-1] == "tracking"
    assert all(away(t, s) < 0.2 for t, s in zip(tracks, shots[1:], strict=True) if t.state == "tracking")
    gone = [t for t in tracks if t.state == "coasting"]
    assert all(t.height_px is None for t in gone)
    assert max(t.pixel_sigma_px for t in gone) > 3 * tracks[0].pixel_sigma_px


def test_somebody_who_walks_in_front_is_not_taken_for_the_target(network: NanoDet) -> None:
    people = person(6.5, 0.0) + BLUE + person(5.0, 9.0, 270.0, speed_m_s=1.2) + RED
    shots = film(people, 36)
    tracks = follow(shots, network)
    assert all(away(t, s) < 0.2 for t, s in zip(tracks, shots[1:], strict=True) if t.state == "tracking")
    assert tracks[-1].state == "tracking"


def test_somebody_in_the_same_clothes_who_walks_in_front_is_never_taken_for_the_target(network: NanoDet) -> None:
    people = person(6.5, 0.0) + BLUE + person(5.0, 9.0, 270.0, speed_m_s=1.2) + BLUE
    shots = film(people, 44)
    tracks = follow(shots, network)
    assert "coasting" in {t.state for t in tracks}, "the two could not be told apart for a while"
    assert all(away(t, s) < 0.2 for t, s in zip(tracks, shots[1:], strict=True) if t.state == "tracking")


def shaded(shot: Shot) -> Frame:
    """Half as much light on the lower three fifths of the person."""
    image = shot.frame.image.copy()
    left, right = int(shot.box.left_px), int(shot.box.right_px)
    top, bottom = int(shot.box.top_px + 0.4 * shot.box.height_px), int(shot.box.bottom_px)
    image[top:bottom, left:right] //= 2
    return Frame(image, shot.frame.t_s, shot.frame.index)


@pytest.mark.parametrize("beside", ["", person(6.0, 9.0) + RED])
def test_who_stands_in_plain_view_is_kept_when_a_shadow_falls_on_them(beside: str, network: NanoDet) -> None:
    light = 'clothes = { shirt = "#9fc0e0", trousers = "#a08060" }\n'
    shots = film(person(6.0) + light + beside, 42)
    tracks = follow(shots, network, lambda shot: shaded(shot) if shot.frame.index > 38 else shot.frame)
    assert {t.state for t in tracks} == {"tracking"}


def test_a_person_who_is_gone_is_lost_and_stays_lost(network: NanoDet) -> None:
    seen = film(person(6.0) + BLUE, 2)
    other = film(person(6.0, 3.0) + RED, 1)[0].frame.image
    tracker = Tracker(network)
    tracker.start(seen[0].frame, seen[0].box)
    assert tracker.update(seen[1].frame).state == "tracking"
    # Somebody else in the same place, for as long as a hidden person would be waited for.
    states = [tracker.update(Frame(other, 0.05 + 0.25 * k, 1 + k)).state for k in range(1, 18)]
    assert states[0] == "coasting"
    assert states[-1] == "lost"
    assert tracker.update(Frame(seen[1].frame.image, 6.0, 99)).state == "lost"


def test_a_new_start_ends_being_lost(network: NanoDet) -> None:
    shots = film(person(6.0) + BLUE, 2)
    tracker = Tracker(network)
    tracker.start(shots[0].frame, shots[0].box)
    blank = np.full_like(shots[0].frame.image, 120)
    for k in range(1, 15):
        state = tracker.update(Frame(blank, 0.3 * k, k)).state
    assert state == "lost"
    tracker.start(Frame(shots[0].frame.image, 9.0, 50), shots[0].box)
    assert tracker.update(Frame(shots[1].frame.image, 9.05, 51)).state == "tracking"


def test_a_box_without_a_person_is_refused(network: NanoDet) -> None:
    shot = film(person(6.0))[0]
    with pytest.raises(DetectionError, match="nobody"):
        Tracker(network).start(shot.frame, Box(40.0, 200.0, 50.0, 120.0))


def test_updating_before_the_start_is_refused(network: NanoDet) -> None:
    with pytest.raises(DetectionError, match="not started"):
        Tracker(network).update(film(person(6.0))[0].frame)


def test_a_height_is_not_reported_while_the_feet_are_out_of_the_picture(network: NanoDet) -> None:
    shots = film(person(1.9), 16)
    assert not shots[0].truth.in_picture
    tracks = follow(shots, network)
    assert tracks[-1].state == "tracking"
    assert tracks[-1].height_px is None
    assert tracks[-1].size_sigma is None


def test_a_lost_target_is_taken_back_by_its_colours_and_nobody_else_is(network: NanoDet) -> None:
    first, *_ = film(person(6.0) + BLUE, 2)
    later = film(person(6.0, 8.0) + BLUE, 2)[-1]
    other = film(person(6.0, 8.0) + RED, 2)[-1]
    tracker = Tracker(network)
    tracker.start(first.frame, first.box)
    assert not tracker.take_back(other.frame, other.box)
    assert tracker.take_back(later.frame, later.box)
    track = tracker.update(film(person(6.0, 8.0) + BLUE, 3)[-1].frame)
    assert track.state == "tracking"


def test_nobody_is_taken_back_before_there_was_a_target(network: NanoDet) -> None:
    shot, *_ = film(person(6.0), 1)
    with pytest.raises(DetectionError, match="not started"):
        Tracker(network).take_back(shot.frame, shot.box)
