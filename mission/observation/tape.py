"""What a flight's procedure was told, kept so that the same procedure can be run again without a flight.

The procedure knows an aircraft as `Drone`, a camera as `VideoSource`, and a clock. What these three answer decides its
answer, so that is what is kept: which pictures it was given and when, the poses that were known when it asked, and what
became of its orders. The pictures themselves are in the recorded video.

FLIGHT/recording/
    video.ts        as received
    telemetry.tlog  as received
    tape.json       pictures, poses, orders, settings
    poses-0.npz     the poses as they were known when all of them were asked for
"""

from __future__ import annotations

import json
import math
import zlib
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from mission.errors import InputError
from mission.pose.buffer import Pose
from mission.pose.history import PoseHistory
from mission.records import Frame, GeodeticOrigin, NoiseModel
from mission.vehicle.drone import Telemetry

FOLDER: Final = "recording"
TAPE: Final = "tape.json"
VIDEO: Final = "video.ts"
TELEMETRY: Final = "telemetry.tlog"
FORMAT, VERSION = "sidestep-tape", 1


@dataclass(slots=True)
class Given:
    """One picture that the procedure was given."""

    index: int
    t_s: float
    clock_s: float
    """Program time at which it was taken up."""
    read_s: list[float] = field(default_factory=list)
    """What the clock said each time it was asked, from then until the next picture was asked for."""


@dataclass(slots=True)
class OrderTape:
    """What became of one order; numbers count the pictures that were given before."""

    kind: str
    started_s: float | None = None
    started_at: int = -1
    ended_s: float | None = None
    state: str = "flying"
    reason: str = ""
    ended_at: int = -1


@dataclass(slots=True, eq=False)
class AllPoses:
    """The poses as they were known at one moment, and what the aircraft then said of itself."""

    history: PoseHistory
    noise: NoiseModel | None = None
    origin: GeodeticOrigin | None = None
    note: str = ""


@dataclass(slots=True, eq=False)
class Tape:
    """All of a flight."""

    flight_id: str
    settings: dict[str, Any]
    camera: str
    """The camera file's text: as it was at the time."""
    choice: dict[str, Any]
    software: str
    begun_clock_s: float = 0.0
    given: list[Given] = field(default_factory=list)
    check: int = 0
    """CRC-32 of the first picture."""
    poses: list[tuple[float, Pose | None]] = field(default_factory=list)
    """By the time asked for, in the order of asking."""
    all_poses: list[AllPoses] = field(default_factory=list)
    orders: list[OrderTape] = field(default_factory=list)
    telemetry: Telemetry | None = None
    origin: GeodeticOrigin | None = None
    video_first_index: int | None = None
    """Number of the frame that the video's first picture is; None where no video was kept."""
    video_note: str = ""

    def give(self, frame: Frame, clock_s: float) -> None:
        """Note a picture."""
        if not self.given:
            self.check = picture_check(frame)
        self.given.append(Given(frame.index, frame.t_s, clock_s))


def picture_check(frame: Frame) -> int:
    """CRC-32 of a picture's pixels."""
    return zlib.crc32(np.ascontiguousarray(frame.image).tobytes())


def write_tape(folder: Path, tape: Tape) -> None:
    """Write a tape into a folder that exists.

    Raises:
        OSError: it cannot be written.
    """
    for number, known in enumerate(tape.all_poses):
        history = known.history
        positions, attitudes = history.poses.rows()
        ready = history.clock.ready
        np.savez_compressed(
            folder / f"poses-{number}.npz",
            positions=positions,
            attitudes=attitudes,
            clock=np.array(history.clock.line if ready else (math.nan,) * 3),
            position_covariance=history.position_covariance_m2,
            attitude_covariance=history.attitude_covariance_rad2,
        )
    told = {
        "format": FORMAT,
        "version": VERSION,
        "flight_id": tape.flight_id,
        "settings": tape.settings,
        "camera": tape.camera,
        "choice": tape.choice,
        "software": tape.software,
        "begun_clock_s": tape.begun_clock_s,
        "given": [[one.index, one.t_s, one.clock_s, one.read_s] for one in tape.given],
        "check": tape.check,
        "poses": [[t_s, None if pose is None else _pose_row(pose)] for t_s, pose in tape.poses],
        "all_poses": [
            {
                "noise": None if known.noise is None else asdict(known.noise),
                "origin": None if known.origin is None else asdict(known.origin),
                "note": known.note,
            }
            for known in tape.all_poses
        ],
        "orders": [asdict(order) for order in tape.orders],
        "telemetry": None if tape.telemetry is None else asdict(tape.telemetry),
        "origin": None if tape.origin is None else asdict(tape.origin),
        "video_first_index": tape.video_first_index,
        "video_note": tape.video_note,
    }
    draft = folder / f".{TAPE}.new"
    draft.write_text(json.dumps(told), encoding="utf-8")
    draft.replace(folder / TAPE)


def read_tape(folder: Path) -> Tape:
    """Read a tape.

    Raises:
        InputError: there is none, or it is damaged.
    """
    path = folder / TAPE
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        if told["format"] != FORMAT or told["version"] != VERSION:
            raise InputError(f"{path} is of another format", "Replay it with the version that flew.")
        known = []
        for number, one in enumerate(told["all_poses"]):
            with np.load(folder / f"poses-{number}.npz", allow_pickle=False) as arrays:
                history = PoseHistory.of_arrays({name: np.asarray(arrays[name]) for name in arrays.files})
            noise = None if one["noise"] is None else NoiseModel(**one["noise"])
            origin = None if one["origin"] is None else GeodeticOrigin(**one["origin"])
            known.append(AllPoses(history, noise, origin, one["note"]))
        return Tape(
            told["flight_id"],
            told["settings"],
            told["camera"],
            told["choice"],
            told["software"],
            told["begun_clock_s"],
            [Given(*row) for row in told["given"]],
            told["check"],
            [(t_s, None if row is None else _pose(t_s, row)) for t_s, row in told["poses"]],
            known,
            [OrderTape(**row) for row in told["orders"]],
            None if told["telemetry"] is None else Telemetry(**told["telemetry"]),
            None if told["origin"] is None else GeodeticOrigin(**told["origin"]),
            told["video_first_index"],
            told["video_note"],
        )
    except OSError as error:
        raise InputError(
            f"{path} cannot be read: {error.strerror or error}",
            "Only flights made with record.video = true replay.",
        ) from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is damaged ({error})", "Use another copy of the flight's folder.") from error


def _pose_row(pose: Pose) -> list[float]:
    parts = (
        *(pose.position_enu_m, pose.velocity_enu_m_s, pose.world_from_body_wxyz),
        *(pose.position_covariance_m2.ravel(), pose.attitude_covariance_rad2.ravel()),
    )
    return [pose.t_s, *np.concatenate(parts).tolist()]


def _pose(_asked_s: float, row: list[float]) -> Pose:
    values = np.array(row[1:])
    return Pose(row[0], values[:3], values[3:6], values[6:10], values[10:19].reshape(3, 3), values[19:28].reshape(3, 3))
