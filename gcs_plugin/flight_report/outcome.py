"""What became of an answer, beside the answer itself in `answer.json`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Outcome:
    """In the operator's words; empty where nothing was done or said."""

    logged: bool = False
    """Whether the geotag is in the log."""
    log: str = ""
    """The file that holds it."""
    not_logged: str = ""
    """Why it is not in the log."""
    region_of_interest: str = ""
    waypoint: str = ""
    ended: str = ""
    """What ended the flight before all was done."""
