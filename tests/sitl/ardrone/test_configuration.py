"""The multi-configuration rule of the Developer Guide's chapter 8."""

from __future__ import annotations

import pytest

from sitl.ardrone.configuration import Configuration, picture_height

IDS = ("d2e081a3", "be27e2e4", "d87f7e0c")


def switched() -> Configuration:
    """A configuration whose client has set all three identifiers, as the guide's example does."""
    configuration = Configuration()
    for key, name in zip(("custom:session_id", "custom:profile_id", "custom:application_id"), IDS, strict=True):
        assert configuration.set(key, name)
    return configuration


def test_without_identifiers_any_client_may_change_all() -> None:
    configuration = Configuration()
    assert configuration.set("control:euler_angle_max", "0.15")
    assert configuration.number("control:euler_angle_max") == pytest.approx(0.15)


def test_with_identifiers_only_announced_changes_count() -> None:
    configuration = switched()
    assert not configuration.set("control:euler_angle_max", "0.15")
    configuration.announce("00000000", "00000000", "00000000")
    assert not configuration.set("control:euler_angle_max", "0.15")
    configuration.announce(*IDS)
    assert configuration.set("control:euler_angle_max", "0.15")
    # An announcement is good for one command.
    assert not configuration.set("control:euler_angle_max", "0.2")


def test_common_keys_need_no_identifiers() -> None:
    assert switched().set("general:navdata_demo", "TRUE")


def test_a_new_session_starts_with_the_defaults_and_an_old_one_is_remembered() -> None:
    configuration = Configuration()
    configuration.set("video:video_codec", "131")
    configuration.set("custom:session_id", "aaaaaaaa")
    assert configuration.number("video:video_codec") == 129
    configuration.set("custom:session_id", "00000000")
    assert configuration.number("video:video_codec") == 131


def test_a_session_can_be_forgotten() -> None:
    configuration = switched()
    assert configuration.set("custom:session_id", "-all")
    assert configuration.ids == ("00000000", IDS[1], IDS[2])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("control:euler_angle_max", "3"),
        ("control:euler_angle_max", "nan"),
        ("control:euler_angle_max", "much"),
        ("control:control_vz_max", "99999"),
        ("general:num_version_soft", "9.9.9"),
        ("general:no_such_key", "1"),
        ("general:navdata_demo", "PERHAPS"),
        ("custom:session_id", "not hex!"),
    ],
)
def test_nonsense_is_refused(key: str, value: str) -> None:
    configuration = Configuration()
    before = configuration.listing()
    assert not configuration.set(key, value)
    assert configuration.listing() == before


def test_listeners_hear_of_changes_and_of_what_a_new_session_changes() -> None:
    configuration = Configuration()
    heard: list[str] = []
    configuration.changed.append(heard.append)
    configuration.set("video:bitrate", "2000")
    assert heard == ["video:bitrate"]
    configuration.set("custom:session_id", "aaaaaaaa")
    assert "video:video_codec" in heard


def test_codecs_choose_the_picture() -> None:
    assert picture_height(0x83) == 720
    assert picture_height(0x81) == 360
