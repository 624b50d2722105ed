"""DJI's subtitles: each family's spelling, and what is missing, swapped or broken in them."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mission.errors import LogError
from mission.logs import read_log
from mission.pose.buffer import heading
from tests.mission.logs.test_damaged import read_or_refused

# One line of each family; {lat} and {lon} advance by a metre or so from cue to cue.
FAMILIES = {
    "Mini 3 Pro": "[iso : 2700] [latitude: {lat:.6f}] [longitude: {lon:.6f}] [rel_alt: 1.3 abs_alt: 132.8]",
    "Mavic Pro": "GPS({lat:.6f},{lon:.6f},69.8) BAROMETER(91.2) HOME({lat:.6f},{lon:.6f}) D=5.2m H=1.3m",
    "Phantom 4 RTK": (
        "F/5.6, SS 400, ISO 100, EV 0, GPS ({lon:.6f}, {lat:.6f}, 15), HOME ({lon:.6f}, {lat:.6f}, -57.98m), D 69m, "
        "H 1.30m, H.S 0.00m/s, V.S 0.00m/s, F.PRY (2.7°, -7.0°, 110.1°), G.PRY (-24.4°, 0.0°, 110.4°)"
    ),
    "Mavic 3": (
        '<font size="36">SrtCnt : 1, DiffTime : 33ms\n2026-01-18 10:23:26.397\n[iso : 100] [focal_len : 240] '
        "[latitude: {lat:.6f}] [longitude: {lon:.6f}] [rel_alt: 1.300 abs_alt: 142.7] [ct : 5500] </font>"
    ),
    "Avata 360": (
        '<font size="28">FrameCnt: 1, DiffTime: 40ms\n2026-01-18 10:23:26.397\n[fnum: 1.8] [focal_len: 24.00] '
        "[dzoom_ratio: 1.00], [latitude: {lat:.6f}] [longitude: {lon:.6f}] [rel_alt: 1.300 abs_alt: 142.7] "
        "[gb_yaw: 110.4 gb_pitch: -24.4 gb_roll: 0.0] </font>"
    ),
}


def write(path: Path, line: str, *, dot: bool = False, lat: float = 36.61, lon: float = -106.11) -> Path:
    cues = []
    for n in range(40):
        at = f"00:00:{n // 10:02d}{'.' if dot else ','}{n % 10}00"
        cues.append(f"{n + 1}\n{at} --> {at}\n{line.format(lat=lat + 1e-5 * n, lon=lon)}\n")
    path.write_text("\n".join(cues), encoding="utf-8")
    return path


@pytest.mark.parametrize("family", FAMILIES)
def test_families(family: str, tmp_path: Path) -> None:
    log = read_log(write(tmp_path / "a.SRT", FAMILIES[family]))
    assert log.origin.lat_deg == pytest.approx(36.61, abs=1e-6)
    assert log.origin.lon_deg == pytest.approx(-106.11, abs=1e-6)
    assert log.positions.enu_m[-1][1] == pytest.approx(39 * 1.11, abs=0.5)
    assert log.take_off_up_m == pytest.approx(-1.3, abs=0.01)
    if family in ("Phantom 4 RTK", "Avata 360"):
        pose = log.pose_at()(1.0)
        assert pose is not None
        assert math.degrees(heading(pose.world_from_body_wxyz)) == pytest.approx(110.4)
    else:
        assert log.pointing is None
        assert "no attitude" in log.notes[0]
    if family in ("Mavic 3", "Avata 360"):
        assert log.hfov_rad == pytest.approx(2 * math.atan(18.0 / 24.0))


def test_local_time_needs_its_zone(tmp_path: Path) -> None:
    path = write(tmp_path / "a.SRT", FAMILIES["Mavic 3"])
    assert read_log(path).utc_at_zero_s is None
    told = read_log(path, zone=timezone(timedelta(hours=2))).utc_at_zero_s
    assert told == pytest.approx(datetime(2026, 1, 18, 8, 23, 26, 397000, tzinfo=UTC).timestamp())


def test_dot_before_milliseconds_and_utf16(tmp_path: Path) -> None:
    path = write(tmp_path / "a.SRT", FAMILIES["Mini 3 Pro"], dot=True)
    path.write_bytes(path.read_text(encoding="utf-8").encode("utf-16"))
    assert len(read_log(path).positions.t_s) == 40


def test_order_that_cannot_be_told_is_asked_for(tmp_path: Path) -> None:
    path = write(tmp_path / "a.SRT", "GPS({lat:.6f},{lon:.6f},0.0M) BAROMETER:0.3M", lon=-6.11)
    with pytest.raises(LogError, match="--gps-order"):
        read_log(path)
    assert read_log(path, order="lat-lon").origin.lat_deg == pytest.approx(36.61)
    assert read_log(path, order="lon-lat").origin.lon_deg == pytest.approx(36.61)


def test_before_the_fix_there_is_no_position(tmp_path: Path) -> None:
    path = write(tmp_path / "a.SRT", "[latitude: 0.000000] [longitude: 0.000000] [rel_alt: 1.3 abs_alt: 132.8]")
    with pytest.raises(LogError, match="no positions"):
        read_log(path)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(at=st.integers(0, 3000), junk=st.binary(max_size=40), cut=st.integers(0, 3000))
def test_damaged_files_are_read_or_refused(at: int, junk: bytes, cut: int, tmp_path: Path) -> None:
    whole = write(tmp_path / "a.SRT", FAMILIES["Phantom 4 RTK"]).read_bytes()
    (tmp_path / "b.SRT").write_bytes(whole[:at] + junk + whole[at + cut :])
    log = read_or_refused(tmp_path / "b.SRT")
    assert log is None or abs(log.origin.lat_deg) <= 90.0
