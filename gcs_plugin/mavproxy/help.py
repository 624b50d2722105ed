"""What `locate help` prints."""

from __future__ import annotations

from typing import Final

WORDS: Final = (
    "box",
    "point",
    "next",
    "abort",
    "status",
    "list",
    "roi",
    "waypoint",
    "export",
    "set",
    "start",
    "stop",
    "help",
)
HELP: Final = """\
locate                   fly the pattern: the tracked target, else the person nearest the middle of the picture
locate box L,T,W,H       locate the person in this box: shares of the picture (0 to 1), or pixels of the video
locate point X,Y         locate the person at this point
locate next              choose the next person in view; does not fly
locate abort             end what runs; the aircraft holds
locate status            what runs, what is tracked, the last target
locate list              the geotags in the log
locate roi [NUMBER]      point the aircraft's camera at a target of the log, else at the newest
locate waypoint          append a waypoint at a stand-off from the last target to the plan that is there
locate export FILE       the log as .geojson, .kml or .csv
locate set [NAME [VALUE]]  settings of this module, and of sidestep serve by its parameter names
locate start | stop      start or end sidestep serve"""
