"""Setting the configuration: each key acknowledged before the next, none waited for without end."""

from __future__ import annotations

from mission.vehicle.ardrone.config import PATIENCE_S, ConfigDialogue, ConfigSession, FlightConfig
from mission.vehicle.ardrone.navdata import DroneState, Navdata

SESSION = ConfigSession("aaaaaaaa", "bbbbbbbb", "cccccccc")
ACK = int(DroneState.COMMAND_ACK)
TICK_S = 0.03


class Drone:
    """Acknowledges as the SDK says: the bit goes up with a CONFIG that has its CONFIG_IDS, and down with CTRL 5."""

    def __init__(self, dialogue: ConfigDialogue, deaf_to: str = "", loses_every: int = 0) -> None:
        self.dialogue = dialogue
        self.state = 0
        self.now_s = 10.0
        self.kept: list[tuple[str, str]] = []
        self._deaf_to = deaf_to
        self._loses_every = loses_every
        self._sent = 0

    def run(self, seconds: float) -> None:
        until = self.now_s + seconds
        while self.now_s < until and not self.dialogue.done:
            self.now_s += TICK_S
            commands = self.dialogue.step(Navdata(self.state, 1), self.now_s)
            if not commands:
                continue
            self._sent += 1
            if self._loses_every and self._sent % self._loses_every == 0:
                continue
            names = [c.name for c in commands]
            if names == ["CTRL"]:
                assert commands[0].arguments == ("5", "0")
                self.state &= ~ACK
            else:
                assert names == ["CONFIG_IDS", "CONFIG"]
                assert commands[0].arguments == ('"aaaaaaaa"', '"bbbbbbbb"', '"cccccccc"')
                key, value = (text.strip('"') for text in commands[1].arguments)
                if key != self._deaf_to:
                    assert not self.state & ACK, "a key was sent before the last acknowledgement was cleared"
                    self.kept.append((key, value))
                    self.state |= ACK


def test_the_session_first_then_every_key_once() -> None:
    drone = Drone(ConfigDialogue(SESSION, FlightConfig().entries()))
    drone.run(10.0)
    assert drone.dialogue.done
    assert [key for key, _ in drone.kept[:3]] == ["custom:session_id", "custom:profile_id", "custom:application_id"]
    assert drone.kept[3:] == FlightConfig().entries()
    assert drone.dialogue.given_up == []
    assert drone.now_s < 13.0


def test_lost_commands_are_sent_again() -> None:
    drone = Drone(ConfigDialogue(SESSION, FlightConfig().entries()), loses_every=3)
    drone.run(30.0)
    assert drone.dialogue.done
    assert {key for key, _ in FlightConfig().entries()} <= {key for key, _ in drone.kept}
    assert drone.dialogue.given_up == []


def test_a_key_that_is_never_acknowledged_is_given_up_and_named() -> None:
    drone = Drone(ConfigDialogue(SESSION, FlightConfig().entries()), deaf_to="video:max_bitrate")
    drone.run(PATIENCE_S + 10.0)
    assert drone.dialogue.done
    assert drone.dialogue.given_up == ["video:max_bitrate"]
    assert ("video:video_codec", "129") in drone.kept


def test_an_old_acknowledgement_is_not_taken_for_ours() -> None:
    drone = Drone(ConfigDialogue(SESSION, []))
    drone.state = ACK
    drone.dialogue.step(Navdata(ACK, 1), drone.now_s)
    assert drone.kept == []
    drone.run(5.0)
    assert len(drone.kept) == 3


def test_the_values_are_in_the_units_of_the_drone() -> None:
    keys = dict(FlightConfig(euler_angle_max_rad=0.2, control_vz_max_m_s=0.7, altitude_max_m=3.0).entries())
    assert keys["control:euler_angle_max"] == "0.2000"
    assert keys["control:control_vz_max"] == "700"
    assert keys["control:altitude_max"] == "3000"
    assert keys["general:navdata_demo"] == "FALSE"
    assert keys["general:navdata_options"] == str(1 | 2 | 1 << 10 | 1 << 22 | 1 << 26 | 1 << 27)
