"""The settings of a mission: one TOML file, every value with a unit in its name, a range and a clear error.

Everything has a default, so an empty file is a good one. An unknown name is refused, so that a typing error is not
taken for a setting. Paths in the file are relative to the file.
"""

from __future__ import annotations

import math
import tomllib
from pathlib import Path as FilePath
from typing import Annotated, Literal, Self, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator, model_validator
from pydantic_core import ErrorDetails

from mission.errors import SettingsError
from mission.records import ClassHeight, TargetPrior
from mission.settings_names import unknown_name
from mission.vehicle.drone import Bounds
from mission.vehicle.limits import COMPASS_SIGMA_RAD, FlightSettings


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _of_its_own_type(cls, value: object, info: ValidationInfo) -> object:
        """TOML has types, so nothing is converted: pydantic would take true for 1 and "3" for 3."""
        annotation = cls.model_fields[info.field_name or ""].annotation
        kinds = get_args(annotation) or (annotation,)
        if isinstance(value, bool) and bool not in kinds:
            raise ValueError("true or false stands where something else is wanted")
        if isinstance(value, str) and (float in kinds or int in kinds):
            raise ValueError("a text stands where a number is wanted")
        return value


SomeSection = TypeVar("SomeSection", bound=_Section)
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]


class LinkSettings(_Section):
    """The link to the aircraft."""

    url: str = Field(
        "udpin://0.0.0.0:14540", description="udpin://, udpout://, tcp://, serial:///dev/...:baud or ardrone://"
    )
    system: int = Field(0, ge=0, le=255, description="the aircraft's system id; 0: the first autopilot that is heard")
    connect_timeout_s: float = Field(20.0, gt=0.0, le=300.0, description="how long to wait for the aircraft")
    min_battery: Fraction = Field(0.2, description="no flight below this charge")
    release: Literal["sticks", "hold"] = Field(
        "sticks",
        description="mode in which control is given back on ArduPilot: LOITER, where the throttle stick rests in the "
        "middle, or always BRAKE",
    )
    accept_failsafe: bool = Field(
        False, description="fly also where PX4 does not hold when setpoints stop (COM_OBL_RC_ACT other than 5)"
    )

    compass_sigma_deg: float = Field(
        math.degrees(COMPASS_SIGMA_RAD),
        ge=0.1,
        le=45.0,
        description="1-sigma of the heading's constant error; smaller with two GPS antennas or a compass checked there",
    )

    def flight(self) -> FlightSettings:
        """As the pilot process wants them."""
        return FlightSettings(
            min_battery_fraction=self.min_battery,
            release=self.release,
            must_hold=not self.accept_failsafe,
            compass_sigma_rad=math.radians(self.compass_sigma_deg),
        )


class VideoSettings(_Section):
    """The camera's video."""

    url: str = Field("udp://127.0.0.1:5600", description="anything FFmpeg opens: rtsp://, udp://, an SDP or MP4 file")
    latency_s: float | None = Field(
        None, ge=-0.5, le=3.0, description="offset of video against telemetry; None: the camera file's"
    )
    check_offset: bool = Field(True, description="measure the offset on each flight's first turn")
    open_timeout_s: float = Field(10.0, gt=0.0, le=120.0, description="how long to wait for the first picture")
    keep_open_s: float = Field(
        60.0,
        ge=0.0,
        le=86400.0,
        description="how long `serve` keeps it open after an order, so that the next need not wait",
    )


class CameraSettings(_Section):
    """The camera: a calibration file, or failing that its field of view."""

    file: FilePath | None = Field(None, description="camera file of `sidestep calibrate`")
    hfov_deg: float = Field(70.0, gt=5.0, lt=170.0, description="horizontal field of view, used when there is no file")
    tilt_down_deg: float = Field(
        0.0, ge=-30.0, le=90.0, description="how far the camera looks down, used when there is no file"
    )
    ignore_gimbal: bool = Field(
        False, description="fly although the aircraft carries a gimbal: only where this camera is not on it"
    )


