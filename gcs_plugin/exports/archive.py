"""Zip archives in memory whose bytes follow from their content."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from typing import Final

_TIME: Final = (1980, 1, 1, 0, 0, 0)
_STORED: Final = (".jpg", ".png")
"""Compressed already."""


def zipped(files: Mapping[str, bytes]) -> bytes:
    """The archive.

    Args:
        files: content by name, in the order in which they stand in the archive.
    """
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, data in files.items():
            kind = zipfile.ZIP_STORED if name.endswith(_STORED) else zipfile.ZIP_DEFLATED
            archive.writestr(zipfile.ZipInfo(name, _TIME), data, kind)
    return content.getvalue()


def picture_name(number: int, picture_type: str) -> str:
    """A picture's name in an archive."""
    return f"target-{number}.{'png' if picture_type == 'image/png' else 'jpg'}"
