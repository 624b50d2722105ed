"""Geotags as KMZ: the KML with its icon and the pictures inside, so that it shows them without the internet.

ATAK, CalTopo and Google Earth on phones show files of the archive, and do not show pictures within the text (data:).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from gcs_plugin.exports.archive import picture_name, zipped
from gcs_plugin.exports.kml import to_kml
from gcs_plugin.geotags.geotag import Geotag
from mission.records import Image

ICON: Final = "files/target.png"
_SIDE_PX: Final = 64


def to_kmz(geotags: Sequence[Geotag]) -> bytes:
    """The archive; its first file is the KML, as the format wants it (OGC 12-007r2, annex C)."""
    pictures = {
        index: f"files/{picture_name(geotag.number or index, geotag.picture_type)}"
        for index, geotag in enumerate(geotags, 1)
        if geotag.picture
    }
    kml = to_kml(geotags, icon=ICON, pictures=list(map(pictures.get, range(1, len(geotags) + 1))))
    files = {"doc.kml": kml.encode("utf-8"), ICON: icon_png()}
    for index, name in pictures.items():
        files[name] = geotags[index - 1].picture
    return zipped(files)


def icon_png() -> bytes:
    """A red ring with a white border and a dot in its middle, on nothing; PNG."""
    four = 4 * _SIDE_PX  # drawn larger, so that its edges are smooth
    drawn = np.zeros((four, four, 4), np.uint8)
    middle = (four // 2, four // 2)
    white, red = (255, 255, 255, 255), (40, 40, 230, 255)
    for radius, width, colour in ((92, 56, white), (92, 32, red)):
        cv2.circle(drawn, middle, radius, colour, width)
    cv2.circle(drawn, middle, 26, white, -1)
    cv2.circle(drawn, middle, 16, red, -1)
    small: Image = np.asarray(cv2.resize(drawn, (_SIDE_PX, _SIDE_PX), interpolation=cv2.INTER_AREA), np.uint8)
    return cv2.imencode(".png", small)[1].tobytes()
