"""The target's picture as a JPEG that says where it was taken and what it shows: EXIF 2.3 and XMP.

The position tags are the camera's, as every photo map reads them; the target stands in the destination tags, and in the
XMP packet with its covariance.
"""

from __future__ import annotations

import io
import json
import math
from datetime import UTC
from fractions import Fraction
from typing import Final
from xml.sax.saxutils import quoteattr

from PIL import Image
from PIL.ExifTags import IFD, Base
from PIL.TiffImagePlugin import IFDRational
from pyproj import Geod

from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.geotags.words import accuracy_in_words, description, name_of
from gcs_plugin.xml_text import xml_text, zulu
from mission.errors import AnswerError
from mission.geodesy import Geodetic

NAMESPACE: Final = "https://sidestep.invalid/ns/geotag/1.0/"
_GEOD: Final = Geod(ellps="WGS84")
_QUALITY: Final = 92

# EXIF 2.3, table 15.
_VERSION, _LAT_REF, _LAT, _LON_REF, _LON, _ALT_REF, _ALT, _TIME = 0, 1, 2, 3, 4, 5, 6, 7
_DIRECTION_REF, _DIRECTION, _DATUM = 16, 17, 18
_DEST_LAT_REF, _DEST_LAT, _DEST_LON_REF, _DEST_LON = 19, 20, 21, 22
_BEARING_REF, _BEARING, _DISTANCE_REF, _DISTANCE, _DATE, _ERROR = 23, 24, 25, 26, 29, 31


def to_jpeg(geotag: Geotag) -> bytes:
    """The picture with its metadata.

    Raises:
        AnswerError: the geotag has no picture, or one that cannot be read.
    """
    if not geotag.picture:
        raise AnswerError(f"{name_of(geotag)} has no picture", "Export another format.")
    try:
        image = Image.open(io.BytesIO(geotag.picture)).convert("RGB")
    except OSError as error:
        raise AnswerError(f"The picture of {name_of(geotag)} is damaged", "Export another format.") from error
    content = io.BytesIO()
    image.save(content, "JPEG", exif=_exif(geotag, image.size), xmp=_xmp(geotag), quality=_QUALITY)
    return content.getvalue()


