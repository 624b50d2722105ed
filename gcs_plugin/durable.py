"""Files that are whole or not there, and lines that stay once they are acknowledged."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import threading
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from mission.errors import AnswerError


def sync(path: Path) -> None:
    """Flush a file, or a folder's list of names, to the disk.

    Raises:
        OSError: the disk refuses.
    """
    if os.name == "nt" and path.is_dir():
        return  # Windows cannot open a folder; NTFS journals its names by itself
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, durably.

    Raises:
        OSError: it cannot be made.
    """
    if folder.is_dir():
        return
    if folder.exists():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(folder))
    make_folder(folder.parent)
    folder.mkdir(exist_ok=True)
    sync(folder.parent)


_DRAFT: Final = re.compile(r"\..+\.(\d+)(?:-\d+)?\.new")


def clean_drafts(folder: Path) -> None:
    """Remove the drafts of `write_whole` and its like that programs left behind which were killed while they wrote."""
    for path in folder.glob(".*.new"):
        found = _DRAFT.fullmatch(path.name)
        if found is not None and not _runs(int(found[1])):
            with contextlib.suppress(OSError):  # it does no harm
                path.unlink()


def _runs(process: int) -> bool:
    if os.name == "nt":
        return True  # there, asking with signal 0 would end it
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or as it was before, and durable on return.

    Raises:
        AnswerError: it cannot be written; what was there is as it was.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}.new")
    try:
        try:
            with draft.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            draft.replace(path)
        finally:
            draft.unlink(missing_ok=True)
        sync(path.parent)
    except OSError as error:
        raise unwritable(path, error) from error


def unwritable(path: Path, error: OSError) -> AnswerError:
    """What the operating system said about a file, for the operator."""
    return AnswerError(
        f"{path} cannot be written: {error.strerror or error}",
        "Free some space, check the permissions, or name another folder.",
    )


class LineFile:
    """A text file to which whole lines are added; each is on the disk when `add` returns.

    Args:
        path: made when it is not there; a torn last line, left by a power cut, is ended first.

    Raises:
        AnswerError: it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        try:
            self._file = path.open("ab", buffering=0)
            sync(path.parent)
            with path.open("rb") as before:
                end = before.seek(0, os.SEEK_END)
                before.seek(max(end - 1, 0))
                torn = before.read(1) not in (b"", b"\n")
            if torn:
                self._write(b"\n", end)
        except OSError as error:
            raise unwritable(path, error) from error

    def add(self, line: str) -> None:
        """Add a line, without its end.

        Raises:
            AnswerError: the disk is full or refuses; the file holds the lines acknowledged before, whole.
            ValueError: the text is more than one line.
        """
        if "\n" in line or "\r" in line:
            raise ValueError("a line has no line end within")
        with self._lock:
            try:
                self._write(line.encode("utf-8") + b"\n", self._file.seek(0, os.SEEK_END))
            except OSError as error:
                raise unwritable(self.path, error) from error

    def close(self) -> None:
        """Close the file. Safe to call twice."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _write(self, content: bytes, end: int) -> None:
        try:
            written = 0
            while written < len(content):  # a nearly full disk takes a part
                written += self._file.write(content[written:])
            os.fsync(self._file.fileno())
        except OSError:
            self._file.truncate(end)
            raise
