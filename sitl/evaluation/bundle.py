"""How true the steadied rotation is over whole patterns, whether or not the tracker keeps its target.

``python -m sitl.evaluation.bundle --scene crowd --noise rough --seed 841`` renders flights, leaves the target's true
box out of the background (in a crowd the tracker may lose it early, and this is not about the tracker), takes the true
time offset with 3 ms of uncertainty, and prints the errors of heading and tilt relative to the first frame.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import get_args

import cv2
import numpy as np
from rich.console import Console

from mission.procedure.flight_record import PICTURES, FlightRecord
from mission.records import Box, Frame
from mission.sighting import roll_of
from mission.timing.flight_offset import offset_uncertain
from mission.track import Track
from sitl.camera.view import PersonView
from sitl.evaluation.rendered import Case, RenderedFlight, drawn_cases
from sitl.evaluation.rendered.case import SceneName
from sitl.evaluation.rendered.replay import Replay, Tracked
from sitl.evaluation.rendered.score import rotation_error

_OFFSET_SIGMA_S = 0.003
_NOWHERE = Box(-100.0, -100.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Rotation:
    """One flight's errors, rms, degrees."""

    reported_heading_deg: float
    heading_deg: float | None
    """Steadied; None where the telemetry was used."""
    tilt_deg: float | None
    said: str


def measured(case: Case) -> Rotation:
    """Fly a case and hold the steadied poses to the truth."""
    flight = RenderedFlight(case)
    record = FlightRecord(case.name, flight.camera, flight.duration_s / PICTURES)
    followed = Replay(record)
    for moment in flight.moments(turn=False):
        frame = moment.frame
        pose = flight.pose_at(frame.t_s - case.offset_s)
        track = _true_track(frame, moment.target)
        record.add(frame, track, 0.0 if pose is None else roll_of(pose, flight.camera))
        followed.tracked.append(Tracked(moment.capture_s, track, moment.target))
    noise = offset_uncertain(flight.noise, _OFFSET_SIGMA_S)
    steadied = record.steadied(flight.pose_at, case.offset_s, noise)
    reported = rotation_error(flight, followed, flight.pose_at, case.offset_s)
    told = math.degrees(reported.heading_rad)
    if steadied.reason is not None:
        return Rotation(told, None, None, steadied.note())
    error = rotation_error(flight, followed, flight.pose_at, case.offset_s, steadied)
    return Rotation(told, math.degrees(error.heading_rad), math.degrees(error.tilt_rad), steadied.note())


def _true_track(frame: Frame, target: PersonView | None) -> Track:
    box = _NOWHERE
    if target is not None:
        (x, y), height = target.pixel, target.height_px
        box = Box(x - 0.2 * height, y - 0.5 * height, 0.4 * height, height)
    return Track(frame.index, frame.t_s, "tracking", box, box.centre_px, 1.0, None, None, 1.0)


def summary(found: Sequence[Rotation]) -> str:
    """One line about many flights."""
    errors = np.array([(r.heading_deg, r.tilt_deg) for r in found if r.heading_deg is not None], dtype=np.float64)
    if len(errors) == 0:
        return f"steadied 0 of {len(found)}"
    heading, tilt = np.sqrt(np.mean(errors**2, axis=0))
    return (
        f"steadied {len(errors)} of {len(found)}: heading {heading:.3f} deg rms (median {np.median(errors[:, 0]):.3f}, "
        f"worst {errors[:, 0].max():.3f}), tilt {tilt:.3f} deg rms"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly, steady, and show the errors."""
    parser = argparse.ArgumentParser(
        prog="python -m sitl.evaluation.bundle", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--seed", type=int, default=1, help="of people, walks, scenery and noise")
    parser.add_argument("--flights", type=int, default=8)
    parser.add_argument("--noise", choices=("good", "rough"), default="rough")
    parser.add_argument("--scene", choices=get_args(SceneName), default="crowd")
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    console, found = Console(), []
    for case in drawn_cases(options.flights, seed=options.seed, noise=options.noise, scene=options.scene):
        one = measured(case)
        found.append(one)
        steadied = "" if one.heading_deg is None else f"{one.heading_deg:.3f} deg steadied, tilt {one.tilt_deg:.3f}; "
        console.print(f"heading {one.reported_heading_deg:.2f} deg reported, {steadied}{one.said}")
    console.print(summary(found))


if __name__ == "__main__":
    main()
