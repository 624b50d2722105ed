"""Answers to the benchmark are held to the truth, by flight and by time."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mission.errors import InputError
from mission.geodesy import enu_to_geodetic
from mission.records import GeodeticOrigin
from sitl.evaluation.archive.score import score, table

ORIGIN = GeodeticOrigin(47.4, 8.55, 500.0)


def benchmark(folder: Path, flights: int = 2) -> Path:
    (folder / "truth").mkdir()
    rows = [
        {"video_s": 0.05 * k, "person_enu_m": [0.05 * k, 8.0, 0.9], "reported_less_true_m": [1.0, 0.0, 0.0]}
        for k in range(100)
    ]
    for number in range(flights):
        told = {"origin": [ORIGIN.lat_deg, ORIGIN.lon_deg, ORIGIN.alt_m], "focal_px": 500.0, "rows": rows}
        (folder / "truth" / f"f{number:03d}.truth.json").write_text(json.dumps(told))
    return folder


def answer(flight: str, video_s: float, east_m: float, ce90_m: float = 0.5) -> dict[str, object]:
    place = enu_to_geodetic(np.array([east_m, 8.0, 0.9]), ORIGIN)
    point = {"type": "Point", "coordinates": [place.lon_deg, place.lat_deg]}
    properties = {"flight": flight, "video_s": video_s, "ce90_m": ce90_m}
    return {"type": "Feature", "geometry": point, "properties": properties}


def written(folder: Path, *features: dict[str, object]) -> Path:
    path = folder / "answers.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_where_the_person_was_at_that_time(tmp_path: Path) -> None:
    # At 2 s the person is 2 m east; seen from an aircraft that is reported 1 m too far east, 3 m.
    answers = written(tmp_path, answer("card/f000", 2.0, 3.2), answer("card/f000", 2.0, 9.0))
    found, missing = score(benchmark(tmp_path), answers)
    assert (found.flight, found.answered, found.spare) == ("f000", True, 1)
    assert found.beside_m == pytest.approx(0.2, abs=0.01)
    assert found.error_m == pytest.approx(1.2, abs=0.01)
    assert not found.inside
    assert not missing.answered
    assert table([found, missing]).startswith("1 of 2 people located, 1 answers too many")


def test_an_answer_for_no_time_of_the_video_is_none(tmp_path: Path) -> None:
    (one,) = score(benchmark(tmp_path, 1), written(tmp_path, answer("f000", 60.0, 3.0)))
    assert not one.answered
    assert one.spare == 1


@pytest.mark.parametrize("text", ["", "{}", '{"features": [{}]}'])
def test_what_is_no_answer(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.geojson").write_text(text)
    with pytest.raises(InputError, match="no GeoJSON"):
        score(benchmark(tmp_path), tmp_path / "a.geojson")


def test_no_flights(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no flights"):
        score(tmp_path, written(tmp_path))