class DetectSettings(_Section):
    """Finding and choosing the target."""

    detector: Literal["auto", "hog", "nanodet", "tiles"] = Field(
        "auto", description="tiles: for people of 12 to 60 px seen from above, at ten times the work"
    )
    timeout_s: float = Field(8.0, gt=0.0, le=120.0, description="how long to look for a person before giving up")


class PatternSettings(_Section):
    """The lateral pattern."""

    kind: Literal["out-and-back", "s", "paper"] = "out-and-back"
    length_m: float = Field(3.0, gt=0.2, le=50.0, description="how far to the side; with accuracy_percent at most")
    leg_duration_s: float = Field(3.0, gt=0.5, le=60.0, description="time for each length")
    accuracy_percent: float | None = Field(
        None,
        ge=0.5,
        le=30.0,
        description="wanted 1-sigma of the distance: length (at most length_m), time and passes are chosen for it",
    )
    side: Literal["left", "right"] = "left"
    passes: int = Field(1, ge=1, le=10, description="how often the pattern is repeated in one flight")
    baseline_m: tuple[Annotated[float, Field(ge=0.0, le=10.0)], ...] = Field(
        (), max_length=100, description="the paper's pattern: travel since the previous image; empty for its Table II"
    )

    @model_validator(mode="after")
    def _one_that_can_be_chosen(self) -> Self:
        if self.accuracy_percent is not None and self.kind == "paper":
            raise ValueError("accuracy_percent chooses a pattern, and the paper's is what it is: leave one out")
        return self


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
    """What is known of the target before it is seen; ground and height count only where they are given."""

    speed_sigma_m_s: float = Field(1.0, gt=0.0, le=30.0, description="per horizontal axis")
    vertical_speed_sigma_m_s: float = Field(0.05, ge=0.0, le=10.0)
    acceleration_psd_m2_s3: float = Field(0.0, ge=0.0, le=10.0, description="above 0 the target may manoeuvre")
    ground_above_take_off_m: float | None = Field(
        None,
        ge=-1000.0,
        le=1000.0,
        description="ground under the target, above the aircraft's take-off point (below: negative); "
        "given together with ground_sigma_m",
    )
    ground_sigma_m: float | None = Field(
        None, gt=0.0, le=100.0, description="how exact that is, with the drift of the reported height since take-off"
    )
    centre_above_ground_m: float = Field(
        0.85, ge=0.0, le=20.0, description="middle of the target above the ground under it; used with the ground only"
    )
    height_m: float | None = Field(
        None, ge=0.1, le=20.0, description="true height of the target; given together with height_sigma_m"
    )
    height_sigma_m: float | None = Field(None, gt=0.0, le=10.0, description="how exact that is, as it stands or walks")
    class_height: ClassHeight = Field(
        "use",
        description="an adult's height as a measurement where none is given (children and others stay possible); "
        "compare only says what it would change",
    )

    @model_validator(mode="after")
    def _pairs(self) -> Self:
        for value, sigma in (("ground_above_take_off_m", "ground_sigma_m"), ("height_m", "height_sigma_m")):
            if (getattr(self, value) is None) != (getattr(self, sigma) is None):
                missing = value if getattr(self, value) is None else sigma
                raise ValueError(f"{value} and {sigma} go together, and {missing} is missing")
        if self.height_m is not None and self.height_sigma_m is not None and self.height_sigma_m >= self.height_m:
            raise ValueError("height_sigma_m is as large as height_m; leave both out where the height is not known")
        return self

    def prior(self, take_off_up_m: float | None = None) -> TargetPrior:
        """As the estimator wants it.

        Args:
            take_off_up_m: up coordinate of the take-off point in the flight's local frame: the aircraft's own, less
                its reported height above the take-off point. The local frame starts where the first position was
                reported, which may be in the air. None where it is not known.

        Raises:
            SettingsError: the ground is given and the take-off point is not known.
        """
        ground_up_m: float | None = None
        if self.ground_above_take_off_m is not None:
            if take_off_up_m is None:
                raise SettingsError(
                    "prior.ground_above_take_off_m is of no use: the height above the take-off point is not known",
                    "Start the program before take-off, or leave prior.ground_above_take_off_m out.",
                )
            ground_up_m = take_off_up_m + self.ground_above_take_off_m
        return TargetPrior(
            speed_sigma_m_s=self.speed_sigma_m_s,
            vertical_speed_sigma_m_s=self.vertical_speed_sigma_m_s,
            acceleration_psd_m2_s3=self.acceleration_psd_m2_s3,
            ground_up_m=ground_up_m,
            ground_sigma_m=self.ground_sigma_m,
            centre_above_ground_m=self.centre_above_ground_m,
            height_m=self.height_m,
            height_sigma_m=self.height_sigma_m,
            class_height=self.class_height,
        )


