"""Scenario files: what they say is what comes out, and every mistake is named."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

import sitl
from mission.errors import SettingsError
from sitl.scenario.schema import parse_scenario, read_scenario

SCENARIOS = Path(sitl.__file__).parent / "scenarios"
PERSON = "[[people]]\ndistance_m = 5.0\nbearing_deg = 30.0\n"


def test_a_name_is_enough() -> None:
    scenario = parse_scenario('name = "empty"')
    assert scenario.people == ()
    assert scenario.camera.intrinsics.fx == pytest.approx(516.5, abs=0.1)
    assert scenario.home.origin.datum == "amsl"


def test_a_walk_is_told_from_the_line_of_sight() -> None:
    scenario = parse_scenario(f'name = "a"\n{PERSON}walk_from_line_of_sight_deg = 90.0\nspeed_m_s = 0.6\n')
    assert scenario.people[0].heading_rad == pytest.approx(math.radians(120.0))


def test_who_has_no_direction_faces_the_drone() -> None:
    assert parse_scenario(f'name = "a"\n{PERSON}').people[0].heading_rad == pytest.approx(math.radians(210.0))


def test_focal_lengths_replace_the_field_of_view() -> None:
    scenario = parse_scenario('name = "a"\n[camera]\nfx = 500.0\nfy = 501.0\ncx = 318.0\ncy = 242.0\n')
    camera = scenario.camera.intrinsics
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (500.0, 501.0, 318.0, 242.0)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("name = \n", "line 1"),
        ("seed = 1", "name"),
        ('name = "a"\ncolour = "red"', "colour"),
        ('name = "a b"', "name"),
        ('name = "a"\n[camera]\nfps = 0', "camera.fps"),
        ('name = "a"\n[camera]\nwidth_px = 641', "camera.width_px"),
        ('name = "a"\n[camera]\nfx = 500.0', "all of fx, fy, cx and cy"),
        ('name = "a"\n[camera]\nhorizontal_fov_deg = nan', "camera.horizontal_fov_deg"),
        (f'name = "a"\n{PERSON}height_m = 2.2', "people.0.height_m"),
        (f'name = "a"\n{PERSON}at = "start"\nwhen = "drone-moves"', "not both"),
        (f'name = "a"\n{PERSON}walk_heading_deg = 1\nwalk_from_line_of_sight_deg = 2', "not both"),
        (f'name = "a"\n{PERSON}clothes = {{ shirt = "red" }}', "people.0.clothes.shirt"),
        ('name = "a"\n[[obstacles]]\nkind = "cow"\ndistance_m = 3.0\nbearing_deg = 0.0', "obstacles.0.kind"),
    ],
)
def test_a_mistake_is_named(text: str, named: str) -> None:
    with pytest.raises(SettingsError, match=named):
        parse_scenario(text)


def test_several_mistakes_are_all_named() -> None:
    with pytest.raises(SettingsError, match=r"seed.*camera\.fps"):
        parse_scenario('name = "a"\nseed = -1\n[camera]\nfps = 0')


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"nowhere\.toml"):
        read_scenario(tmp_path / "nowhere.toml")


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SettingsError, match=r"binary\.toml"):
        read_scenario(path)


@pytest.mark.parametrize("name", ["demo", "two-people", "occlusion", "nobody", "far"])
def test_the_scenarios_that_come_along_are_sound(name: str) -> None:
    assert read_scenario(SCENARIOS / f"{name}.toml").name == name


def test_the_grid_is_four_walks_at_four_distances() -> None:
    grid = [read_scenario(path) for path in (SCENARIOS / "paper").glob("*.toml")]
    assert len({scenario.name for scenario in grid}) == 16
    assert sorted({scenario.people[0].distance_m for scenario in grid}) == [2.75, 5.5, 7.25, 9.0]
    assert sum(scenario.people[0].speed_m_s == 0.0 for scenario in grid) == 4
    assert {scenario.people[0].speed_m_s for scenario in grid} == {0.0, 0.6}


def test_unknown_autopilots_are_of_mavlink_only() -> None:
    assert parse_scenario('name = "a"\n[autopilot]\nnoise = "wide"').autopilot.noise == "wide"
    with pytest.raises(SettingsError, match="wide"):
        parse_scenario('name = "a"\n[autopilot]\nnoise = "wide"\n[vehicle]\nkind = "ardrone"')
