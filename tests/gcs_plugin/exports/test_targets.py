"""The log as the module shows it."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_plugin.exports.targets import LOOK_S, Targets
from gcs_plugin.geotags.log import GeotagLog
from mission.errors import AnswerError, SettingsError
from tests.support.sample import geotag


@pytest.fixture
def log(tmp_path: Path) -> GeotagLog:
    return GeotagLog(tmp_path / "geotags.gpkg")


@pytest.fixture
def targets(log: GeotagLog) -> Targets:
    return Targets(lambda: log.path)


def numbers(targets: Targets, count: int, now_s: float) -> list[int]:
    return [each.number for each in targets.newest(count, now_s)]


def test_the_newest_are_shown_and_new_ones_soon_after_they_are_logged(targets: Targets, log: GeotagLog) -> None:
    assert numbers(targets, 2, 0.0) == []
    for i in range(3):
        log.append(geotag(f"tag-{i}"))
    assert numbers(targets, 2, LOOK_S) == [2, 3]
    log.append(geotag("tag-3"))
    assert numbers(targets, 2, 2.5 * LOOK_S) == [3, 4]
    assert numbers(targets, 0, 3.0 * LOOK_S) == []
    assert numbers(targets, 100, 3.0 * LOOK_S) == [1, 2, 3, 4]


def test_a_log_that_went_away_or_is_none_shows_nothing(targets: Targets, log: GeotagLog) -> None:
    log.append(geotag())
    assert numbers(targets, 5, 0.0) == [1]
    log.path.unlink()
    assert numbers(targets, 5, LOOK_S) == []
    log.path.write_bytes(b"no GeoPackage")
    assert numbers(targets, 5, 2.0 * LOOK_S) == []


def test_a_target_is_found_by_its_number_or_as_the_newest(targets: Targets, log: GeotagLog) -> None:
    with pytest.raises(AnswerError, match="There is no geotag log"):
        targets.find(None)
    for i in range(3):
        log.append(geotag(f"tag-{i}"))
    assert targets.find("2").number == 2
    assert targets.find(None).number == 3
    with pytest.raises(SettingsError, match="there is no target 7"):
        targets.find("7")


@pytest.mark.parametrize(
    ("name", "start"),
    [("t.geojson", '{"type": "Fe'), ("t.JSON", '{"type": "Fe'), ("t.kml", "<?xml"), ("t.csv", "number,")],
)
def test_the_export_follows_the_name_of_the_file(
    targets: Targets, log: GeotagLog, tmp_path: Path, name: str, start: str
) -> None:
    log.append(geotag())
    assert targets.export(tmp_path / name) == f"1 geotags written to {tmp_path / name}"
    assert (tmp_path / name).read_text(encoding="utf-8").startswith(start)


def test_a_suffix_without_a_format_is_explained(targets: Targets, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"no format ends in '\.doc'\. Use \.geojson, \.kml, \.kmz, \.csv"):
        targets.export(tmp_path / "t.doc")


def test_the_table_has_a_line_for_each(targets: Targets, log: GeotagLog) -> None:
    log.append(geotag())
    (line,) = targets.table().splitlines()
    assert line.split()[0] == "1"
    assert line.endswith("CE90 0.7 m  0.6 m/s")
