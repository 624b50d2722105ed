from pathlib import Path

import pytest

from mission.errors import SettingsError
from mission.settings import MissionSettings, read_settings


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
        ("[limits]\nmax_height_m = nan\n", "limits.max_height_m"),
        ("[video]\nlatency_s = inf\n", "video.latency_s"),
        ('[detect]\ndetector = "magic"\n', "detect.detector"),
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
