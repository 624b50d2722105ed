"""The settings of a mission: one TOML file, every value with a unit in its name, a range and a clear error.

Everything has a default, so an empty file is a good one. An unknown name is refused, so that a typing error is not
taken for a setting. Paths in the file are relative to the file.
"""

from __future__ import annotations

import tomllib
from pathlib import Path as FilePath
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mission.drones.drone import Bounds
from mission.errors import SettingsError
from mission.records import TargetPrior


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Fraction = Annotated[float, Field(ge=0.0, le=1.0)]


class LinkSettings(_Section):
    """The link to the aircraft."""

    url: str = Field(
        "udpin://0.0.0.0:14540", description="udpin://, udpout://, tcp://, serial:///dev/...:baud or ardrone://"
    )
    connect_timeout_s: float = Field(20.0, gt=0.0, le=300.0, description="how long to wait for the aircraft")
    min_battery: Fraction = Field(0.2, description="no flight below this charge")


class VideoSettings(_Section):
    """The camera's video."""

    url: str = Field("udp://127.0.0.1:5600", description="anything FFmpeg opens: rtsp://, udp://, an SDP or MP4 file")
    latency_s: float | None = Field(
        None, ge=-0.5, le=3.0, description="offset of video against telemetry; None: the camera file's"
    )
    check_offset: bool = Field(True, description="measure the offset on each flight's first turn")
    open_timeout_s: float = Field(10.0, gt=0.0, le=120.0, description="how long to wait for the first picture")


class CameraSettings(_Section):
    """The camera: a calibration file, or failing that its field of view."""

    file: FilePath | None = Field(None, description="camera file of `sidestep calibrate`")
    hfov_deg: float = Field(70.0, gt=5.0, lt=170.0, description="horizontal field of view, used when there is no file")
    tilt_down_deg: float = Field(
        0.0, ge=-30.0, le=90.0, description="how far the camera looks down, used when there is no file"
    )


class DetectSettings(_Section):
    """Finding and choosing the target."""

    detector: Literal["auto", "hog", "nanodet"] = "auto"
    timeout_s: float = Field(8.0, gt=0.0, le=120.0, description="how long to look for a person before giving up")


class PatternSettings(_Section):
    """The lateral pattern."""

    kind: Literal["out-and-back", "s", "paper"] = "out-and-back"
    length_m: float = Field(3.0, gt=0.2, le=50.0, description="how far to the side")
    leg_duration_s: float = Field(3.0, gt=0.5, le=60.0, description="time for each length")
    side: Literal["left", "right"] = "left"
    passes: int = Field(1, ge=1, le=10, description="how often the pattern is repeated in one flight")


class LimitSettings(_Section):
    """The room that a flight may use; a pattern that needs more is refused before it starts."""

    radius_m: float = Field(15.0, gt=0.0, le=500.0, description="horizontal distance from where control was taken")
    min_height_m: float = Field(1.0, ge=0.3, le=100.0, description="above home")
    max_height_m: float = Field(30.0, gt=0.5, le=120.0, description="above home")
    max_speed_m_s: float = Field(3.0, gt=0.1, le=20.0)
    max_duration_s: float = Field(90.0, gt=1.0, le=1200.0, description="from taking control to giving it back")

    def bounds(self) -> Bounds:
        """As the drone wants them."""
        return Bounds(
            radius_m=self.radius_m,
            min_height_m=self.min_height_m,
            max_height_m=self.max_height_m,
            max_speed_m_s=self.max_speed_m_s,
            max_duration_s=self.max_duration_s,
        )


class PriorSettings(_Section):
    """What is known of the target before it is seen."""

    speed_sigma_m_s: float = Field(1.0, gt=0.0, le=30.0, description="per horizontal axis")
    vertical_speed_sigma_m_s: float = Field(0.05, ge=0.0, le=10.0)
    acceleration_psd_m2_s3: float = Field(0.0, ge=0.0, le=10.0, description="above 0 the target may manoeuvre")

    def prior(self) -> TargetPrior:
        """As the estimator wants it."""
        return TargetPrior(self.speed_sigma_m_s, self.vertical_speed_sigma_m_s, self.acceleration_psd_m2_s3)


class AnswerSettings(_Section):
    """What happens with the answer."""

    roi: bool = Field(True, description="push a region of interest to the autopilot")
    waypoint: bool = Field(True, description="append a waypoint at the stand-off to the mission that is there")
    standoff_m: float = Field(5.0, ge=2.0, le=500.0, description="distance of the waypoint from the target")
    folder: FilePath = Field(
        FilePath("flights"), description="where each flight gets a folder, and the geotag log lives"
    )
    statustext: bool = Field(True, description="tell the ground station in short texts")


class MissionSettings(_Section):
    """All settings of a mission."""

    link: LinkSettings = LinkSettings()
    video: VideoSettings = VideoSettings()
    camera: CameraSettings = CameraSettings()
    detect: DetectSettings = DetectSettings()
    pattern: PatternSettings = PatternSettings()
    limits: LimitSettings = LimitSettings()
    prior: PriorSettings = PriorSettings()
    answer: AnswerSettings = AnswerSettings()
    repeat: int = Field(1, ge=1, le=20, description="how many sidesteps, repositioning between them")


def read_settings(path: FilePath | None) -> MissionSettings:
    """The settings of a TOML file, or all defaults for None.

    Raises:
        SettingsError: the file cannot be read, is not TOML, or a value is unknown, of a wrong type or out of range;
            every wrong value is named.
    """
    if path is None:
        return MissionSettings()
    try:
        with path.open("rb") as file:
            content = tomllib.load(file)
    except OSError as error:
        raise SettingsError(
            f"cannot read the settings {path}: {error.strerror}", "Give the path of a TOML file."
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path} is not TOML: {error}", "Correct the file at that place.") from error
    try:
        settings = MissionSettings.model_validate(content)
    except ValidationError as error:
        wrong = "; ".join(
            f"{'.'.join(str(part) for part in item['loc'])}: {item['msg'][:1].lower()}{item['msg'][1:]}"
            for item in error.errors()
        )
        raise SettingsError(
            f"wrong settings in {path}: {wrong}", "`sidestep settings` prints them all with their ranges."
        ) from error
    return _relative_to(settings, path.parent)


def _relative_to(settings: MissionSettings, folder: FilePath) -> MissionSettings:
    camera = settings.camera
    if camera.file is not None and not camera.file.is_absolute():
        camera = camera.model_copy(update={"file": folder / camera.file})
    answer = settings.answer
    if not answer.folder.is_absolute() and "folder" in answer.model_fields_set:
        answer = answer.model_copy(update={"folder": folder / answer.folder})
    return settings.model_copy(update={"camera": camera, "answer": answer})
