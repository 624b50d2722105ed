"""The sightings file (JSON Lines, `sidestep-sightings` version 1): read flight by flight, write, and the answer's line.

A header line starts a flight, each following line is one sighting of it. Reading streams: one flight is held at a
time, a line may have at most `MAX_LINE_BYTES` and a flight at most `MAX_SIGHTINGS`. What is wrong with a flight
becomes a `FlightProblem` in its place, with file and line, and reading goes on with the next flight.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import BinaryIO

from mission.errors import SightingsFormatError
from mission.estimate.answer_line import error_line, estimate_line
from mission.estimate.sightings_fields import FORMAT, VERSION, FieldError, flight_id, parse_header, parse_sighting
from mission.records import FlightSightings, Sighting, TargetPrior

__all__ = [
    "MAX_LINE_BYTES",
    "MAX_SIGHTINGS",
    "FlightProblem",
    "error_line",
    "estimate_line",
    "flight_lines",
    "read_flights",
    "read_flights_from",
    "write_flight",
]

MAX_SIGHTINGS = 10_000
"""Sightings that one flight may have (five and a half minutes at 30 per second)."""
MAX_LINE_BYTES = 1 << 20
"""Length that one line may have."""

_BROKEN_HEADER = re.compile(r'"format"\s*:')
_BROKEN_ID = re.compile(r'"id"\s*:\s*("(?:[^"\\]|\\.)*")')

_PLAIN_PRIOR = ("speed_sigma_m_s", "vertical_speed_sigma_m_s", "acceleration_psd_m2_s3")


@dataclass(frozen=True, slots=True)
class FlightProblem:
    """A flight of a file that cannot be estimated, and why."""

    id: str | None
    """The flight's id, or None where it could not be read."""
    message: str
    """File, line and what is wrong there."""


def read_flights(path: Path) -> Iterator[FlightSightings | FlightProblem]:
    """The flights of a sightings file, in order, one at a time.

    Args:
        path: the file.

    Yields:
        Each flight, or the problem that stands in its place.

    Raises:
        SightingsFormatError: the file cannot be opened or read, or holds no flight at all.
    """
    try:
        with path.open("rb") as stream:
            yield from read_flights_from(_lines(stream), str(path))
    except OSError as error:
        raise SightingsFormatError(f"{path}: {error.strerror or error}", "Check its name and rights.") from None


def read_flights_from(lines: Iterable[bytes], name: str) -> Iterator[FlightSightings | FlightProblem]:
    """The flights in `lines`, as `read_flights`.

    Args:
        lines: the file's lines, with or without their line ends.
        name: what the file is called in messages.

    Raises:
        SightingsFormatError: there is no header line at all.
    """
    flight: _Flight | None = None
    orphan: str | None = None
    number = 0
    for number, raw in enumerate(lines, start=1):
        where = f"{name}:{number}"
        if flight is not None and flight.closed and b'"format"' not in raw and b'"camera"' not in raw:
            continue  # nothing more is wanted of this flight, so its lines are not even decoded
        record, problem = _decode(raw, first=number == 1)
        if record is None and problem is None:
            continue
        if _starts_flight(record, raw):
            if flight is not None:
                yield flight.finished()
            elif orphan is not None:
                yield FlightProblem(None, orphan)
            flight = _Flight(record, raw, problem, where)
        elif flight is None:
            orphan = orphan or f"{where}: {problem or 'a sighting before the first header line'}"
        else:
            flight.add(record, problem, where)
    if flight is None:
        raise SightingsFormatError(
            orphan or f"{name}: the file is empty",
            f'A sightings file starts with a header line {{"format": "{FORMAT}", "version": {VERSION}, ...}}.',
        )
    yield flight.finished()


def write_flight(path: Path, flight: FlightSightings, *, append: bool = False) -> None:
    """Write a flight as a sightings file; reading it gives the same flight.

    Args:
        path: the file.
        flight: what to write.
        append: add to the file rather than replacing it.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("a" if append else "w", encoding="utf-8", newline="\n") as stream:
        for line in flight_lines(flight):
            stream.write(line + "\n")


def flight_lines(flight: FlightSightings) -> Iterator[str]:
    """The header line and the sighting lines of a flight, without line ends."""
    continues = {} if flight.continues is None else {"continues": flight.continues}
    yield _json(
        {
            "format": FORMAT,
            "version": VERSION,
            "id": flight.id,
            **continues,
            "origin": asdict(flight.origin),
            "camera": asdict(flight.camera),
            "noise": asdict(flight.noise),
            "prior": _prior(flight.prior),
        }
    )
    for sighting in flight.sightings:
        record: dict[str, object] = asdict(sighting)
        for optional in ("pixel_sigma_px", "size_sigma"):
            if record[optional] is None:
                del record[optional]
        yield _json(record)


def _prior(prior: TargetPrior) -> dict[str, float | str]:
    """The prior's fields, without the optional ones that are not given."""
    values = ((field.name, getattr(prior, field.name), field.default) for field in fields(prior))
    return {name: value for name, value, default in values if name in _PLAIN_PRIOR or value != default}


