"""Beside the log: geotags that it could not take, room for them on a full disk, and the numbers that are given away.

geotags.gpkg
geotags.gpkg.aside/
    number-17           the highest number that was given away
    unlogged-16.json    a geotag that waits until the log can be written again
    reserve             room that is given up for the first geotag that meets a full disk
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from gcs_plugin.durable import make_folder, sync, unwritable, write_whole
from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.geotags.row import from_json, to_json
from mission.errors import AnswerError

RESERVE_BYTES: Final = 128 * 1024
"""Enough for a geotag with its picture, and for the names of some files."""
_NUMBERED: Final = re.compile(r"(?:number-|unlogged-)([0-9]{1,15})(?:\.json)?")

_log = logging.getLogger(__name__)


class GeotagSpool:
    """The folder beside a log of geotags.

    Args:
        log: path of the log.
    """

    def __init__(self, log: Path) -> None:
        self.folder = log.with_name(f"{log.name}.aside")
        self._given = 0

    def prepare(self, highest: int) -> None:
        """Make the folder and its reserve, and remember a number that the log has given away.

        Raises:
            OSError: it cannot be written.
            AnswerError: likewise.
        """
        make_folder(self.folder)
        reserve = self.folder / "reserve"
        if not reserve.exists() or reserve.stat().st_size < RESERVE_BYTES:
            write_whole(reserve, bytes(RESERVE_BYTES))
        if highest > self._highest_named():
            self._mark(highest)

    def claim(self, above: int) -> int:
        """The next number, higher than `above` and any that was ever given away; no other process gets it, too.

        Where the disk takes no name, the number is still above all that are known here.
        """
        number = max(above, self._given, self._highest_named()) + 1
        while not self._mark(number):
            number += 1
        self._given = number
        return number

    def put(self, geotag: Geotag) -> Path:
        """Keep a geotag until the log can take it; when this returns, it is on the disk.

        Raises:
            AnswerError: it cannot be written here either.
        """
        try:
            return self._write(geotag)
        except AnswerError as error:
            if not geotag.picture:
                raise
            _log.warning("%s; trying without the picture", error)
        return self._write(replace(geotag, picture=b"", notes=(*geotag.notes, "there was no room for the picture")))

    def waiting(self) -> Iterator[tuple[Path, Geotag]]:
        """The geotags that wait, lowest number first. One that cannot be read stays where it is, and is told."""
        for path in sorted(self._files(), key=lambda each: (len(each.name), each.name)):
            try:
                yield path, from_json(path.read_bytes())
            except FileNotFoundError:
                continue  # another process has logged it meanwhile
            except (OSError, ValueError) as error:
                _log.warning("%s is no geotag: %s", path, error)

    def logged(self, path: Path) -> None:
        """The log has it now.

        Raises:
            OSError: the file cannot be removed.
        """
        path.unlink(missing_ok=True)
        sync(self.folder)

    def _files(self) -> list[Path]:
        try:
            return [path for path in self.folder.iterdir() if path.name.startswith("unlogged-") and path.suffix]
        except FileNotFoundError:
            return []
        except OSError as error:
            _log.warning("%s cannot be read: %s", self.folder, error)
            return []

    def _highest_named(self) -> int:
        try:
            names = [path.name for path in self.folder.iterdir()]
        except OSError:
            return 0  # not there, or unreadable: then the log's own numbers count
        return max((int(found[1]) for found in map(_NUMBERED.fullmatch, names) if found), default=0)

    def _mark(self, number: int) -> bool:
        """Note that a number is given away, and forget the lower ones; False when it is not ours to give."""
        mark = self.folder / f"number-{number}"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            mark.touch(exist_ok=False)
            for path in self.folder.iterdir():
                found = _NUMBERED.fullmatch(path.name)
                if found and int(found[1]) > number:  # another process is further on
                    mark.unlink(missing_ok=True)
                    return False
                if path.name.startswith("number-") and path != mark:
                    path.unlink(missing_ok=True)
        except OSError as error:
            if isinstance(error, FileExistsError) and mark.exists():
                return False
            _log.warning("that number %d is given away cannot be noted: %s", number, error.strerror or error)
        return True

    def _write(self, geotag: Geotag) -> Path:
        path = self.folder / f"unlogged-{geotag.number}.json"
        try:
            make_folder(self.folder)
            (self.folder / "reserve").unlink(missing_ok=True)
        except OSError as error:
            raise unwritable(path, error) from error
        write_whole(path, to_json(geotag))
        return path
