"""Local east-north-up to latitude and longitude and back, near one point of the ellipsoid.

The autopilot reports at 50 Hz on several links, so this is the tangent-plane form with the two radii of curvature; a
test holds it against the exact transformation.
"""

from __future__ import annotations

import math

from sitl.autopilot.rotation import Vec

_A = 6378137.0
_E2 = 6.69437999014e-3


class LocalFrame:
    """The plane that touches the ellipsoid's parallel surface at a geodetic point (degrees, metres above sea level)."""

    def __init__(self, lat_deg: float, lon_deg: float, alt_amsl_m: float, geoid_separation_m: float) -> None:
        self.lat_deg, self.lon_deg, self.alt_amsl_m = lat_deg, lon_deg, alt_amsl_m
        self.geoid_separation_m = geoid_separation_m
        height = alt_amsl_m + geoid_separation_m
        sine = math.sin(math.radians(lat_deg))
        w2 = 1.0 - _E2 * sine * sine
        self._north_m_per_deg = math.radians(_A * (1.0 - _E2) / w2**1.5 + height)
        self._east_m_per_deg = math.radians((_A / math.sqrt(w2) + height) * math.cos(math.radians(lat_deg)))

    def geodetic(self, position: Vec) -> Vec:
        """(latitude, longitude, altitude above mean sea level) of an ENU position."""
        return (
            self.lat_deg + position[1] / self._north_m_per_deg,
            self.lon_deg + position[0] / self._east_m_per_deg,
            self.alt_amsl_m + position[2],
        )

    def enu(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> Vec:
        """The ENU position of a geodetic one."""
        return (
            (lon_deg - self.lon_deg) * self._east_m_per_deg,
            (lat_deg - self.lat_deg) * self._north_m_per_deg,
            alt_amsl_m - self.alt_amsl_m,
        )
