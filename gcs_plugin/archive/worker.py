"""The process that reprocesses one flight of an archive: its job comes as JSON on standard input.

Standard output ends with one line of JSON: the result's key, and why there is no place. Exit status 0 when the result
is on the disk (also that of a flight that cannot be used), 5 when it cannot be written; anything else is a crash.
"""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from mission.records import TargetPrior

CANNOT_WRITE: Final = 5


def main() -> int:
    """Do the job."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    import cv2

    from gcs_plugin.archive.job import is_done, job_key, run_job
    from mission.errors import AnswerError

    cv2.setNumThreads(1)
    job, settings, results = from_json(json.loads(sys.stdin.read()))
    try:
        key = job_key(job, settings)
    except OSError as error:
        print(json.dumps({"key": "", "why": f"{error.filename} cannot be read: {error.strerror}"}))  # noqa: T201  # read by the parent
        return 0
    out = result_folder(results, key)
    why = None
    try:
        if not is_done(out):
            why = run_job(job, settings, out, key)
    except AnswerError as error:
        print(json.dumps({"key": key, "why": str(error)}))  # noqa: T201  # read by the parent
        return CANNOT_WRITE
    if why is None:
        from gcs_plugin.archive.result import RESULT

        why = json.loads((out / RESULT).read_text(encoding="utf-8"))["error"] or ""
    print(json.dumps({"key": key, "why": why}))  # noqa: T201  # read by the parent
    return 0


def result_folder(results: Path, key: str) -> Path:
    """Where a result is, not too many in one folder."""
    return results / key[:2] / key


def to_json(job: Any, settings: Any, results: Path) -> str:
    """A job for another process."""
    camera = None if job.camera is None else str(job.camera.resolve())
    files = {"video": str(job.video.resolve()), "log": str(job.log.resolve()), "camera": camera}
    return json.dumps(
        {"name": job.name, **files, "settings": asdict(settings), "results": str(results.resolve())}, allow_nan=False
    )


def from_json(told: dict[str, Any]) -> tuple[Any, Any, Path]:
    """Job, settings and the folder of all results."""
    from gcs_plugin.archive.job import Job, JobSettings

    camera = None if told["camera"] is None else Path(told["camera"])
    prior = TargetPrior(**told["settings"].pop("prior"))
    settings = JobSettings(**told["settings"], prior=prior)
    return Job(told["name"], Path(told["video"]), Path(told["log"]), camera), settings, Path(told["results"])


if __name__ == "__main__":
    sys.exit(main())
