"""XML elements whose texts come from outside."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from datetime import UTC, datetime


def element(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    """A child element; what XML cannot hold in its text and attributes is replaced."""
    made = ET.SubElement(parent, tag, {name: xml_text(value) for name, value in attributes.items()})
    if text is not None:
        made.text = xml_text(text)
    return made


def document(root: ET.Element) -> bytes:
    """The whole document, indented, in UTF-8."""
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'.encode()


def xml_text(text: str) -> str:
    """The text with what XML 1.0 cannot hold (production 2, Char) replaced: control characters, half a surrogate."""
    return "".join(c if _in_xml(c) else "\N{REPLACEMENT CHARACTER}" for c in text)


def zulu(time_utc: datetime) -> str:
    """ISO 8601 in UTC to the millisecond, with Z."""
    return time_utc.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _in_xml(character: str) -> bool:
    return character in "\t\n" or (
        character >= " " and not "\ud800" <= character <= "\udfff" and character not in "\ufffe\uffff"
    )
