"""The camera file: everything about one camera that a flight needs, as TOML.

format = "sidestep-camera"
version = 1
calibrated = true
focal_sigma = 0.003          # relative
readout_s = 0.0
latency_s = 0.0
gimbal = "none"              # "mavlink": on a gimbal that tells its attitude; the mounting is then that on the gimbal
gimbal_age_s = 0.0           # how much older the gimbal's angles are than their time stamps
provenance = "chessboard, 21 pictures, rms 0.21 px"

[intrinsics]
width_px = 640
height_px = 480
fx = 516.5
fy = 516.5
cx = 320.0
cy = 240.0
distortion = [0.0, 0.0, 0.0, 0.0, 0.0]

[mounting]
body_from_camera_wxyz = [0.5, 0.5, 0.5, 0.5]    # or: tilt_down_deg = 20.0
position_body_m = [0.0, 0.0, 0.0]
"""

from __future__ import annotations

import json
import math
import os
import tomllib
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mission.camera.camera import CALIBRATED_FOCAL_SIGMA, UNCALIBRATED_FOCAL_SIGMA, Camera
from mission.camera.model import MOST_BEND, CameraModel, largest_bend
from mission.camera.mounting import Mounting, rotation, wxyz
from mission.errors import CalibrationInputError
from mission.records import CameraIntrinsics

__all__ = ["Camera", "read_camera", "write_camera"]

_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Focal = Annotated[float, Field(ge=1.0, le=1e6, allow_inf_nan=False)]

_MOST_BORESIGHT_RAD = math.radians(15.0)
"""Between the gimbal's forward axis and the lens; more is the tilt of a fixed mounting, forgotten there."""
_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)


class _Intrinsics(BaseModel):
    model_config = _STRICT
    width_px: Annotated[int, Field(ge=16, le=16384)]
    height_px: Annotated[int, Field(ge=16, le=16384)]
    fx: _Focal
    fy: _Focal
    cx: _Finite
    cy: _Finite
    distortion: Annotated[list[_Finite], Field(min_length=5, max_length=5)] = [0.0] * 5


class _Mounting(BaseModel):
    model_config = _STRICT
    body_from_camera_wxyz: Annotated[list[_Finite], Field(min_length=4, max_length=4)] | None = None
    tilt_down_deg: Annotated[float, Field(ge=-90.0, le=90.0)] | None = None
    position_body_m: Annotated[list[_Finite], Field(min_length=3, max_length=3)] = [0.0] * 3


class _File(BaseModel):
    model_config = _STRICT
    format: Literal["sidestep-camera"]
    version: Literal[1]
    calibrated: bool
    focal_sigma: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    readout_s: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    latency_s: Annotated[float, Field(ge=-1.0, lt=10.0)] = 0.0
    provenance: str = ""
    gimbal: Literal["none", "mavlink"] = "none"
    gimbal_age_s: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0
    intrinsics: _Intrinsics
    mounting: _Mounting = _Mounting(tilt_down_deg=0.0)


def read_camera(path: Path | str) -> Camera:
    """Read a camera file.

    Raises:
        CalibrationInputError: the file cannot be read, is not TOML, or a field is missing, unknown, of a wrong type or
            size, not finite or out of its range; the message names file and field.
    """
    remedy = "Make one with `sidestep calibrate`, or give the camera's field of view instead."
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise CalibrationInputError(f"The camera file {path} cannot be read: {error.strerror}", remedy) from None
    except UnicodeDecodeError:
        raise CalibrationInputError(f"The camera file {path} is not text", remedy) from None
    try:
        content = _File.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise CalibrationInputError(f"The camera file {path} is not TOML: {error}", remedy) from None
    except ValidationError as error:
        raise CalibrationInputError(
            f"The camera file {path} is wrong: {_problems(error)}", "Correct the fields named."
        ) from None
    except (ValueError, RecursionError):
        raise CalibrationInputError(
            f"The camera file {path} has a number of thousands of digits, or brackets within thousands of brackets",
            remedy,
        ) from None
    return _camera(content, path)


def _problems(error: ValidationError) -> str:
    problems = error.errors(include_url=False)
    return "; ".join(f"{'.'.join(str(part) for part in one['loc'])}: {one['msg']}" for one in problems[:5])


