"""The log of geotags as the module shows it: a table, a file, and the newest targets for the map."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from gcs_plugin.durable import write_whole
from gcs_plugin.exports.formats import FORMATS, format_of
from gcs_plugin.geotags.log import Geotag, read_geotags
from gcs_plugin.geotags.spool import GeotagSpool
from mission.errors import SettingsError, SidestepError

_LOG = logging.getLogger(__name__)
LOOK_S: Final = 1.0


class Targets:
    """Reads a log again whenever it has changed.

    Args:
        path: where the log is, now; asked at each look.
    """

    def __init__(self, path: Callable[[], Path]) -> None:
        self._path = path
        self._seen: tuple[Path, int, int, int] | None = None
        self._next_look_s = 0.0
        self._geotags: Sequence[Geotag] = ()
        self.version = 0
        """Another one whenever the log has been read anew."""

    def newest(self, count: int, now_s: float) -> Sequence[Geotag]:
        """The newest geotags, oldest first; none while there is no log or it cannot be read."""
        if now_s >= self._next_look_s:
            self._next_look_s = now_s + LOOK_S
            self._look()
        return self._geotags[len(self._geotags) - min(count, len(self._geotags)) :]

    def table(self) -> str:
        """A line for each geotag.

        Raises:
            AnswerError: the log cannot be read.
            SettingsError: the settings file that names it cannot.
        """
        geotags = read_geotags(self._path())
        return "\n".join(_line(geotag) for geotag in geotags) or f"no geotags in {self._path()}"

    def find(self, number: str | None) -> Geotag:
        """A target by its number, or the newest one.

        Raises:
            AnswerError: the log cannot be read.
            SettingsError: there is no such target.
        """
        found = [each for each in read_geotags(self._path()) if number is None or str(each.number) == number]
        if not found:
            raise SettingsError(f"there is no target {number or 'yet'}", "`locate list` shows them.")
        return found[-1]

    def export(self, file: Path) -> str:
        """Write the log; the format follows the name. Returns a sentence for the operator.

        Raises:
            SettingsError: no format has that suffix.
            AnswerError: the log cannot be read or the file not written.
        """
        form = FORMATS[format_of(file)]
        geotags = read_geotags(self._path())
        write_whole(file, form(geotags))
        return f"{len(geotags)} geotags written to {file.absolute()}"

    def _look(self) -> None:
        try:
            path = self._path()
            state = path.stat()
            aside = GeotagSpool(path).folder  # a geotag that the log could not take is shown, too
            beside_ns = aside.stat().st_mtime_ns if aside.is_dir() else 0
        except (OSError, SidestepError) as error:
            _LOG.debug("no log of geotags: %s", error)
            self.version += self._seen is not None
            self._seen, self._geotags = None, ()
            return
        seen = (path, state.st_mtime_ns, state.st_size, beside_ns)
        if seen == self._seen:
            return
        try:
            self._geotags = read_geotags(path)
            self._seen = seen
            self.version += 1
        except SidestepError as error:  # being written, perhaps: the next look reads it again
            _LOG.debug("%s", error)


def _line(geotag: Geotag) -> str:
    speed = "" if geotag.speed_m_s is None else f"  {geotag.speed_m_s:.1f} m/s"
    place = f"{geotag.place.lat_deg:.7f} {geotag.place.lon_deg:.7f}"
    return f"{geotag.number:4d}  {geotag.time_utc:%Y-%m-%d %H:%M:%SZ}  {place}  CE90 {geotag.ce90_m:.1f} m{speed}"
