"""One recorded flight as a job: what goes in, the key that names its result, and the work itself."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from datetime import timedelta, timezone
from importlib.metadata import version
from pathlib import Path
from typing import Final

from gcs_plugin.archive.result import RESULT, Inputs, write_refusal, write_result
from gcs_plugin.durable import make_folder, sync, unwritable
from mission.camera import read_camera
from mission.errors import AnswerError, InputError, LogError, SidestepError
from mission.logs import read_log
from mission.logs.dji_srt import AxisOrder
from mission.observation.file_video import FileVideo
from mission.observation.reprocess import Means, Options, reprocess
from mission.records import TargetPrior

_BLOCK: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class JobSettings:
    """What is asked of every flight; part of what names its result."""

    wanted: float = 0.25
    detect_hz: float = 2.0
    hfov_deg: float | None = None
    tilt_down_deg: float = 0.0
    offset_s: float | None = None
    gps_order: AxisOrder = "auto"
    utc_offset_h: float | None = None
    """Of local times in subtitles."""
    prior: TargetPrior = field(default_factory=lambda: TargetPrior(class_height="use"))

    def options(self) -> Options:
        """As the work wants them."""
        return Options(
            wanted=self.wanted,
            detect_hz=self.detect_hz,
            offset_s=self.offset_s,
            hfov_rad=None if self.hfov_deg is None else math.radians(self.hfov_deg),
            tilt_down_rad=math.radians(self.tilt_down_deg),
            prior=self.prior,
        )


@dataclass(frozen=True, slots=True)
class Job:
    """One flight."""

    name: str
    video: Path
    log: Path
    camera: Path | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """All that goes in, the video first."""
        inputs = (self.video, self.log, *([self.camera] if self.camera else []))
        return tuple(dict.fromkeys(inputs))


def job_key(job: Job, settings: JobSettings) -> str:
    """Hash of the flight's name, the content of all inputs, the settings and the program's version: 32 digits.

    Raises:
        OSError: an input cannot be read.
    """
    told = hashlib.sha256(json.dumps([version("sidestep"), job.name, asdict(settings)], sort_keys=True).encode())
    for path in job.files:
        one = hashlib.sha256()
        with path.open("rb") as file:
            while block := file.read(_BLOCK):
                one.update(block)
        told.update(one.digest())
    return told.hexdigest()[:32]


def run_job(
    job: Job,
    settings: JobSettings,
    out: Path,
    key: str = "",
    means: Means | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> str:
    """Reprocess one flight; its folder appears whole, or not at all.

    A flight that cannot be used has a result, too: why. It is one, since the same inputs will give the same again.

    Args:
        job: the flight.
        settings: what is asked.
        out: the folder of this result; one that is there already is replaced.
        key: the job's key, where it is known already.
        means: detectors; the usual ones, read now, when not given.
        progress: is told what goes on.

    Returns:
        Why there is no place, or nothing.

    Raises:
        AnswerError: the result cannot be written.
    """
    software = f"sidestep {version('sidestep')}"
    draft = out.with_name(f".{out.name}.{os.getpid()}.new")
    try:
        make_folder(out.parent)
        shutil.rmtree(draft, ignore_errors=True)
        draft.mkdir()
    except OSError as error:
        raise unwritable(out, error) from error
    try:
        inputs = Inputs(job.name, job.video.name, job.log.name, key, software)
        why = ""
        try:
            try:
                inputs = replace(inputs, key=key or job_key(job, settings))
            except OSError as error:
                raise LogError(f"{error.filename} cannot be read: {error.strerror}", "Check the path.") from error
            _reprocess(job, settings, draft, inputs, means or Means.usual(), progress)
        except AnswerError:
            raise
        except SidestepError as error:
            why = error.cause
            write_refusal(draft, inputs, error)
        _rename(draft, out)
        return why
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def _reprocess(
    job: Job,
    settings: JobSettings,
    folder: Path,
    inputs: Inputs,
    means: Means,
    progress: Callable[[str], None],
) -> None:
    zone = None if settings.utc_offset_h is None else timezone(timedelta(hours=settings.utc_offset_h))
    log = read_log(job.log, order=settings.gps_order, zone=zone)
    video = FileVideo(job.video)
    camera = None
    if job.camera is not None:
        camera = read_camera(job.camera).for_picture(video.facts.width_px, video.facts.height_px)
    found = reprocess(video, log, camera, settings.options(), means, inputs.flight, progress)
    write_result(folder, inputs, found, log)


def _rename(draft: Path, out: Path) -> None:
    try:
        if out.exists():
            old = out.with_name(f".{out.name}.{os.getpid()}.old")
            out.rename(old)
            draft.rename(out)
            shutil.rmtree(old, ignore_errors=True)
        else:
            draft.rename(out)
        sync(out.parent)
    except OSError as error:
        raise unwritable(out, error) from error


def is_done(out: Path) -> bool:
    """Whether a result is there: its folder is renamed when whole."""
    return (out / RESULT).is_file()


def checked(job: Job) -> None:
    """What is wrong with a job before anything is read.

    Raises:
        InputError: a file is not there.
    """
    for path in job.files:
        if not path.is_file():
            raise InputError(f"{path} is not there", "Check the path.")
