"""Which kind of log a file is, told by what is in it, and its poses."""

from __future__ import annotations

from datetime import tzinfo
from pathlib import Path

from mission.errors import LogError
from mission.logs.dji_srt import AxisOrder, read_dji_srt
from mission.logs.pose_log import LogKind, PoseLog
from mission.logs.tlog import frames

LOG_SUFFIXES = (".tlog", ".bin", ".log", ".ulg", ".ulog", ".srt", ".csv")
"""Of files beside a video that may be its log."""
_TRANSPORT_STREAM, _PACKET = 0x47, 188


def read_log(path: Path, *, system: int = 0, order: AxisOrder = "auto", zone: tzinfo | None = None) -> PoseLog:
    """The poses in a flight's log, or in a video's metadata.

    Args:
        path: a telemetry log, an onboard log, subtitles, a CSV file, or a transport stream with KLV.
        system: tlog: the vehicle's system id; 0 takes the first one.
        order: SRT: which number comes first in GPS(...).
        zone: SRT: of its local times.

    Raises:
        LogError: it is of no known kind, damaged, or holds no flight; the message says which.
    """
    try:
        kind = kind_of(path)
        match kind:
            case "tlog":
                from mission.logs.tlog import read_tlog

                return read_tlog(path, system)
            case "dataflash":
                from mission.logs.dataflash import read_dataflash

                return read_dataflash(path)
            case "ulog":
                from mission.logs.ulog import read_ulog

                return read_ulog(path)
            case "dji-srt":
                return read_dji_srt(path, order, zone)
            case "misb-klv":
                from mission.logs.misb_klv import read_misb_klv

                return read_misb_klv(path)
            case "csv":
                from mission.logs.pose_csv import read_pose_csv

                return read_pose_csv(path)
    except OSError as error:
        raise LogError(f"{path} cannot be read: {error.strerror or error}", "Check the path.") from error


def kind_of(path: Path) -> LogKind:
    """What kind of log a file is.

    Raises:
        LogError: none that is known.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        begin = file.read(4096)
    if not begin:
        raise LogError(f"{path.name} is empty", "Copy it again.")
    if begin.startswith(b"ULog\x01\x12\x35"):
        return "ulog"
    if begin.startswith(b"\xa3\x95"):
        return "dataflash"
    if begin[0] == _TRANSPORT_STREAM and len(begin) > _PACKET and begin[_PACKET] == _TRANSPORT_STREAM:
        return "misb-klv"
    text = begin.decode("utf-16" if begin[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig", "ignore")
    if "-->" in text:
        return "dji-srt"
    if path.suffix.lower() == ".csv":
        return "csv"
    if next(frames(path), None) is not None:
        return "tlog"
    raise LogError(
        f"{path.name} is no log that is known",
        "Known are: tlog, ArduPilot BIN, PX4 ULog, DJI SRT, a transport stream with KLV, CSV.",
    )