def _exif(geotag: Geotag, size_px: tuple[int, int]) -> Image.Exif:
    exif = Image.Exif()
    exif[Base.Software] = geotag.provenance.software
    exif[Base.Make] = "Sidestep"
    exif[Base.ImageDescription] = _ascii(f"{name_of(geotag)}: {accuracy_in_words(geotag)}")
    time_utc = geotag.time_utc.astimezone(UTC)
    taken = time_utc.strftime("%Y:%m:%d %H:%M:%S")
    exif[Base.DateTime] = taken
    exif[Base.XResolution] = exif[Base.YResolution] = IFDRational(72)
    exif[Base.ResolutionUnit] = 2
    exif[Base.YCbCrPositioning] = 1
    details = exif.get_ifd(IFD.Exif)
    details[Base.ExifVersion] = b"0232"
    details[Base.ComponentsConfiguration] = b"\x01\x02\x03\x00"
    details[Base.FlashPixVersion] = b"0100"
    details[Base.ColorSpace] = 1
    details[Base.ExifImageWidth], details[Base.ExifImageHeight] = size_px
    details[Base.DateTimeOriginal] = taken
    details[Base.SubsecTimeOriginal] = f"{time_utc.microsecond // 1000:03d}"
    details[Base.OffsetTimeOriginal] = "+00:00"
    details[Base.UserComment] = b"ASCII\0\0\0" + _ascii(description(geotag)).encode("ascii")
    gps = exif.get_ifd(IFD.GPSInfo)
    gps[_VERSION] = b"\x02\x03\x00\x00"
    gps[_DATUM] = "WGS-84"
    gps[_DATE] = time_utc.strftime("%Y:%m:%d")
    seconds = Fraction(time_utc.second * 1000 + time_utc.microsecond // 1000, 1000)
    gps[_TIME] = (IFDRational(time_utc.hour), IFDRational(time_utc.minute), _rational(seconds))
    gps[_DEST_LAT_REF], gps[_DEST_LAT] = _angle(geotag.place.lat_deg, "NS")
    gps[_DEST_LON_REF], gps[_DEST_LON] = _angle(geotag.place.lon_deg, "EW")
    drone = geotag.drone
    if drone is not None:
        gps.update(_from(drone, geotag))
    return exif


def _from(drone: Geodetic, geotag: Geotag) -> dict[int, object]:
    """Where the picture was taken, and which way and how far the target was."""
    lat_ref, lat = _angle(drone.lat_deg, "NS")
    lon_ref, lon = _angle(drone.lon_deg, "EW")
    azimuth, _, metres = _GEOD.inv(drone.lon_deg, drone.lat_deg, geotag.place.lon_deg, geotag.place.lat_deg)
    bearing = _rational(Fraction(round(azimuth % 360.0 * 100.0), 100))
    found: dict[int, object] = {
        _LAT_REF: lat_ref,
        _LAT: lat,
        _LON_REF: lon_ref,
        _LON: lon,
        _DIRECTION_REF: "T",
        _DIRECTION: bearing,  # the pattern keeps the target in the middle of the picture
        _BEARING_REF: "T",
        _BEARING: bearing,
        _DISTANCE_REF: "K",
        _DISTANCE: _rational(Fraction(round(metres * 1000.0), 1_000_000)),
    }
    sea_m = _sea_m(drone, geotag.geoid_separation_m)
    if sea_m is not None:
        found[_ALT_REF] = bytes([sea_m < 0.0])
        found[_ALT] = _rational(Fraction(round(abs(sea_m) * 1000.0), 1000))
    return found


def _sea_m(place: Geodetic, separation_m: float | None) -> float | None:
    if place.datum == "amsl":
        return place.alt_m
    return place.alt_m - separation_m if place.datum == "ellipsoid" and separation_m is not None else None


def _angle(degrees: float, letters: str) -> tuple[str, tuple[IFDRational, IFDRational, IFDRational]]:
    """Degrees, minutes and seconds to the millionth: 0.03 mm."""
    micro = round(abs(degrees) * 3_600_000_000)
    whole, rest = divmod(micro, 3_600_000_000)
    minutes, seconds = divmod(rest, 60_000_000)
    return letters[degrees < 0.0], (
        IFDRational(whole),
        IFDRational(minutes),
        IFDRational(seconds, 1_000_000),
    )


def _rational(value: Fraction) -> IFDRational:
    return IFDRational(value.numerator, value.denominator)


def _ascii(text: str) -> str:
    return text.replace("°", " deg").encode("ascii", "replace").decode("ascii")


def _xmp(geotag: Geotag) -> bytes:
    """The target in our own namespace, beside the names that photo programs read."""
    place = geotag.place
    values = {
        "sidestep:Id": geotag.id,
        "sidestep:Number": str(geotag.number),
        "sidestep:TimeUtc": zulu(geotag.time_utc),
        "sidestep:TargetLatitude": f"{place.lat_deg:.9f}",
        "sidestep:TargetLongitude": f"{place.lon_deg:.9f}",
        "sidestep:TargetAltitude": f"{place.alt_m:.3f}",
        "sidestep:AltitudeDatum": place.datum,
        "sidestep:Ce90Metres": f"{geotag.ce90_m:.3f}",
        "sidestep:Le90Metres": f"{geotag.le90_m:.3f}",
        "sidestep:CovarianceEnu": json.dumps(geotag.covariance),
        "sidestep:Method": f"{geotag.method}, {geotag.model}",
        "sidestep:Flight": geotag.provenance.flight_id,
        "xmp:CreatorTool": geotag.provenance.software,
    }
    if geotag.speed_m_s is not None and geotag.course_rad is not None:
        values["sidestep:SpeedMetresPerSecond"] = f"{geotag.speed_m_s:.3f}"
        values["sidestep:CourseDegrees"] = f"{math.degrees(geotag.course_rad):.2f}"
    attributes = " ".join(f"{name}={quoteattr(xml_text(value))}" for name, value in values.items())
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>'
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" xmlns:xmp="http://ns.adobe.com/xap/1.0/" xmlns:sidestep="{NAMESPACE}" '
        f'{attributes}/></rdf:RDF></x:xmpmeta><?xpacket end="r"?>'
    ).encode()