def _camera(content: _File, path: Path | str) -> Camera:
    given = content.intrinsics
    k1, k2, p1, p2, k3 = given.distortion
    lens = CameraIntrinsics(
        given.width_px, given.height_px, given.fx, given.fy, given.cx, given.cy, (k1, k2, p1, p2, k3)
    )
    if not (0.0 <= lens.cx <= lens.width_px and 0.0 <= lens.cy <= lens.height_px):
        raise CalibrationInputError(f"The camera file {path} is wrong: intrinsics.cx, cy: outside of the picture")
    if not largest_bend(lens) <= MOST_BEND:
        raise CalibrationInputError(
            f"The camera file {path} is wrong: intrinsics.distortion: no lens bends a picture so much",
            "Correct the numbers, or calibrate again.",
        )
    w, h = float(lens.width_px), float(lens.height_px)
    border = [[x, y] for x in (0.0, w / 2, w) for y in (0.0, h / 2, h)]
    if np.isnan(CameraModel(lens).ray(border)).any():
        raise CalibrationInputError(
            f"The camera file {path} is wrong: intrinsics.distortion: folds over inside the picture",
            "Calibrate again with board pictures that reach into the picture's corners.",
        )
    focal_sigma = content.focal_sigma
    if focal_sigma is None:
        focal_sigma = CALIBRATED_FOCAL_SIGMA if content.calibrated else UNCALIBRATED_FOCAL_SIGMA
    mounting = _mounting(content.mounting, path)
    if content.gimbal != "none" and abs(mounting.tilt_down_rad) > _MOST_BORESIGHT_RAD:
        raise CalibrationInputError(
            f"The camera file {path} is wrong: mounting: a camera on a gimbal looks where the gimbal looks",
            "Leave the mounting's tilt out: the gimbal tells it.",
        )
    return Camera(
        lens,
        mounting,
        content.calibrated,
        content.readout_s,
        content.latency_s,
        focal_sigma,
        content.provenance,
        content.gimbal,
        content.gimbal_age_s,
    )


def _mounting(given: _Mounting, path: Path | str) -> Mounting:
    forward, right, down = given.position_body_m
    quaternion = given.body_from_camera_wxyz
    if (quaternion is None) == (given.tilt_down_deg is None):
        raise CalibrationInputError(
            f"The camera file {path} is wrong: mounting: give either body_from_camera_wxyz or tilt_down_deg"
        )
    if quaternion is None:
        return Mounting.tilted(math.radians(given.tilt_down_deg or 0.0), (forward, right, down))
    w, x, y, z = quaternion
    if abs(math.hypot(w, x, y, z) - 1.0) > 1e-3:
        raise CalibrationInputError(
            f"The camera file {path} is wrong: mounting.body_from_camera_wxyz: not a unit quaternion",
            "Its squares must add up to 1.",
        )
    return Mounting(wxyz(rotation((w, x, y, z))), (forward, right, down))


def write_camera(path: Path | str, camera: Camera) -> None:
    """Write a camera file; an older one is replaced only when the new one is whole.

    Raises:
        CalibrationInputError: the file cannot be written.
    """
    lens, mounting = camera.intrinsics, camera.mounting
    lines = [
        "# A camera of Sidestep. Pixels count from the outer corner of the top left pixel;",
        "# body axes are forward, right, down; camera axes are right, down, out of the lens.",
        'format = "sidestep-camera"',
        "version = 1",
        f"calibrated = {str(camera.calibrated).lower()}",
        f"focal_sigma = {float(camera.focal_sigma)!r}  # relative",
        f"readout_s = {float(camera.readout_s)!r}",
        f"latency_s = {float(camera.latency_s)!r}",
        f'gimbal = "{camera.gimbal}"',
        f"gimbal_age_s = {float(camera.gimbal_age_s)!r}",
        f"provenance = {json.dumps(camera.provenance, ensure_ascii=False)}",
        "",
        "[intrinsics]",
        f"width_px = {lens.width_px}",
        f"height_px = {lens.height_px}",
        f"fx = {float(lens.fx)!r}",
        f"fy = {float(lens.fy)!r}",
        f"cx = {float(lens.cx)!r}",
        f"cy = {float(lens.cy)!r}",
        f"distortion = {[float(k) for k in lens.distortion]}",
        "",
        "[mounting]",
        f"body_from_camera_wxyz = {[float(part) for part in mounting.body_from_camera_wxyz]}",
        f"position_body_m = {[float(part) for part in mounting.position_body_m]}",
        "",
    ]
    target = Path(path)
    draft = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        draft.write_text("\n".join(lines), encoding="utf-8")
        draft.replace(target)
    except OSError as error:
        draft.unlink(missing_ok=True)
        raise CalibrationInputError(
            f"The camera file {path} cannot be written: {error.strerror}", "Choose a folder that can be written to."
        ) from None
