"""Many rendered flights, one after the other, each answered as the mission would, kept as they come."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from mission.bundle import BundleSolution
from mission.detect.auto import AutoDetector
from mission.detect.nanodet import NanoDet
from mission.errors import AnswerError, SidestepError
from mission.estimate.sightings_file import flight_lines
from mission.records import FlightSightings
from mission.track import Tracker
from sitl.evaluation.rendered.case import Case
from sitl.evaluation.rendered.flight import RenderedFlight
from sitl.evaluation.rendered.replay import Replay, replay
from sitl.evaluation.rendered.result_row import Poses, ResultRow, append, read, rewrite
from sitl.evaluation.rendered.score import estimate, rotation_error, score, sightings

TABLE = "flights.csv"
SIGHTINGS = "sightings.jsonl"
WAYS: tuple[Poses, ...] = ("reported", "steadied")


class Campaign:
    """Flies cases and keeps what comes of them in a folder.

    Args:
        folder: made if it is not there; what is in it already is not flown again.

    Raises:
        AnswerError: the folder cannot be used.
    """

    def __init__(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise AnswerError(f"cannot make {folder}: {error.strerror}", "Name another folder.") from error
        self._table, self._sightings = folder / TABLE, folder / SIGHTINGS
        kept = read(self._table)
        whole = {o.number for o in kept if sum(other.number == o.number for other in kept) == len(WAYS)}
        self.outcomes = [o for o in kept if o.number in whole]
        """All that was flown so far."""
        rewrite(self._table, self.outcomes)
        self._network = NanoDet()
        self._detector = AutoDetector()

    def run(self, cases: Sequence[Case]) -> Iterator[list[ResultRow]]:
        """Fly the cases that were not flown yet; the lines of each are on the disk when they are yielded.

        Raises:
            AnswerError: the disk refuses, or the folder holds another run's flights.
            VideoError: there is no renderer or no codec.
        """
        flown = {o.number: o for o in self.outcomes}
        for number, case in enumerate(cases):
            if number in flown:
                if flown[number].seed != case.seed or flown[number].scene != case.scene:
                    raise AnswerError(f"{self._table} holds flights of another run", "Name an empty folder.")
                continue
            outcomes, found = self._fly(number, case)
            append(self._table, outcomes)
            self._keep(found)
            self.outcomes.extend(outcomes)
            yield outcomes

    def _fly(self, number: int, case: Case) -> tuple[list[ResultRow], list[FlightSightings]]:
        flight = RenderedFlight(case)
        try:
            followed = replay(flight, self._detector, Tracker(self._network))
        except SidestepError as error:
            return [_line(number, case, way, said=str(error)) for way in WAYS], []
        answers = [_answered(number, flight, followed, way) for way in WAYS]
        return [outcome for outcome, _ in answers], [found for _, found in answers if found is not None]

    def _keep(self, found: Sequence[FlightSightings]) -> None:
        try:
            with self._sightings.open("a", encoding="utf-8") as file:
                file.writelines(f"{line}\n" for flight in found for line in flight_lines(flight))
        except OSError as error:
            raise AnswerError(f"cannot write {self._sightings}: {error.strerror}", "Name another folder.") from error


def _answered(
    number: int, flight: RenderedFlight, followed: Replay, way: Poses
) -> tuple[ResultRow, FlightSightings | None]:
    offset_s = followed.offset_s
    steadied: BundleSolution | None = None
    begun_s = time.process_time()
    if way == "steadied":
        steadied = followed.record.steadied(flight.pose_at, offset_s, followed.pose_noise(flight.noise))
    steady_ms = followed.steady_ms + 1e3 * (time.process_time() - begun_s) / max(1, len(followed.tracked))
    said = "" if steadied is None else steadied.note()
    turned = rotation_error(flight, followed, flight.pose_at, offset_s, steadied)
    begun_s = time.process_time()
    try:
        found = sightings(flight, followed, flight.pose_at, offset_s, steadied)
        answer = estimate(found)
    except SidestepError as error:
        return _line(number, flight.case, way, said=str(error), tracked_share=followed.share), None
    solve_ms = 1e3 * (time.process_time() - begun_s)
    errors = score(flight, found, answer, offset_s - flight.case.offset_s)
    line = _line(
        number,
        flight.case,
        way,
        tracked_share=followed.share,
        said=said,
        depth_error=errors.depth_error,
        position_error_m=errors.position_error_m,
        across_error_m=errors.bearing_error_m,
        along_error_m=errors.range_error_m,
        sigma_m=errors.sigma_m,
        nees=errors.nees,
        heading_error_deg=math.degrees(turned.heading_rad),
        tilt_error_deg=math.degrees(turned.tilt_rad),
        offset_error_ms=1e3 * (offset_s - flight.case.offset_s),
        render_ms=followed.render_ms,
        track_ms=followed.track_ms,
        steady_ms=math.nan if steadied is None else steady_ms,
        solve_ms=solve_ms,
    )
    return line, replace(found, id=f"{found.id}-{way}")


def _line(
    number: int, case: Case, way: Poses, *, tracked_share: float = 0.0, said: str = "", **figures: float
) -> ResultRow:
    return ResultRow(
        number=number,
        seed=case.seed,
        noise=case.noise,
        scene=case.scene,
        distance_m=case.distance_m,
        walk_deg=math.nan if case.walk_deg is None else case.walk_deg,
        speed_m_s=case.speed_m_s,
        poses=way,
        tracked_share=tracked_share,
        said=said,
        **figures,
    )
