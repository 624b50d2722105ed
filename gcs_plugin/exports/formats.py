"""All formats that a log can be exported to, by name and by the endings of files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from gcs_plugin.exports.caltopo import to_caltopo
from gcs_plugin.exports.data_package import to_data_package
from gcs_plugin.exports.gpx import to_gpx
from gcs_plugin.exports.kml import to_kml
from gcs_plugin.exports.kmz import to_kmz
from gcs_plugin.exports.layers import to_geopackage
from gcs_plugin.exports.picture import to_jpeg
from gcs_plugin.exports.text_formats import to_csv, to_geojson
from gcs_plugin.geotags.geotag import Geotag
from mission.errors import AnswerError, SettingsError

Export = Callable[[Sequence[Geotag]], bytes]


def _picture(geotags: Sequence[Geotag]) -> bytes:
    """The picture of the newest geotag that has one.

    Raises:
        AnswerError: none has.
    """
    pictured = [geotag for geotag in geotags if geotag.picture]
    if not pictured:
        raise AnswerError("No target has a picture", "Export another format.")
    return to_jpeg(pictured[-1])


FORMATS: Final[Mapping[str, Export]] = {
    "geojson": lambda geotags: to_geojson(geotags).encode("utf-8"),
    "kml": lambda geotags: to_kml(geotags).encode("utf-8"),
    "kmz": to_kmz,
    "csv": lambda geotags: to_csv(geotags).encode("utf-8"),
    "gpx": to_gpx,
    "gpkg": to_geopackage,
    "caltopo": to_caltopo,
    "tak": to_data_package,
    "jpg": _picture,
}
"""What a log can be exported to, by name."""

_ENDINGS: Final = {"json": "geojson", "zip": "tak", "jpeg": "jpg"}


def format_of(file: Path) -> str:
    """The format that a file's name asks for.

    Raises:
        SettingsError: no format has that ending.
    """
    ending = file.suffix.lower().removeprefix(".")
    form = "caltopo" if file.name.lower().endswith(".caltopo.json") else _ENDINGS.get(ending, ending)
    if form not in FORMATS or (form == "caltopo" and ending == "caltopo") or ending == "tak":
        raise SettingsError(
            f"no format ends in {file.suffix!r}",
            "Use .geojson, .kml, .kmz, .csv, .gpx, .gpkg, .zip (TAK), .jpg or .caltopo.json, or give --format.",
        )
    return form
