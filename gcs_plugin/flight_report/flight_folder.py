"""A flight's own folder: what was seen, what happened, the pictures and the answer.

flights/20261122T120006Z-3f9a1c/
    sightings.jsonl     what the estimate was made from (`sidestep estimate` computes it again)
    as-reported.jsonl   the same with the poses that the aircraft reported, where the background's were used
    events.jsonl        what happened, one line each, on the disk as it happens
    plan.png            the plan view
    steady.png          the reported attitude against the background's
    contact-sheet.jpg   the frames with the target's box and the background's points
    answer.json         the geotag, or why there is none
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Self

from gcs_plugin.durable import LineFile, make_folder, sync, unwritable, write_whole
from gcs_plugin.flight_report.outcome import Outcome
from gcs_plugin.geotags.geotag import Geotag, as_json
from mission.errors import SidestepError
from mission.estimate.sightings_file import flight_lines
from mission.records import FlightSightings

AS_REPORTED = "as-reported.jsonl"


def _short_id() -> str:
    return secrets.token_hex(3)


class FlightFolder:
    """Makes the folder of a flight and writes its files, each whole and durable.

    Args:
        root: the folder of all flights; made if it is not there.
        started: when the flight started; aware.
        new_id: tells flights of the same second apart.

    Raises:
        AnswerError: the folder cannot be made.
        ValueError: the time has no time zone.
    """

    def __init__(self, root: Path, started: datetime, *, new_id: Callable[[], str] = _short_id) -> None:
        if started.tzinfo is None:
            raise ValueError("started must have a time zone")
        second = started.astimezone(UTC).strftime("%Y%m%dT%H%M%SZ")
        try:
            make_folder(root)
            self.path = _new_folder(root, lambda: f"{second}-{new_id()}")
            sync(root)
        except OSError as error:
            raise unwritable(root, error) from error
        self._events = LineFile(self.path / "events.jsonl")

    @property
    def id(self) -> str:
        """The flight's name: the folder's."""
        return self.path.name

    @property
    def sightings_path(self) -> Path:
        """Where the sightings are, or will be."""
        return self.path / "sightings.jsonl"

    def event(self, when: datetime, kind: str, text: str) -> None:
        """Note what happened; on the disk when this returns. Any thread may call it.

        Raises:
            AnswerError: the disk is full or refuses; what was noted before is there.
        """
        stamp = when.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        self._events.add(json.dumps({"time_utc": stamp, "kind": kind, "text": text}))

    def write_sightings(self, flights: Sequence[FlightSightings]) -> None:
        """Keep what the estimates are made from, one flight for each sidestep.

        Raises:
            AnswerError: it cannot be written.
        """
        write_whole(
            self.sightings_path,
            "".join(f"{line}\n" for flight in flights for line in flight_lines(flight)).encode("utf-8"),
        )

    def write_as_reported(self, flight: FlightSightings) -> None:
        """Keep the sightings with the poses that the aircraft reported: what the answer would have been made from.

        Raises:
            AnswerError: it cannot be written.
        """
        write_whole(self.path / AS_REPORTED, "".join(f"{line}\n" for line in flight_lines(flight)).encode("utf-8"))

    def write_plan_view(self, png: bytes) -> None:
        """Keep the plan view.

        Raises:
            AnswerError: it cannot be written.
        """
        write_whole(self.path / "plan.png", png)

    def write_steady_view(self, png: bytes) -> None:
        """Keep the reported attitude against the background's.

        Raises:
            AnswerError: it cannot be written.
        """
        write_whole(self.path / "steady.png", png)

    def write_contact_sheet(self, jpeg: bytes) -> None:
        """Keep the contact sheet.

        Raises:
            AnswerError: it cannot be written.
        """
        write_whole(self.path / "contact-sheet.jpg", jpeg)

    def write_answer(self, geotag: Geotag, outcome: Outcome) -> None:
        """Keep the answer, and what became of it.

        Raises:
            AnswerError: it cannot be written.
        """
        self._write_json({**as_json(geotag), "outcome": asdict(outcome)})

    def write_no_answer(self, error: SidestepError) -> None:
        """Keep why there is no answer, and what would help.

        Raises:
            AnswerError: it cannot be written.
        """
        self._write_json({"error": error.cause, "remedy": error.remedy})

    def close(self) -> None:
        """No more events. Safe to call twice."""
        self._events.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write_json(self, record: dict[str, object]) -> None:
        text = json.dumps(record, indent=2, allow_nan=False, ensure_ascii=False)
        write_whole(self.path / "answer.json", f"{text}\n".encode())


def _new_folder(root: Path, name: Callable[[], str]) -> Path:
    """A folder that nobody has."""
    for _ in range(100):
        path = root / name()
        try:
            path.mkdir()
        except FileExistsError:
            continue
        return path
    raise FileExistsError(f"no free name in {root}")
