"""Parameters that stations have set, kept over a restart as every MAVLink component keeps them.

They stand in a small file beside the answers, and above the settings file until that one is changed: a value that
somebody has written there since is the newer one.
"""

from __future__ import annotations

import json
import logging
import math
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

from gcs_plugin.component.parameter_table import Parameter, parameters, wider_than
from gcs_plugin.durable import write_whole
from mission.errors import AnswerError
from mission.settings import MissionSettings

_LOG = logging.getLogger(__name__)
SHORT: Final = 120


class KeptParameters:
    """What stations changed in the settings of one vehicle.

    Args:
        path: of the file; made when something is set.
        settings: of the settings file.

    What of the file cannot be understood is passed over and told.
    """

    def __init__(self, path: Path, settings: MissionSettings) -> None:
        self._path = path
        self._of_the_file = settings
        self._all = parameters()
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="sidestep-parameters")
        self._lock = threading.Lock()
        self._waiting: bytes | None = None
        self.settings = settings
        """With what stations had set when the program ended."""
        self.restored: list[str] = []
        """The parameters that differ from the settings file for that, in the operator's words."""
        self.passed_over: list[str] = []
        """What of the file does not count, and why."""
        known = {p.name: p for p in self._all}
        for name, entry in self._read().items():
            parameter = known.get(name)
            if parameter is None:
                continue
            try:
                number, instead_of = _float(entry["set"]), _float(entry["instead_of"])
            except (ValueError, OverflowError, TypeError, KeyError) as error:
                self.passed_over.append(f"{name} of {path}: {_short(error)}")
                continue
            if not _same(parameter.read(settings), instead_of):
                continue  # the settings file was changed since
            changed = parameter.changed(self.settings, number)
            refused = f"{number:g} is no value for it" if changed is None else wider_than(parameter, changed, settings)
            if changed is None or refused is not None:
                self.passed_over.append(f"{name} of {path}: {refused}")
                continue
            self.settings = changed
            self.restored.append(f"{name} {_shown(parameter, self.settings)} instead of {_shown(parameter, settings)}")

    def keep(self, settings: MissionSettings) -> None:
        """Write what differs from the settings file, in another thread: a slow disk must not silence the link.

        Only the newest waits to be written, however fast they come.
        """
        differs = {
            p.name: {"set": _number(p.read(settings)), "instead_of": _number(p.read(self._of_the_file))}
            for p in self._all
            if not _same(p.read(settings), p.read(self._of_the_file))
        }
        with self._lock:
            writes = self._waiting is not None
            self._waiting = f"{json.dumps(differs, indent=2)}\n".encode("ascii")
        if not writes:
            self._writer.submit(self._write)

    def close(self) -> None:
        """Wait until everything is written. Safe to call twice."""
        self._writer.shutdown(wait=True)

    def _write(self) -> None:
        with self._lock:
            content, self._waiting = self._waiting, None
        if content is None:
            return
        try:
            write_whole(self._path, content)
        except AnswerError as error:
            _LOG.warning("parameters are not kept: %s", error)

    def _read(self) -> dict[str, Any]:
        """The file's entries by name, unchecked; none when it cannot be read."""
        try:
            content = json.loads(self._path.read_text("ascii"))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, RecursionError) as error:
            self.passed_over.append(f"{self._path}, so that the settings file counts alone: {_short(error)}")
            return {}
        if not isinstance(content, dict):
            self.passed_over.append(f"{self._path}, so that the settings file counts alone: it is no table")
            return {}
        return {name: entry for name, entry in content.items() if isinstance(name, str)}


def _same(number: float, other: float) -> bool:
    return number == other or (math.isnan(number) and math.isnan(other))


def _number(value: float) -> float | None:
    return None if math.isnan(value) else value


def _float(value: object) -> float:
    """A number of the file; null is "not set".

    Raises:
        TypeError: it is none.
        OverflowError: it is beyond all floats.
    """
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number")
    return float(value)


def _short(error: Exception) -> str:
    """An error on one line: a number of thousands of digits is not repeated."""
    text = f"{error.args[0]} is missing" if isinstance(error, KeyError) else str(error)
    return text if len(text) <= SHORT else f"{text[:SHORT]}..."


def _shown(parameter: Parameter, settings: MissionSettings) -> str:
    number = parameter.read(settings)
    return parameter.choices[int(number)] if parameter.choices else f"{number:g}"