When = Literal["never", "on-request", "automatic"]
"""When something is given to the autopilot."""


class RecordSettings(_Section):
    """What is kept of a flight for later."""

    video: bool = Field(False, description="keep video and telemetry as received, so that the flight can be replayed")
    max_mb: float = Field(500.0, gt=1.0, le=100_000.0, description="of one flight's video, at most; telemetry likewise")


class AnswerSettings(_Section):
    """What happens with the answer."""

    roi: When = Field("automatic", description="a region of interest for the autopilot")
    waypoint: When = Field(
        "automatic", description="a waypoint at the stand-off, appended to the mission that is there"
    )
    standoff_m: float = Field(5.0, ge=2.0, le=500.0, description="distance of the waypoint from the target")
    folder: FilePath = Field(
        FilePath("flights"), description="where each flight gets a folder, and the geotag log lives"
    )
    statustext: bool = Field(True, description="tell the ground station in short texts")
    adsb_url: str | None = Field(
        None,
        pattern=r"^udp(?:out)?://[^/:\s]+:\d{1,5}$",
        description="udpout://HOST:PORT of a ground station that shows the target as traffic; never the vehicle's",
    )
    adsb_lifetime_s: float = Field(60.0, gt=0.0, le=3600.0, description="how long it is shown")

    @field_validator("roi", "waypoint", mode="before")
    @classmethod
    def _as_it_was_written_before(cls, value: object) -> object:
        """Settings files of version 0.1.0 say true and false."""
        return {True: "automatic", False: "never"}[value] if isinstance(value, bool) else value


class OrderSettings(_Section):
    """Orders from the ground station, for `sidestep serve`."""

    component: int = Field(100, ge=100, le=105, description="our MAVLink component id, a camera's")
    box: Literal["locate", "track"] = Field("locate", description="what a box or click on the video starts")
    video_url: str = Field("", description="the video as ground stations reach it; empty: the same as ours")


CircularError = Literal["one-sigma", "ce90"]
"""What a Cursor on Target point's `ce` and `le` mean."""


class TakSettings(_Section):
    """The answer, its ellipse and the drone on TAK maps (ATAK, WinTAK, TAK servers), as Cursor on Target."""

    urls: tuple[Annotated[str, Field(pattern=r"^(?:udp|tcp|tls)://[^\s/]+:\d{1,5}$")], ...] = Field(
        (),
        max_length=8,
        description="udp://239.2.3.1:6969 (all ATAKs of the network), udp://HOST:4242 (one), tcp:// or tls://HOST:PORT "
        "(a server, extra [tak])",
    )
    interface: str = Field("", description="address of the network interface that multicasts go out of; empty: default")
    ce: CircularError = Field(
        "one-sigma", description="what a point's ce and le are: one-sigma as MISB ST 0805 has it, or the 90 % values"
    )
    type: str = Field(
        "a-u-G",
        pattern=r"^[a-z](?:-[A-Za-z0-9]+)+$",
        description="of a target: a-u-G unknown, a-n-G neutral, b-m-p-s-m",
    )
    stale_s: float = Field(3600.0, gt=1.0, le=604800.0, description="how long a still target counts as fresh")
    stale_moving_s: float = Field(120.0, gt=1.0, le=86400.0, description="the same for a moving one")
    repeat_s: float = Field(10.0, gt=0.5, le=600.0, description="how often a target is sent again, for who missed it")
    drone: bool = Field(True, description="send the drone and its field of view, too, once a second")
    callsign: str = Field("Sidestep", max_length=60, description="of the drone")
    certificate: FilePath | None = Field(None, description="client certificate for tls://, PEM")
    key: FilePath | None = Field(None, description="its key, PEM without password")
    authority: FilePath | None = Field(None, description="the server's certificate authority, PEM")


