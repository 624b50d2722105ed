"""Geotags as a TAK data package: a zip that ATAK imports, with the markers, the ellipses and the pictures.

The manifest's `uid` parameter of a picture ties it to its marker.
"""

from __future__ import annotations

import hashlib
import uuid
import xml.etree.ElementTree as ET
from collections.abc import Sequence

from gcs_plugin.cot.event import ellipse_event, target_event, target_uid
from gcs_plugin.exports.archive import picture_name, zipped
from gcs_plugin.geotags.geotag import Geotag
from gcs_plugin.xml_text import element
from mission.settings import TakSettings


def to_data_package(geotags: Sequence[Geotag], settings: TakSettings | None = None) -> bytes:
    """The zip file.

    Args:
        geotags: what it holds.
        settings: of the events; the defaults without them.
    """
    chosen = settings or TakSettings()
    manifest = ET.Element("MissionPackageManifest", version="2")
    configuration = element(manifest, "Configuration")
    names = ",".join(geotag.id for geotag in geotags)
    element(configuration, "Parameter", name="uid", value=str(uuid.uuid5(uuid.NAMESPACE_URL, f"sidestep:{names}")))
    element(configuration, "Parameter", name="name", value="Sidestep targets")
    contents = element(manifest, "Contents")
    files: dict[str, bytes] = {"MANIFEST/manifest.xml": b""}
    for index, geotag in enumerate(geotags, 1):
        uid = target_uid(geotag)
        folder = hashlib.sha256(uid.encode("utf-8", "backslashreplace")).hexdigest()[:16]
        now = geotag.time_utc
        made = {
            f"{folder}/target.cot": (uid, target_event(geotag, chosen, now)),
            f"{folder}/ellipse.cot": (f"{uid}.ellipse", ellipse_event(geotag, chosen, now)),
        }
        if geotag.picture:
            made[f"{folder}/{picture_name(geotag.number or index, geotag.picture_type)}"] = (uid, geotag.picture)
        for name, (owner, data) in made.items():
            content = element(contents, "Content", ignore="false", zipEntry=name)
            element(content, "Parameter", name="uid", value=owner)
            files[name] = data
    ET.indent(manifest)
    files["MANIFEST/manifest.xml"] = ET.tostring(manifest, encoding="utf-8")
    return zipped(files)
