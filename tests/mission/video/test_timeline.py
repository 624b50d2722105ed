from collections.abc import Callable

import numpy as np
import pytest

from mission.video.timeline import Arrivals, LiveTimeline, RecordedTimeline


def arrivals(count: int, rng: np.random.Generator) -> list[tuple[float, float]]:
    """pts, arrival: 20 fps, captured at 1000 + pts, 80 ms delay and up to 30 ms more."""
    return [(i / 20.0, 1000.0 + i / 20.0 + 0.08 + float(rng.uniform(0.0, 0.03))) for i in range(count)]


def test_times_follow_the_sender_and_not_the_jitter_of_the_network() -> None:
    timeline = LiveTimeline(latency_s=0.08)
    errors = [timeline.time_of(pts, at) - (1000.0 + pts) for pts, at in arrivals(200, np.random.default_rng(0))]
    assert max(abs(error) for error in errors[40:]) < 0.004


def test_the_latency_is_subtracted() -> None:
    assert LiveTimeline(0.25).time_of(3.0, 100.0) == pytest.approx(99.75)
    assert LiveTimeline(0.25).time_of(None, 100.0) == pytest.approx(99.75)


def test_the_33_bit_clock_may_wrap() -> None:
    timeline, wrap = LiveTimeline(), 2.0**33 / 90000.0
    times = [timeline.time_of((wrap - 1.0 + i / 20.0) % wrap, 500.0 + i / 20.0) for i in range(60)]
    np.testing.assert_allclose(np.diff(times), 0.05, atol=1e-6)


@pytest.mark.parametrize("jump_s", [-3000.0, -2.0, 7200.0])
def test_a_sender_that_starts_its_clock_anew_is_followed_at_once(jump_s: float) -> None:
    timeline = LiveTimeline()
    for i in range(100):
        timeline.time_of(5000.0 + i / 20.0, 10.0 + i / 20.0)
    after = [timeline.time_of(5000.0 + i / 20.0 + jump_s, 10.0 + i / 20.0) for i in range(100, 110)]
    np.testing.assert_allclose(after, [10.0 + i / 20.0 for i in range(100, 110)], atol=1e-6)


def test_a_backlog_that_arrives_at_once_does_not_shift_the_times() -> None:
    timeline = LiveTimeline()
    for i in range(100):
        timeline.time_of(i / 20.0, 10.0 + i / 20.0)
    held_back = [timeline.time_of(i / 20.0, 17.0) for i in range(100, 140)]
    np.testing.assert_allclose(held_back, [10.0 + i / 20.0 for i in range(100, 140)], atol=1e-6)


def test_a_file_starts_where_it_is_told_and_bridges_nonsense() -> None:
    timeline = RecordedTimeline(50.0, 0.05)
    pts = [7.0, 7.05, 7.10, 300.0, 300.05, None, 0.0, 0.05]
    times = [timeline.time_of(at, 0.0) for at in pts]
    np.testing.assert_allclose(times, 50.0 + 0.05 * np.arange(8), atol=1e-9)


def test_times_are_not_relied_on_while_a_backlog_is_read() -> None:
    timeline = LiveTimeline()
    settled = []
    for i in range(30):
        timeline.time_of(i / 20.0, 10.0 + max(i / 20.0, 0.6 + 0.01 * i))  # the first 0.7 s had piled up
        settled.append(timeline.settled)
    assert not any(settled[:15])
    assert all(settled[20:])


def test_a_network_that_never_calms_down_does_not_hold_the_frames_back_for_ever() -> None:
    timeline = LiveTimeline()
    for i in range(30):
        timeline.time_of(i / 20.0, 10.0 + i * 0.044)
    assert timeline.settled


def test_one_frame_without_a_time_is_not_relied_on_but_a_stream_of_them_is() -> None:
    timeline = LiveTimeline()
    settled = []
    for pts_s in (None, *(i / 20.0 for i in range(10)), None):
        timeline.time_of(pts_s, 10.0 + (pts_s or 0.0))
        settled.append(timeline.settled)
    assert (settled[0], settled[10], settled[11]) == (False, True, False)
    untimed = LiveTimeline()
    for i in range(30):
        untimed.time_of(None, 10.0 + i / 20.0)
    assert untimed.settled


def test_packets_are_remembered_for_a_while() -> None:
    queue = Arrivals()
    queue.note(0.2, 1.05)
    assert queue.of(0.2, 9.0) == 1.05
    assert queue.of(None, 9.0) == 9.0
    for i in range(1000):
        queue.note(10.0 + i, float(i))
    assert queue.of(0.2, 9.0) == 9.0  # forgotten: the memory is bounded


def errors_s(stamp_of: Callable[[int, float], float], fps: float, seed: int = 1) -> tuple[list[float], LiveTimeline]:
    """How far the times of the frames that may be relied on are off, from ten seconds on."""
    rng, timeline, errors = np.random.default_rng(seed), LiveTimeline(), []
    for k in range(round(40.0 * fps)):
        true_s = 1000.0 + k / fps
        t_s = timeline.time_of(stamp_of(k, k / fps), true_s + 0.05 + abs(rng.normal(0.0, 0.01)))
        if timeline.settled and k / fps > 10.0:
            errors.append(t_s - true_s - 0.05)
    return errors, timeline


@pytest.mark.parametrize("rate", [0.8, 0.84, 0.95, 1.05, 1.2])
def test_stamps_that_count_frames_are_found_out(rate: float) -> None:
    errors, timeline = errors_s(lambda k, _: k / 25.0, 25.0 * rate)
    assert len(errors) > 500
    assert np.abs(errors).max() < 0.05
    assert f"run at {rate:.2f} of real time" in timeline.note


@pytest.mark.parametrize("step_s", [-0.8, -0.2, 0.2, 0.4])
def test_stamps_that_step_stay_within_a_frame_or_two(step_s: float) -> None:
    errors, timeline = errors_s(lambda _, t: 5.0 + t + (step_s if t > 20.0 else 0.0), 25.0)
    assert np.abs(errors).max() < 0.08
    assert ("set back" in timeline.note) == (step_s < 0.0)


def test_stamps_that_stand_still_are_none() -> None:
    errors, timeline = errors_s(lambda _k, _t: 0.0, 25.0)
    assert np.abs(errors).max() < 0.06
    assert "stand still" in timeline.note


def test_honest_stamps_are_not_suspected_in_jitter() -> None:
    for seed in range(5):
        errors, timeline = errors_s(lambda _, t: 5.0 + 1.002 * t, 25.0, seed)
        assert np.abs(errors).max() < 0.03
        assert timeline.note == ""
