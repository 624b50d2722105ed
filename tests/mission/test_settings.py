from dataclasses import fields
from pathlib import Path

import pytest

from gcs_plugin.cli.settings import settings_toml
from mission.errors import SettingsError
from mission.records import TargetPrior
from mission.settings import MissionSettings, PriorSettings, read_settings


def written(folder: Path, text: str) -> Path:
    path = folder / "sidestep.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_no_file_gives_the_defaults() -> None:
    assert read_settings(None) == MissionSettings()


def test_an_empty_file_gives_the_defaults(tmp_path: Path) -> None:
    assert read_settings(written(tmp_path, "")) == MissionSettings()


def test_values_are_taken(tmp_path: Path) -> None:
    settings = read_settings(written(tmp_path, '[pattern]\nkind = "s"\nlength_m = 4.5\n'))
    assert settings.pattern.kind == "s"
    assert settings.pattern.length_m == 4.5


def test_paths_are_relative_to_the_file(tmp_path: Path) -> None:
    settings = read_settings(written(tmp_path, '[camera]\nfile = "camera.toml"\n[answer]\nfolder = "out"\n'))
    assert settings.camera.file == tmp_path / "camera.toml"
    assert settings.answer.folder == tmp_path / "out"


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[pattern]\nlength_m = 300.0\n", "pattern.length_m"),
        ("[pattern]\nlenght_m = 3.0\n", "pattern.lenght_m"),
        ('[limits]\nmax_speed_m_s = "fast"\n', "limits.max_speed_m_s"),
        ('[limits]\nmax_speed_m_s = "3"\n', "max_speed_m_s: a text stands where a number is wanted"),
        ("[link]\nmin_battery = true\n", "min_battery: true or false stands"),
        ("[limits]\nmax_height_m = nan\n", "limits.max_height_m"),
        ("[video]\nlatency_s = inf\n", "video.latency_s"),
        ('[detect]\ndetector = "magic"\n', "detect.detector"),
        ("[prior]\nground_above_take_off_m = 2000.0\nground_sigma_m = 1.0\n", "prior.ground_above_take_off_m"),
        ("[prior]\nground_above_take_off_m = 1.0\nground_sigma_m = 0.0\n", "prior.ground_sigma_m"),
        ("[prior]\nheight_m = 0.0\nheight_sigma_m = 0.1\n", "prior.height_m"),
        ("[prior]\nheight_m = true\nheight_sigma_m = 0.1\n", "prior.height_m"),
        ("[prior]\ncentre_above_ground_m = -0.1\n", "prior.centre_above_ground_m"),
        ("[prior]\nground_above_take_off_m = 1.0\n", "ground_sigma_m is missing"),
        ("[prior]\nground_sigma_m = 1.0\n", "ground_above_take_off_m is missing"),
        ("[prior]\nheight_m = 1.8\n", "prior: height_m and height_sigma_m go together"),
        ("[prior]\nheight_sigma_m = 0.1\n", "height_m is missing"),
        ("[prior]\nheight_m = 1.8\nheight_sigma_m = 1.8\n", "leave both out"),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(SettingsError, match=named):
        read_settings(written(tmp_path, text))


def test_all_wrong_values_are_named_at_once(tmp_path: Path) -> None:
    with pytest.raises(SettingsError) as raised:
        read_settings(written(tmp_path, "repeat = 0\n[pattern]\nlength_m = -1.0\n"))
    assert "repeat" in str(raised.value)
    assert "pattern.length_m" in str(raised.value)


def test_a_file_that_is_not_toml_says_where(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="line 1"):
        read_settings(written(tmp_path, "pattern = = 3"))


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sidestep.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SettingsError, match="not TOML"):
        read_settings(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"none\.toml"):
        read_settings(tmp_path / "none.toml")


def test_the_prior_s_defaults_are_the_format_s_but_for_people_who_were_detected() -> None:
    assert MissionSettings().prior.prior() == TargetPrior(class_height="use")
    assert MissionSettings().prior.prior(12.0) == TargetPrior(class_height="use")


def test_every_field_of_the_prior_can_be_set(tmp_path: Path) -> None:
    text = """
[prior]
speed_sigma_m_s = 2.0
vertical_speed_sigma_m_s = 0.2
acceleration_psd_m2_s3 = 0.1
ground_above_take_off_m = -3.0
ground_sigma_m = 0.5
centre_above_ground_m = 0.9
height_m = 1.8
height_sigma_m = 0.06
class_height = "compare"
"""
    prior = read_settings(written(tmp_path, text)).prior.prior(take_off_up_m=-20.0)
    assert prior == TargetPrior(2.0, 0.2, 0.1, -23.0, 0.5, 0.9, 1.8, 0.06, "compare")
    plain = TargetPrior()
    assert all(getattr(prior, field.name) != getattr(plain, field.name) for field in fields(TargetPrior))


def test_a_ground_height_without_a_take_off_point_is_refused_not_ignored(tmp_path: Path) -> None:
    settings = read_settings(written(tmp_path, "[prior]\nground_above_take_off_m = 0.0\nground_sigma_m = 0.3\n"))
    with pytest.raises(SettingsError, match="before take-off"):
        settings.prior.prior()
    assert settings.prior.prior(-4.0).ground_up_m == -4.0


def test_the_printed_settings_name_the_whole_prior_and_are_good_settings(tmp_path: Path) -> None:
    lines = list(settings_toml(MissionSettings))
    text = "\n".join(lines)
    read = read_settings(written(tmp_path, text))
    assert read.answer.folder == tmp_path / "flights"  # a folder that a file names is relative to it
    assert read.model_copy(update={"answer": MissionSettings().answer}) == MissionSettings()
    for name in PriorSettings.model_fields:
        assert any(line.lstrip("# ").startswith(f"{name} =") for line in lines), name
    (line,) = [line for line in lines if "ground_above_take_off_m =" in line]
    assert "at least -1000" in line
    assert "take-off point" in line


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("[pattern]\nlenght_m = 3.0\n", "pattern.lenght_m: there is no such setting; did you mean pattern.length_m?"),
        ("length_m = 3.0\n", "did you mean pattern.length_m?"),
        ("[patern]\nlength_m = 3.0\n", "did you mean pattern?"),
        ("[pattern]\nmax_speed_m_s = 3.0\n", "did you mean limits.max_speed_m_s?"),
        ("[zebra]\nx = 3.0\n", "zebra: there is no such setting;"),
    ],
)
def test_a_name_that_no_setting_has_is_answered_with_the_nearest(tmp_path: Path, text: str, meant: str) -> None:
    with pytest.raises(SettingsError) as caught:
        read_settings(written(tmp_path, text))
    assert (f"{caught.value};").replace(". `", "; `").count(meant) == 1


@pytest.mark.parametrize("number", ["1" + 400 * "0", "-1" + 5000 * "0", "[" * 100_000, "1e400", "nan"])
def test_an_absurd_number_is_told(tmp_path: Path, number: str) -> None:
    with pytest.raises(SettingsError) as caught:
        read_settings(written(tmp_path, f"[pattern]\nlength_m = {number}\n"))
    assert len(str(caught.value)) < 500
