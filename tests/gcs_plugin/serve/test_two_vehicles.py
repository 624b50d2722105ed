"""Two vehicles ordered at the same time: each answers, and one's trouble is not the other's."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_plugin.geotags.log import read_geotags
from sitl.autopilot import Mode
from tests.support.station import until
from tests.support.two_vehicles import Pair, Trouble, kill, two_vehicles

TROUBLES: tuple[Trouble, ...] = ("pilot killed", "video gone", "link cut")

pytestmark = [pytest.mark.soak, pytest.mark.timeout(900)]


@pytest.mark.parametrize("one_link", [False, True], ids=["two links", "one link"])
def test_both_are_located_at_the_same_time_and_ones_trouble_is_not_the_others(tmp_path: Path, one_link: bool) -> None:
    with two_vehicles(tmp_path, one_link=one_link) as pair:
        pair.both_fly()
        assert len({*pair.pilots, *pair.fleet.pids}) == 4
        assert all(pair.locates(vehicle, 0) for vehicle in pair.vehicles), pair.news()
        each_has_its_own_answer(pair)
        for trouble in TROUBLES:
            the_second_is_located_whatever_befalls_the_first(pair, trouble)


def each_has_its_own_answer(pair: Pair) -> None:
    places = []
    for vehicle in pair.vehicles:
        (geotag,) = read_geotags(vehicle.folder / "geotags.gpkg")
        places.append(geotag.place.lat_deg)
        (answer,) = vehicle.station.found("CAMERA_TRACKING_GEO_STATUS")
        assert answer.lat == pytest.approx(geotag.place.lat_deg * 1e7, abs=2)
    assert places[1] - places[0] == pytest.approx(0.001, abs=2e-5)  # their homes' distance


def the_second_is_located_whatever_befalls_the_first(pair: Pair, trouble: Trouble) -> None:
    first, second = pair.vehicles
    answers = [v.answers for v in pair.vehicles]
    results = len(second.results)
    pair.both_fly()
    processes = pair.fleet.pids[1], pair.pilots[1]
    if trouble == "pilot killed":
        kill(pair.pilots[0])
    elif trouble == "video gone":
        (first.folder / "no-video").touch()
    else:
        first.autopilot.cut()
    assert until(lambda: not first.flies, 15.0), trouble
    assert until(lambda: first.holds, 15.0), trouble
    assert pair.locates(second, results), pair.news()
    assert [v.answers for v in pair.vehicles] == [answers[0], answers[1] + 1]
    assert (pair.fleet.pids[1], pair.pilots[1]) == processes
    assert not any("vehicle 2" in line and ("lost" in line or "gone" in line) for line in pair.said), pair.news()
    (first.folder / "no-video").unlink(missing_ok=True)
    first.autopilot.cut(False)
    first.autopilot.switch(Mode.HOLD)  # the operator ends the autopilot's failsafe
    assert until(lambda: not first.critical, 5.0)
    assert until(lambda: pair.served_again(first), 60.0), pair.news()
