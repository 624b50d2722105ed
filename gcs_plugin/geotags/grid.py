"""Places as MGRS grid references (NGA.STND.0037), as rescue teams and soldiers speak them."""

from __future__ import annotations

from mgrs import MGRS

_CONVERTER = MGRS()


def grid_reference(lat_deg: float, lon_deg: float) -> str:
    """The one-metre square that holds a place on WGS 84: zone, square, easting, northing ("52S CG 08418 22306").

    Like every grid reference it is cut off, not rounded: the place is up to a metre north and east of it.
    """
    reference = str(_CONVERTER.toMGRS(lat_deg, lon_deg, MGRSPrecision=5))
    digits = reference[-10:]
    square = reference[-12:-10]
    return " ".join(part for part in (reference[:-12], square, digits[:5], digits[5:]) if part)