class _Flight:
    """A flight while its lines come in; the first problem closes it."""

    def __init__(self, record: dict[str, object] | None, raw: bytes, problem: str | None, where: str) -> None:
        self._header: FlightSightings | None = None
        self._id: str | None = None
        self._sightings: list[Sighting] = []
        self._problem = f"{where}: {problem}" if problem else None
        self._where = where
        if record is None:
            self._id = _id_of_broken(raw)
            return
        try:
            self._id = flight_id(record)
            self._header = parse_header(record)
        except FieldError as error:
            self._problem = f"{where}: header: {error}"

    @property
    def closed(self) -> bool:
        """Whether no further line can change what this flight gives."""
        return self._problem is not None

    def add(self, record: dict[str, object] | None, problem: str | None, where: str) -> None:
        if self.closed:
            return
        if record is None:
            self._problem = f"{where}: {problem}"
            return
        try:
            sighting = parse_sighting(record)
        except FieldError as error:
            self._problem = f"{where}: {error}"
            return
        if self._sightings and sighting.t_s < self._sightings[-1].t_s:
            self._problem = (
                f'{where}: time goes backwards ("t_s" {sighting.t_s:.10g} after {self._sightings[-1].t_s:.10g})'
            )
        elif len(self._sightings) >= MAX_SIGHTINGS:
            self._problem = f"{where}: the flight has more than {MAX_SIGHTINGS} sightings; thin them out"
            self._sightings.clear()
        else:
            self._sightings.append(sighting)

    def finished(self) -> FlightSightings | FlightProblem:
        if self._problem is not None or self._header is None:
            return FlightProblem(self._id, self._problem or f"{self._where}: header cannot be read")
        return replace(self._header, sightings=tuple(self._sightings))


def _lines(stream: BinaryIO) -> Iterator[bytes]:
    """Lines of at most `MAX_LINE_BYTES`; of a longer one only its start is kept."""
    while raw := stream.readline(MAX_LINE_BYTES + 1):
        yield raw
        rest = raw
        while len(rest) > MAX_LINE_BYTES and not rest.endswith(b"\n"):
            rest = stream.readline(MAX_LINE_BYTES + 1)


def _decode(raw: bytes, *, first: bool) -> tuple[dict[str, object] | None, str | None]:
    """The line's JSON object or what is wrong with it; neither for a blank line."""
    if len(raw) > MAX_LINE_BYTES:
        return None, f"the line is longer than {MAX_LINE_BYTES} bytes"
    try:
        text = raw.decode("utf-8-sig" if first else "utf-8").strip()
    except UnicodeDecodeError:
        return None, "the line is not UTF-8"
    if not text:
        return None, None
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        detail = error.msg if isinstance(error, json.JSONDecodeError) else "a number or a nesting that is too large"
        return None, f"the line is not JSON ({detail})"
    if not isinstance(record, dict):
        return None, "the line is not a JSON object"
    return record, None


def _starts_flight(record: dict[str, object] | None, raw: bytes) -> bool:
    if record is not None:
        return "format" in record or ("t_s" not in record and ("camera" in record or "origin" in record))
    return _BROKEN_HEADER.search(raw[:MAX_LINE_BYTES].decode("utf-8", "replace")) is not None


def _id_of_broken(raw: bytes) -> str | None:
    """The id in a header line that is not JSON, so that its problem can be told apart from others."""
    found = _BROKEN_ID.search(raw[:MAX_LINE_BYTES].decode("utf-8", "replace"))
    if found is None:
        return None
    try:
        value = json.loads(found.group(1))
    except ValueError:
        return None
    return value if isinstance(value, str) else None


def _json(record: dict[str, object]) -> str:
    return json.dumps(record, allow_nan=False)
