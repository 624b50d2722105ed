"""The sightings file: what is read, what is refused, and that the other flights are still answered."""

from __future__ import annotations

import json
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mission.errors import SightingsFormatError
from mission.estimate import sightings_file
from mission.estimate.sightings_file import (
    FlightProblem,
    flight_lines,
    read_flights,
    read_flights_from,
    write_flight,
)
from mission.records import FlightSightings, NoiseModel, TargetPrior
from sitl.evaluation.accuracy.flights import Walk, out_and_back, simulate

FLIGHT = simulate(out_and_back(rate_hz=1.0), Walk(9.0), np.random.default_rng(0), name="first").flight
HEADER, *SIGHTINGS = [json.loads(line) for line in flight_lines(FLIGHT)]


def read(*records: object) -> list[FlightSightings | FlightProblem]:
    lines = [record if isinstance(record, bytes) else json.dumps(record).encode() for record in records]
    return list(read_flights_from(lines, "some.jsonl"))


def problem(*records: object) -> str:
    """The message of the first flight, with a good flight after it that has to come through."""
    bad, good = read(*records, HEADER, *SIGHTINGS)
    assert isinstance(good, FlightSightings)
    assert good == FLIGHT
    assert isinstance(bad, FlightProblem)
    return bad.message


def test_a_written_flight_reads_back_as_the_same_flight(tmp_path: Path) -> None:
    path = tmp_path / "flight.jsonl"
    own = replace(FLIGHT.sightings[3], height_px=None, pixel_sigma_px=2.5, size_sigma=0.1)
    flight = replace(FLIGHT, sightings=(*FLIGHT.sightings[:3], own, *FLIGHT.sightings[4:]), id='a "quoted" ü id')
    write_flight(path, flight)
    write_flight(path, FLIGHT, append=True)
    assert list(read_flights(path)) == [flight, FLIGHT]


def test_missing_noise_and_prior_take_the_documented_defaults() -> None:
    header = {key: value for key, value in HEADER.items() if key not in ("noise", "prior")}
    [flight] = read(header, *SIGHTINGS)
    assert isinstance(flight, FlightSightings)
    assert flight.noise == NoiseModel()
    assert flight.prior == TargetPrior()
    [flight] = read({**header, "noise": {"size_sigma": 0.1}, "prior": {}}, *SIGHTINGS)
    assert isinstance(flight, FlightSightings)
    assert flight.noise == NoiseModel(size_sigma=0.1)


def test_unknown_fields_blank_lines_and_a_byte_order_mark_do_no_harm() -> None:
    first = b"\xef\xbb\xbf" + json.dumps({**HEADER, "pilot": "A"}).encode()
    [flight] = read(first, b"  \r\n", *({**sighting, "score": 0.5} for sighting in SIGHTINGS))
    assert flight == FLIGHT


BAD_VALUES: list[object] = [None, "1", True, [], {}, float("nan"), float("inf"), 10**400]


@pytest.mark.parametrize("bad", [*BAD_VALUES, "missing"], ids=str)
@pytest.mark.parametrize("name", ["t_s", "position_enu_m", "world_from_camera_wxyz", "pixel", "height_px"])
def test_a_wrong_sighting_field_is_named_with_file_and_line(name: str, bad: object) -> None:
    if name == "height_px" and bad is None:
        pytest.skip("null means that there is no height")
    broken = {key: value for key, value in SIGHTINGS[2].items() if key != name}
    if bad != "missing":
        broken[name] = bad
    message = problem(HEADER, *SIGHTINGS[:2], broken, *SIGHTINGS[3:])
    assert message.startswith("some.jsonl:4: ")
    assert f'"{name}"' in message


@pytest.mark.parametrize("bad", [*BAD_VALUES, "missing"], ids=str)
@pytest.mark.parametrize("path", ["id", "version", "origin", "origin.lat_deg", "origin.datum", "camera", "camera.fx"])
def test_a_wrong_header_field_is_named_with_file_and_line(path: str, bad: object) -> None:
    header = json.loads(json.dumps(HEADER))
    *parents, name = path.split(".")
    where = header
    for parent in parents:
        where = where[parent]
    if bad == "missing":
        del where[name]
    elif (path == "id" and bad == "1") or (path in ("origin", "camera") and bad == {}):
        pytest.skip("that is right, or fails for what is inside")
    else:
        where[name] = bad
    message = problem(header, *SIGHTINGS)
    assert message.startswith("some.jsonl:1: header: ")
    assert f'"{name}"' in message


