"""MISB metadata (ST 0601 KLV) in a transport stream: where the camera was, by the video's own time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import av
import av.error
import numpy as np
from scipy.spatial.transform import Rotation

from mission.errors import LogError
from mission.logs.klv_local_set import KlvError, UasLocalSet, packets, parse_local_set
from mission.logs.pose_log import PoseLog
from mission.logs.series import attitudes, enu_from_ned, from_euler, pose_noise, positions, utc_at_zero
from mission.records import Matrix


def read_misb_klv(path: Path) -> PoseLog:
    """The flight in the data stream of a transport stream; its time 0 is the video's first frame.

    Raises:
        LogError: there is no metadata in it, or no positions.
        OSError: it cannot be read.
    """
    sets, broken = [], 0
    for t_s, packet in data_packets(path):
        for one in packets(packet):
            try:
                sets.append((t_s, parse_local_set(one)))
            except KlvError:
                broken += 1
    if not sets:
        why = f"{broken} packets are damaged" if broken else "there is no KLV stream (ST 0601) in it"
        raise LogError(f"{path.name} holds no flight metadata: {why}", "Give the flight's log beside it (--log).")
    placed = [(t_s, one) for t_s, one in sets if one.lat_deg is not None and one.lon_deg is not None]
    ellipsoid = all(one.ellipsoid_m is not None for _, one in placed)
    altitude = [one.ellipsoid_m if ellipsoid else one.amsl_m for _, one in placed]
    place = [
        (one.lat_deg, one.lon_deg, up)
        for (_, one), up in zip(placed, altitude, strict=True)
        if one.lat_deg is not None and one.lon_deg is not None and up is not None
    ]
    times = [t_s for (t_s, _), up in zip(placed, altitude, strict=True) if up is not None]
    moving = [
        (math.nan, math.nan, math.nan)
        if one.east_m_s is None or one.north_m_s is None
        else (one.east_m_s, one.north_m_s, 0.0)
        for (_, one), up in zip(placed, altitude, strict=True)
        if up is not None
    ]
    origin, series = positions(times, place, moving, "ellipsoid" if ellipsoid else "amsl")
    told = [
        (t_s, (one.roll_deg, one.pitch_deg, one.heading_deg))
        for t_s, one in sets
        if one.heading_deg is not None and one.pitch_deg is not None and one.roll_deg is not None
    ]
    aircraft = from_euler([t_s for t_s, _ in told], [[x or 0.0 for x in angles] for _, angles in told])
    held = [(t_s, one) for t_s, one in sets if one.sensor_azimuth_deg is not None and one.heading_deg is not None]
    gimbal = None
    if held:
        gimbal = attitudes([t_s for t_s, _ in held], enu_from_ned(np.array([_camera(one) for _, one in held])))
    hfov = [one.hfov_deg for _, one in sets if one.hfov_deg]
    zoomed = bool(hfov) and max(hfov) / min(hfov) > 1.01
    pointing = gimbal or aircraft
    return PoseLog(
        "misb-klv",
        "video",
        origin,
        series,
        aircraft,
        gimbal,
        pose_noise(None, pointing, gimbal=gimbal is not None),
        utc_at_zero_s=utc_at_zero([(t_s, one.time_s) for t_s, one in sets if one.time_s]),
        hfov_rad=math.radians(float(np.median(hfov))) if hfov else None,
        zoomed=zoomed,
        notes=(f"{broken} packets of the metadata are damaged and are not used",) if broken else (),
    )


def data_packets(path: Path) -> Iterator[tuple[float, bytes]]:
    """Seconds after the video's first frame, and bytes, of each packet of the first data stream.

    Raises:
        LogError: it is no container that FFmpeg reads.
        OSError: it cannot be read.
    """
    try:
        with av.open(str(path)) as container:
            data = container.streams.data
            if not data:
                return
            first_s = 0.0
            if container.streams.video:
                video = container.streams.video[0]
                if video.start_time is not None and video.time_base is not None:
                    first_s = float(video.start_time * video.time_base)
            for packet in container.demux(data[0]):
                if packet.pts is not None and packet.time_base is not None:
                    yield float(packet.pts * packet.time_base) - first_s, bytes(packet)
    except av.error.FFmpegError as error:
        if isinstance(error, OSError) and not isinstance(error, ValueError):
            raise LogError(f"{path.name} cannot be read ({error.strerror})", "Check the file.") from error
        raise LogError(f"{path.name} is no video with metadata ({error})", "Check the file.") from error


def _camera(one: UasLocalSet) -> Matrix:
    """Quaternion (4,) from the sensor's frame (forward along the lens) to NED: the platform, then the sensor on it."""
    platform = Rotation.from_euler("ZYX", [one.heading_deg or 0.0, one.pitch_deg or 0.0, one.roll_deg or 0.0], True)
    on_it = [one.sensor_azimuth_deg or 0.0, one.sensor_elevation_deg or 0.0, one.sensor_roll_deg or 0.0]
    return np.asarray((platform * Rotation.from_euler("ZYX", on_it, True)).as_quat(scalar_first=True))
