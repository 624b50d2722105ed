"""Rendered flights as files: a video, logs of each kind, and the truth apart from them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from mission.camera import write_camera
from mission.geodesy import enu_to_geodetic
from mission.pose.buffer import Pose
from mission.records import Image, Vector
from sitl.evaluation.rendered.case import Case
from sitl.evaluation.rendered.flight import RenderedFlight
from sitl.recorded.klv_stream import write_transport_stream
from sitl.recorded.log_files import write_csv, write_dataflash, write_dji_srt, write_tlog, write_ulog
from sitl.recorded.reports import Reports
from sitl.recorded.video_file import write_video

LogName = Literal["tlog", "dataflash", "ulog", "dji-srt", "misb-klv", "csv"]
BOOT_S = 100.0
"""What the autopilot's clock says when the pattern begins."""
_BEFORE_S = 2.5
_SEPARATION_M = 40.0


@dataclass(frozen=True, slots=True)
class Recorded:
    """Where a flight was written."""

    video: Path
    log: Path
    truth: Path
    offset_s: float
    """Video time less log time."""


def record(case: Case, folder: Path, log: LogName, name: str = "flight", rate_hz: float = 50.0) -> Recorded:
    """Fly a case and write what a camera and an autopilot would have kept of it.

    Args:
        case: what is flown, and by how much the video is late.
        folder: must exist.
        log: which kind.
        name: of the files, without suffix.
        rate_hz: of the reports, at most.

    Raises:
        VideoError: there is no software renderer.
    """
    flight = RenderedFlight(case)
    exposed: list[float] = []

    def pictures() -> Iterator[Image]:
        for moment in flight.moments():
            exposed.append(moment.capture_s)
            yield moment.frame.image

    fps = flight.scenario.camera.fps
    video = folder / f"{name}.mp4"
    write_video(video, pictures(), fps)
    reports = reports_of(flight, exposed[0] - _BEFORE_S, exposed[-1] + 0.9).thinned(rate_hz)
    path = folder / name
    first = exposed[0] + BOOT_S
    match log:
        case "tlog":
            path = path.with_suffix(".tlog")
            write_tlog(path, reports)
        case "dataflash":
            path = path.with_suffix(".bin")
            write_dataflash(path, reports)
        case "ulog":
            path = path.with_suffix(".ulg")
            write_ulog(path, reports)
        case "csv":
            path = path.with_suffix(".csv")
            write_csv(path, reports)
        case "dji-srt":
            path, first = path.with_suffix(".SRT"), 0.0
            frames = reports.at(np.array(exposed) + BOOT_S)
            write_dji_srt(path, frames, [t - exposed[0] for t in exposed])
        case "misb-klv":
            path, first = path.with_suffix(".ts"), 0.0
            write_transport_stream(path, video, reports.at(np.array(exposed) + BOOT_S))
            video.unlink()
            video = path
    write_camera(folder / f"{name}.camera.toml", flight.camera)
    truth = folder / f"{name}.truth.json"
    _write_truth(truth, flight, exposed)
    return Recorded(video, path, truth, -first)


def reports_of(flight: RenderedFlight, from_s: float, to_s: float) -> Reports:
    """What the autopilot reported, at 50 Hz."""
    times = np.arange(from_s, to_s, 0.02)
    known = [(t_s, pose) for t_s in times.tolist() if (pose := flight.pose_at(t_s)) is not None]
    places = [enu_to_geodetic(pose.position_enu_m, flight.origin) for _, pose in known]
    separation = _SEPARATION_M if flight.origin.datum == "ellipsoid" else 0.0
    geodetic = np.array([(place.lat_deg, place.lon_deg, place.alt_m - separation) for place in places])
    return Reports(
        np.array([t_s for t_s, _ in known]) + BOOT_S,
        geodetic,
        np.array([pose.velocity_enu_m_s for _, pose in known]),
        np.array([euler(pose) for _, pose in known]),
        np.array([pose.position_enu_m[2] for _, pose in known]),
        tilt_down_rad=math.radians(flight.scenario.camera.tilt_down_deg),
        accuracy_m=max(0.05, flight.noise.position_walk_m_per_sqrt_s / 0.1),
    )


def euler(pose: Pose) -> Vector:
    """(3,): roll, pitch, yaw of a body in north-east-down, radians."""
    w, x, y, z = pose.world_from_body_wxyz.tolist()
    # From ENU to NED the same half turn leads back.
    half = math.sqrt(0.5)
    w, x, y, z = half * -(x + y), half * (w + z), half * (w - z), half * (y - x)
    return np.array(
        [
            math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x)))),
            math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        ]
    )


def _write_truth(path: Path, flight: RenderedFlight, exposed: list[float]) -> None:
    """Where the person was at each exposure, and where the camera truly was and was reported to be."""
    rows = []
    for t_s in exposed:
        reported = flight.pose_at(t_s)
        true = flight.true_pose(t_s).position_enu_m
        shift = None if reported is None else (reported.position_enu_m - true).tolist()
        rows.append(
            {"video_s": t_s - exposed[0], "person_enu_m": flight.target(t_s).tolist(), "reported_less_true_m": shift}
        )
    origin = flight.origin
    lens = flight.camera.intrinsics
    path.write_text(
        json.dumps(
            {
                "origin": [origin.lat_deg, origin.lon_deg, origin.alt_m],
                "focal_px": lens.fx,
                "rows": rows,
            }
        ),
        encoding="utf-8",
    )