@pytest.mark.parametrize("bad", BAD_VALUES[:7], ids=str)
@pytest.mark.parametrize("group", ["noise", "prior"])
def test_every_noise_and_prior_field_is_checked(group: str, bad: object) -> None:
    for name in HEADER[group]:
        assert f'"{name}"' in problem({**HEADER, group: {**HEADER[group], name: bad}}, *SIGHTINGS)


@pytest.mark.parametrize("distortion", [[1e5, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1e12, 0.0, 0.0]], ids=str)
def test_a_distortion_of_no_lens_is_refused(distortion: list[float]) -> None:
    camera = {**HEADER["camera"], "distortion": distortion}
    assert '"distortion" bends the picture' in problem({**HEADER, "camera": camera}, *SIGHTINGS)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"world_from_camera_wxyz": [1.0, 1.0, 0.0, 0.0]}, "not a unit quaternion"),
        ({"world_from_camera_wxyz": [0.0, 0.0, 0.0, 0.0]}, "not a unit quaternion"),
        ({"position_enu_m": [1.0, 2.0]}, "2 numbers"),
        ({"pixel": [1.0, float("nan")]}, "not finite"),
        ({"height_px": 0.0}, "above 0"),
        ({"height_px": -3.0}, "above 0"),
        ({"height_px": 5e-324}, "below 1e-12"),
        ({"size_sigma": 1e-300}, "below 1e-12"),
        ({"position_enu_m": [0.0, 1e300, 0.0]}, "beyond 1e+12"),
        ({"pixel_sigma_px": -1.0}, "below 0"),
        ({"size_sigma": None}, "null"),
        ({"t_s": 0.5}, "backwards"),
    ],
)
def test_values_that_cannot_be_are_refused(change: dict[str, object], said: str) -> None:
    assert said in problem(HEADER, *SIGHTINGS[:2], {**SIGHTINGS[2], **change}, *SIGHTINGS[3:])


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (b"{not json", "not JSON"),
        (b"[1, 2]", "not a JSON object"),
        (b"\xff\xfe\x00", "not UTF-8"),
        (b"[" * 100_000, "not JSON"),
        (b" " * (1 << 20) + b"{}", "longer than"),
    ],
    ids=["text", "list", "bytes", "deep", "long"],
)
def test_a_line_that_is_no_sighting_spoils_its_own_flight_only(line: bytes, said: str) -> None:
    assert said in problem(HEADER, *SIGHTINGS[:2], line, *SIGHTINGS[2:])


def test_a_broken_header_still_ends_the_flight_before_it_and_names_its_own() -> None:
    first, second, third = read(
        HEADER, *SIGHTINGS, json.dumps({**HEADER, "id": "torn"}).encode()[:-20], *SIGHTINGS, HEADER, *SIGHTINGS
    )
    assert first == FLIGHT
    assert isinstance(second, FlightProblem)
    assert second.id == "torn"
    assert third == FLIGHT


def test_equal_times_are_in_order() -> None:
    [flight] = read(HEADER, SIGHTINGS[0], SIGHTINGS[0], *SIGHTINGS)
    assert isinstance(flight, FlightSightings)


def test_sightings_before_the_first_header_are_a_problem_without_an_id() -> None:
    orphan, flight = read(SIGHTINGS[0], HEADER, *SIGHTINGS)
    assert isinstance(orphan, FlightProblem)
    assert orphan.id is None
    assert "some.jsonl:1: " in orphan.message
    assert flight == FLIGHT


@pytest.mark.parametrize("content", [b"", b"\n\n", b"\x89PNG\r\n\x1a\n\x00", b'{"t_s": 1}'])
def test_a_file_without_any_header_cannot_be_read(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "bad.jsonl"
    path.write_bytes(content)
    with pytest.raises(SightingsFormatError, match=r"bad\.jsonl"):
        list(read_flights(path))


def test_a_file_that_is_not_there_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(SightingsFormatError, match="No such file"):
        list(read_flights(tmp_path / "none.jsonl"))


def test_a_flight_has_a_largest_number_of_sightings_and_memory_stays_bounded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sightings_file, "MAX_SIGHTINGS", 1000)
    line = json.dumps(SIGHTINGS[0]).encode()

    def endless() -> Iterator[bytes]:
        yield json.dumps(HEADER).encode()
        for _ in range(100_000):
            yield line
        yield json.dumps(HEADER).encode()
        yield from (json.dumps(sighting).encode() for sighting in SIGHTINGS)

    tracemalloc.start()
    too_long, flight = read_flights_from(endless(), "some.jsonl")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert isinstance(too_long, FlightProblem)
    assert "more than 1000 sightings" in too_long.message
    assert flight == FLIGHT
    assert peak < 4e6
