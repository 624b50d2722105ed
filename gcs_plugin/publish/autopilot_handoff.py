"""The answer given back to the autopilot: a region of interest, and a waypoint at a stand-off.

Each is done automatically, on the operator's request or never, as the settings say.
"""

from __future__ import annotations

from typing import Final, Literal

from gcs_plugin.geotags.log import Geotag
from gcs_plugin.publish.messages import Link, set_region_of_interest
from gcs_plugin.publish.mission_items import append_item, standoff_waypoint
from gcs_plugin.publish.mission_protocol import MissionProtocol
from mission.errors import AnswerError
from mission.settings import AnswerSettings

What = Literal["roi", "waypoint"]
WORDS: Final[dict[What, str]] = {"roi": "region of interest", "waypoint": "waypoint"}


class AutopilotHandoff:
    """Gives geotags to one aircraft's autopilot.

    Args:
        link: to its autopilot.
        settings: what is done when, and the stand-off.
    """

    def __init__(self, link: Link, settings: AnswerSettings) -> None:
        self._link = link
        self._settings = settings

    def automatic(self, what: What) -> bool:
        """Whether it is done without being asked for."""
        return self._mode(what) == "automatic"

    def requested(self, what: What, geotag: Geotag | None) -> str:
        """The operator asks for it. Returns what was done, in the operator's words.

        Args:
            what: is wanted.
            geotag: the last answer; None when there is none.

        Raises:
            AnswerError: the settings forbid it, there is no answer yet, or it failed.
        """
        if self._mode(what) == "never":
            raise AnswerError(
                f"The settings forbid the {WORDS[what]}", f'Set answer.{what} to "on-request" or "automatic".'
            )
        if geotag is None:
            raise AnswerError("There is no answer yet", "Locate the target first.")
        return self.do(what, geotag)

    def do(self, what: What, geotag: Geotag) -> str:
        """Do it, whatever the settings say. Returns what was done, in the operator's words.

        Raises:
            AnswerError: the autopilot refused or did not answer, or the altitude cannot be converted.
        """
        return self._point_at(geotag) if what == "roi" else self._append_waypoint(geotag)

    def _mode(self, what: What) -> str:
        return self._settings.roi if what == "roi" else self._settings.waypoint

    def _point_at(self, geotag: Geotag) -> str:
        set_region_of_interest(self._link, geotag.place, geoid_separation_m=geotag.geoid_separation_m)
        return "set"

    def _append_waypoint(self, geotag: Geotag) -> str:
        if geotag.drone is None:
            raise AnswerError(
                "It is not known where the aircraft was, so there is no side to stand off to",
                "Set the waypoint by hand.",
            )
        item = standoff_waypoint(
            geotag.place,
            geotag.drone,
            distance_m=self._settings.standoff_m,
            geoid_separation_m=geotag.geoid_separation_m,
        )
        appended = append_item(MissionProtocol(self._link), item)
        return f"appended to the mission as item {appended.number}{appended.warning}"
