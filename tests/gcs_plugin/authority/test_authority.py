"""Nobody flies who may not: strangers, unsigned, forged, replayed and old orders, and too many of them."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from gcs_plugin.authority import Authority, SignatureMemory, read_key
from gcs_plugin.authority.rate import TokenBucket
from gcs_plugin.authority.signing import UNITS_PER_S, SignatureCheck, timestamp_of
from gcs_plugin.component import LocateOrder
from mission.errors import SettingsError
from mission.settings import AuthoritySettings
from mission.vehicle.mavlink.command_cancel import CommandCancel
from tests.support.component_bench import Bench

KEY = bytes(range(32))
NOW = datetime(2026, 11, 22, 12, 0, tzinfo=UTC)
DENIED, IN_PROGRESS = 2, 5


def order(
    key: bytes | None = KEY,
    *,
    timestamp: int = timestamp_of(NOW),
    source: tuple[int, int] = (255, 190),
    link_id: int = 3,
    command: int = mavlink.MAV_CMD_USER_1,
) -> bytes:
    """A command (an order to locate when omitted) in its bytes, signed with a key."""
    sender = mavlink.MAVLink(None, *source)
    if key is not None:
        sender.signing.secret_key, sender.signing.sign_outgoing = key, True
        sender.signing.timestamp, sender.signing.link_id = timestamp, link_id
    message = mavlink.MAVLink_command_long_message(1, 100, command, 0, *([0.0] * 7))
    return bytes(message.pack(sender))


class Times:
    """UTC and the monotonic clock, which go when told to."""

    def __init__(self) -> None:
        self.clock_s = 5000.0
        self.utc_s = 0.0

    def utc(self) -> datetime:
        return NOW + timedelta(seconds=self.utc_s)

    def pass_s(self, seconds: float) -> None:
        self.clock_s += seconds
        self.utc_s += seconds

    def bench(self, memory: SignatureMemory | None = None) -> Bench:
        return Bench(authority=Authority(AuthoritySettings(), KEY, self.utc, memory, lambda: self.clock_s))


def signed_bench() -> Bench:
    return Bench(authority=Authority(AuthoritySettings(), KEY, lambda: NOW))


def test_the_usual_ground_stations_may_order_by_default() -> None:
    for system in (255, 250, 245):
        bench = Bench()
        bench.command(mavlink.MAV_CMD_USER_1, source=(system, 190))
        assert bench.turn() == LocateOrder()


@pytest.mark.parametrize("source", [(1, 1), (1, 191), (2, 100), (77, 190)])
def test_a_stranger_is_denied_counted_and_named(source: tuple[int, int]) -> None:
    bench = Bench()
    bench.command(mavlink.MAV_CMD_USER_1, source=source)
    assert bench.turn() is None
    assert bench.acks() == [(mavlink.MAV_CMD_USER_1, DENIED)]
    assert bench.authority.counts["stranger"] == 1
    assert f"{source[0]}/{source[1]} is not allowed" in bench.texts()


def test_a_component_of_a_system_may_be_allowed_alone() -> None:
    authority = Authority(AuthoritySettings(allowed=("42/7",)))
    bench = Bench(authority=authority)
    for source, taken in (((42, 8), False), ((42, 7), True), ((255, 190), False)):
        bench.command(mavlink.MAV_CMD_USER_1, source=source)
        assert (bench.turn() is not None) is taken


def test_a_stranger_cannot_abort_either_nor_change_the_streams() -> None:
    bench = Bench()
    bench.command(mavlink.MAV_CMD_USER_1)
    bench.turn()
    bench.take()
    bench.command(mavlink.MAV_CMD_USER_2, source=(77, 1))
    bench.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 275.0, 1.0, source=(77, 1))
    bench.step()
    assert not bench.component.should_stop()
    assert [result for _, result in bench.acks()] == [DENIED, DENIED]


def test_a_stranger_may_ask_who_the_camera_is() -> None:
    bench = Bench()
    bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 259.0, source=(77, 1))
    bench.turn()
    assert len(bench.take("CAMERA_INFORMATION")) == 1


def test_strangers_that_shout_are_reported_now_and_then_only() -> None:
    bench = Bench()
    for i in range(100):
        bench.command(mavlink.MAV_CMD_USER_1, source=(10 + i, 1))
        bench.turn(0.1)
    assert bench.texts().count("refused") <= 3
    assert bench.authority.counts["stranger"] == 100


def test_a_signed_order_is_obeyed() -> None:
    bench = signed_bench()
    bench.say_bytes(order())
    assert bench.turn() == LocateOrder()


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (lambda: order(None), "unsigned"),
        (lambda: order(bytes(32)), "forged"),
        (lambda: order(timestamp=timestamp_of(NOW - timedelta(seconds=61))), "old"),
        (lambda: order(source=(77, 190)), "stranger"),
    ],
)
def test_with_a_key_no_other_order_is_obeyed(frame: Callable[[], bytes], reason: str) -> None:
    bench = signed_bench()
    bench.say_bytes(frame())
    assert bench.turn() is None
    assert dict(bench.authority.counts) == {reason: 1}


def test_an_order_recorded_and_played_again_is_not_obeyed() -> None:
    bench = signed_bench()
    recorded = order()
    bench.say_bytes(recorded)
    assert bench.turn() == LocateOrder()
    bench.component.ended(0)
    bench.take()
    for _ in range(3):
        bench.say_bytes(recorded)
        assert bench.turn(30.0) is None
    assert bench.authority.counts["replayed"] == 3
    assert bench.acks() == []  # they would go to the true sender, who did not ask


def heartbeat(timestamp: int) -> bytes:
    sender = mavlink.MAVLink(None, 255, 190)
    sender.signing.secret_key, sender.signing.sign_outgoing = KEY, True
    sender.signing.timestamp, sender.signing.link_id = timestamp, 3
    return bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(sender))


def test_an_order_recorded_before_a_restart_is_not_obeyed_once_the_station_was_heard() -> None:
    bench = signed_bench()
    bench.say_bytes(heartbeat(timestamp_of(NOW)))
    bench.say_bytes(order(timestamp=timestamp_of(NOW) - 100_000))
    assert bench.turn() is None
    assert bench.authority.counts["replayed"] == 1


def test_a_frame_changed_on_the_way_is_forged() -> None:
    check = SignatureCheck(KEY, lambda: NOW)
    good = order()
    for at in (4, 10, 20, len(good) - 14, len(good) - 10, len(good) - 1):
        changed = bytearray(good)
        changed[at] ^= 1
        assert check.fault(bytes(changed)) == "forged"
    assert check.fault(good) is None


def test_forged_frames_do_not_silence_the_true_sender_nor_fill_the_memory() -> None:
    check = SignatureCheck(KEY, lambda: NOW)
    for link_id in range(200):
        assert check.fault(order(bytes(32), timestamp=2**47, link_id=link_id)) == "forged"
    assert check._streams == {}
    assert check.fault(order()) is None


def test_each_stream_has_its_own_counter() -> None:
    check = SignatureCheck(KEY, lambda: NOW)
    assert check.fault(order(link_id=1)) is None
    assert check.fault(order(link_id=2)) is None
    assert check.fault(order(link_id=1)) == "replayed"
    assert check.fault(order(link_id=1, timestamp=timestamp_of(NOW) + 1)) is None


def test_our_timestamp_is_never_behind_the_newest_good_one() -> None:
    check = SignatureCheck(KEY, lambda: NOW, clock=lambda: 0.0)
    ahead = timestamp_of(NOW + timedelta(hours=1))
    check.fault(order(timestamp=ahead))
    assert check.timestamp() == ahead


@pytest.mark.parametrize("length", range(0, 40))
def test_truncated_frames_are_unsigned_or_forged(length: int) -> None:
    assert SignatureCheck(KEY, lambda: NOW).fault(order()[:length]) in ("unsigned", "forged")


@pytest.mark.parametrize(
    ("content", "key"),
    [
        (KEY, KEY),
        (KEY.hex().encode() + b"\n", KEY),
        (b"correct horse\n", bytes.fromhex("5d40f92aaae32a83f38d9c4df1b07d1a1bd2d2fd2fbb1ba34c2abc8a7fd5cd10")),
    ],
)
def test_a_key_is_bytes_digits_or_a_passphrase(tmp_path: Path, content: bytes, key: bytes) -> None:
    path = tmp_path / "key"
    path.write_bytes(content)
    assert len(read_key(path)) == 32
    if not content.startswith(b"correct"):
        assert read_key(path) == key


def test_a_key_file_that_is_not_there_or_empty_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="cannot read the signing key"):
        read_key(tmp_path / "none")
    (tmp_path / "empty").write_bytes(b"\n")
    with pytest.raises(SettingsError, match="is empty"):
        read_key(tmp_path / "empty")


def test_a_bucket_lets_a_burst_through_and_then_its_rate() -> None:
    bucket = TokenBucket(rate_hz=10.0, burst=5.0)
    assert sum(bucket.take(0.0) for _ in range(100)) == 5
    assert sum(bucket.take(i / 100.0) for i in range(1, 201)) == pytest.approx(20, abs=1)
    assert not TokenBucket(1.0, 0.5).take(1e9)


def restarted(folder: Path, now: datetime = NOW) -> Bench:
    """The component of a program that has just started, with what it kept of the run before."""
    memory = SignatureMemory(folder / "signatures.json")
    return Bench(authority=Authority(AuthoritySettings(), KEY, lambda: now, memory))


def test_an_order_recorded_before_a_restart_is_a_replay_after_it(tmp_path: Path) -> None:
    recorded = order()
    first = restarted(tmp_path)
    first.say_bytes(recorded)
    assert first.turn() == LocateOrder()
    second = restarted(tmp_path, NOW + timedelta(seconds=20))
    second.say_bytes(recorded)
    assert second.turn() is None
    assert dict(second.authority.counts) == {"replayed": 1}
    second.say_bytes(order(timestamp=timestamp_of(NOW) + 1))
    assert second.turn() == LocateOrder()


def test_heartbeats_count_over_a_restart_too_and_are_written_seldom(tmp_path: Path) -> None:
    now = [NOW]
    memory = SignatureMemory(tmp_path / "signatures.json")
    bench = Bench(authority=Authority(AuthoritySettings(), KEY, lambda: now[0], memory))
    written = set()
    for second in range(20):
        now[0] = NOW + timedelta(seconds=second)
        bench.say_bytes(heartbeat(timestamp_of(now[0])))
        bench.turn()
        written.add((tmp_path / "signatures.json").read_text())
    assert len(written) == 4
    second_run = restarted(tmp_path, now[0])
    second_run.say_bytes(order(timestamp=timestamp_of(NOW) + 14 * 100_000))
    assert second_run.turn() is None
    assert second_run.authority.counts["replayed"] == 1


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        "[" * 100_000,
        '{"1/2": 3}',
        '{"1/2/3": "4"}',
        '{"1/2/x": 4}',
        '{"1/2/300": 4}',
        '{"255/190/3": -1}',
        '{"255/190/3": 1e9}',
        '{"255/190/3": 1' + 400 * "0" + "}",
        '{"255/190/3": 1' + 5000 * "0" + "}",
    ],
)
def test_a_memory_that_is_none_is_told_and_nothing_from_before_is_obeyed(tmp_path: Path, content: str) -> None:
    (tmp_path / "signatures.json").write_text(content)
    memory = SignatureMemory(tmp_path / "signatures.json")
    assert "signatures.json" in memory.lost
    assert len(memory.lost) < 400
    times = Times()
    bench = times.bench(memory)
    bench.say_bytes(order(timestamp=timestamp_of(NOW) - 1))
    assert bench.turn() is None
    assert dict(bench.authority.counts) == {"old": 1}
    times.pass_s(1.0)
    bench.say_bytes(order(timestamp=timestamp_of(times.utc())))
    assert bench.turn() == LocateOrder()
    assert bench.authority.signing_timestamp() == timestamp_of(times.utc())
    assert SignatureMemory(tmp_path / "signatures.json").lost == ""


def test_a_disk_that_refuses_does_not_refuse_the_order(tmp_path: Path) -> None:
    bench = restarted(tmp_path)
    tmp_path.rmdir()
    bench.say_bytes(order())
    assert bench.turn() == LocateOrder()


def test_a_flood_under_the_operator_s_name_does_not_hold_back_a_signed_stop() -> None:
    bench = signed_bench()
    bench.say_bytes(order())
    assert bench.turn() == LocateOrder()
    for number in range(2000):
        bench.say_bytes(order(None))
        if number == 1000:
            bench.say_bytes(order(timestamp=timestamp_of(NOW) + 1, command=mavlink.MAV_CMD_USER_2))
        bench.step()
    assert bench.component.should_stop()
    assert bench.authority.counts["too-many"] >= 1900


def test_a_stop_is_never_too_many() -> None:
    bench = Bench()
    bench.command(mavlink.MAV_CMD_USER_1)
    assert bench.turn() == LocateOrder()
    for _ in range(200):  # the operator's own station asks for everything at once
        bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 259)
    bench.command(mavlink.MAV_CMD_USER_2)
    for _ in range(20):
        bench.step()
    assert bench.component.should_stop()


@pytest.mark.parametrize("held_back", [timedelta(seconds=11), timedelta(seconds=92), timedelta(days=30)])
@pytest.mark.parametrize("known", [True, False])
def test_an_order_that_was_held_back_flies_nothing(held_back: timedelta, *, known: bool) -> None:
    times = Times()
    bench = times.bench()
    if known:
        bench.say_bytes(heartbeat(timestamp_of(NOW)))
        bench.turn()
    withheld = order(timestamp=timestamp_of(NOW) + 1)
    times.pass_s(held_back.total_seconds())
    bench.say_bytes(withheld)
    taken = bench.turn()
    # The first frame of an unknown stream may be a minute old, as the protocol says.
    assert (taken is None) or (not known and held_back < timedelta(seconds=60))
    if taken is None:
        assert bench.authority.counts["old"] == 1


def test_an_order_held_back_is_none_however_slowly_the_frames_before_it_were_let_through() -> None:
    times = Times()
    bench = times.bench()
    sent = [timestamp_of(NOW) + second * UNITS_PER_S for second in range(12)]
    for stamp in sent:  # each is held back by 8 s more than the one before
        bench.say_bytes(heartbeat(stamp))
        bench.turn()
        times.pass_s(9.0)
    bench.say_bytes(order(timestamp=sent[-1] + 1))
    assert bench.turn() is None
    assert "255/190 signed this 97 s ago" in bench.texts()


def test_an_order_signed_before_a_restart_and_held_back_is_none_after_it(tmp_path: Path) -> None:
    times = Times()
    bench = times.bench(SignatureMemory(tmp_path / "signatures.json"))
    bench.say_bytes(heartbeat(timestamp_of(NOW)))
    bench.turn()
    times.pass_s(92.0)
    bench = times.bench(SignatureMemory(tmp_path / "signatures.json"))
    bench.say_bytes(order(timestamp=timestamp_of(NOW) + 1))
    assert bench.turn() is None
    assert dict(bench.authority.counts) == {"old": 1}


@pytest.mark.parametrize("off_s", [-40.0, 3600.0, 3e7])
def test_a_station_whose_clock_is_off_may_order_for_hours_if_it_follows_the_time_it_hears(off_s: float) -> None:
    times = Times()
    bench = times.bench()
    stamp = timestamp_of(NOW) + int(off_s * UNITS_PER_S)
    for _ in range(1000):
        stamp += 1  # it counts its frames, not the time, as all of MAVLink's own libraries do
        bench.say_bytes(heartbeat(stamp))
        bench.turn()
        times.pass_s(7.0)
        stamp = max(stamp, bench.authority.signing_timestamp() or 0)
    times.pass_s(5.0)
    bench.say_bytes(order(timestamp=stamp + 1))
    assert bench.turn() == LocateOrder()
    assert not bench.authority.counts


@pytest.mark.parametrize("step_s", [-3e8, -30.0, 30.0, 3e8])
def test_a_step_of_our_own_clock_makes_no_order_old(step_s: float) -> None:
    times = Times()
    bench = times.bench()
    bench.say_bytes(heartbeat(timestamp_of(NOW)))
    bench.turn()
    before = bench.authority.signing_timestamp() or 0
    times.utc_s += step_s
    times.pass_s(1.0)
    bench.say_bytes(order(timestamp=timestamp_of(NOW) + UNITS_PER_S))
    assert bench.turn() == LocateOrder()
    assert (bench.authority.signing_timestamp() or 0) >= before + UNITS_PER_S


@pytest.mark.parametrize("late_s", [0.0, 60.0, 3600.0, 3e6])
def test_a_stop_is_obeyed_however_late_it_comes_but_once(late_s: float) -> None:
    times = Times()
    bench = times.bench()
    stop = order(timestamp=timestamp_of(NOW) - UNITS_PER_S, command=mavlink.MAV_CMD_USER_2, link_id=9)
    times.pass_s(late_s)
    for stopped in (True, False):
        stamp = timestamp_of(times.utc()) + (0 if stopped else 1)
        bench.say_bytes(order(timestamp=stamp))
        assert bench.turn() == LocateOrder()
        bench.say_bytes(stop)
        bench.step()
        assert bench.component.should_stop() is stopped
        bench.component.ended(0)
        bench.turn(10.0)  # what comes soon again is a repetition


def test_signed_frames_played_again_do_not_use_up_the_operator_s_rate() -> None:
    times = Times()
    bench = times.bench()
    recorded = order(timestamp=timestamp_of(NOW), command=mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
    for _ in range(500):
        bench.say_bytes(recorded)
        bench.step()
    bench.say_bytes(order(timestamp=timestamp_of(NOW) + 1))
    assert bench.turn() == LocateOrder()


def test_a_flood_of_stops_is_obeyed_and_not_answered_without_end() -> None:
    bench = Bench()
    for _ in range(1000):
        bench.command(mavlink.MAV_CMD_USER_2)
    for _ in range(10):
        bench.step()
    assert len(bench.acks()) <= 110


def test_without_a_signature_nothing_is_changed_where_a_key_is_set() -> None:
    bench = signed_bench()
    bench.say_bytes(order())
    assert bench.turn() == LocateOrder()
    bench.take()
    streams, settings = bench.component._intervals.interval_us(275), bench.component.settings
    for command in (31010, 31011, 31012, 31013, 511, 2004, 2005, 2010):
        bench.command(command, 275.0, 100_000.0, 0.5, 0.5)
    bench.say(mavlink.MAVLink_param_set_message(1, 100, b"LIMITS_RADIUS_M", 5.0, 9))
    bench.say(CommandCancel(1, 100, mavlink.MAV_CMD_USER_1))
    for _ in range(5):
        bench.step(0.1)
    assert not bench.component.should_stop()
    assert (bench.component._intervals.interval_us(275), bench.component.settings) == (streams, settings)
    assert all(result in (DENIED, IN_PROGRESS) for _, result in bench.acks())


def test_a_request_to_everybody_is_answered_and_an_order_to_everybody_is_none() -> None:
    bench = Bench()
    bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 259, target=(1, 0))
    bench.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 33, target=(1, 0))  # the autopilot's: not ours to deny
    bench.command(mavlink.MAV_CMD_USER_1, target=(1, 0))
    assert bench.turn() is None
    assert [message.get_type() for message in bench.take()] == ["CAMERA_INFORMATION", "COMMAND_ACK", "HEARTBEAT"]