class ConsoleSettings(_Section):
    """The page in the browser, for `sidestep console` and `sidestep serve --console`."""

    host: str = Field("127.0.0.1", description="address to listen at; another than this machine's own needs the next 3")
    password_file: FilePath | None = Field(None, description="made by `sidestep console --set-password commander`")
    certificate: FilePath | None = Field(None, description="for https, PEM")
    key: FilePath | None = Field(None, description="its key, PEM")
    port: int = Field(8420, ge=0, le=65535, description="to listen at; 0: any that is free")
    hosts: tuple[str, ...] = Field((), max_length=20, description="more names by which browsers may call this machine")
    map: FilePath | None = Field(None, description="a PMTiles file to lie under the map; a metre grid without it")


Asker = Annotated[str, Field(pattern=r"^(?:[1-9]\d{0,2})(?:/[1-9]\d{0,2})?$")]
"""A system id, or a system id and a component id with a slash between them."""


class AuthoritySettings(_Section):
    """Who may give orders, for `sidestep serve`; not to be changed over the link."""

    allowed: tuple[Asker, ...] = Field(
        ("255", "254", "253", "252", "251", "250", "245"),
        description="system ids, or system/component, of the ground stations that may give orders",
    )
    key_file: FilePath | None = Field(
        None, description="MAVLink 2 signing key; with it, only orders signed by it are obeyed"
    )
    flights_per_minute: float = Field(10.0, gt=0.0, le=60.0, description="more orders to fly than this are refused")
    commands_per_s: float = Field(50.0, ge=5.0, le=1000.0, description="more commands of one sender are passed over")


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
    record: RecordSettings = RecordSettings()
    orders: OrderSettings = OrderSettings()
    authority: AuthoritySettings = AuthoritySettings()
    tak: TakSettings = TakSettings()
    console: ConsoleSettings = ConsoleSettings()
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
    except (ValueError, RecursionError) as error:
        raise SettingsError(
            f"{path} has a number of thousands of digits, or brackets within thousands of brackets", "Correct the file."
        ) from error
    try:
        settings = MissionSettings.model_validate(content)
    except ValidationError as error:
        wrong = "; ".join(f"{'.'.join(str(part) for part in item['loc'])}: {_told(item)}" for item in error.errors())
        raise SettingsError(
            f"wrong settings in {path}: {wrong}", "`sidestep settings` prints them all with their ranges."
        ) from error
    return _relative_to(settings, path.parent)


def _told(item: ErrorDetails) -> str:
    if item["type"] == "extra_forbidden":
        return unknown_name(MissionSettings, item["loc"])
    message = item["msg"].removeprefix("Value error, ")
    return message[:1].lower() + message[1:]


def _relative_to(settings: MissionSettings, folder: FilePath) -> MissionSettings:
    camera = settings.camera
    if camera.file is not None and not camera.file.is_absolute():
        camera = camera.model_copy(update={"file": folder / camera.file})
    answer = settings.answer
    if not answer.folder.is_absolute() and "folder" in answer.model_fields_set:
        answer = answer.model_copy(update={"folder": folder / answer.folder})
    authority = settings.authority
    if authority.key_file is not None and not authority.key_file.is_absolute():
        authority = authority.model_copy(update={"key_file": folder / authority.key_file})
    return settings.model_copy(
        update={
            "camera": camera,
            "answer": answer,
            "authority": authority,
            "tak": _files_relative_to(settings.tak, folder, "certificate", "key", "authority"),
            "console": _files_relative_to(settings.console, folder, "password_file", "certificate", "key", "map"),
        }
    )


def _files_relative_to(section: SomeSection, folder: FilePath, *names: str) -> SomeSection:
    files = {name: getattr(section, name) for name in names}
    return section.model_copy(
        update={name: folder / path for name, path in files.items() if path is not None and not path.is_absolute()}
    )
