"""What an autopilot reported over a flight, before it is written in some format."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mission.records import Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class Reports:
    """n reports on the vehicle's own clock."""

    t_s: Vector
    """(n,) since boot, ascending."""
    lat_lon_amsl: Matrix
    """(n, 3) degrees, degrees, m."""
    velocity_enu_m_s: Matrix
    """(n, 3)."""
    roll_pitch_yaw_rad: Matrix
    """(n, 3)."""
    height_m: Vector
    """(n,) above the take-off point."""
    tilt_down_rad: float = 0.0
    """Of the camera, fixed on the airframe; logs that tell a gimbal's angles need it."""
    geoid_separation_m: float = 40.0
    utc_at_zero_s: float = 1.79e9
    accuracy_m: float = 0.3
    """What the GPS receiver states."""

    def thinned(self, rate_hz: float) -> Reports:
        """Not more than so many reports a second."""
        kept, last = [], -np.inf
        for place, t_s in enumerate(self.t_s.tolist()):
            if t_s >= last + 1.0 / rate_hz - 1e-6:
                kept.append(place)
                last = t_s
        return self._only(np.array(kept))

    def at(self, t_s: Vector) -> Reports:
        """Interpolated at other times (m,) within the flight; what a camera that logs each frame writes."""
        angles = np.unwrap(self.roll_pitch_yaw_rad, axis=0)

        def between(values: Matrix) -> Matrix:
            return np.column_stack([np.interp(t_s, self.t_s, column) for column in values.T])

        return Reports(
            np.asarray(t_s, dtype=float),
            between(self.lat_lon_amsl),
            between(self.velocity_enu_m_s),
            between(angles),
            np.interp(t_s, self.t_s, self.height_m),
            self.tilt_down_rad,
            self.geoid_separation_m,
            self.utc_at_zero_s,
            self.accuracy_m,
        )

    def _only(self, places: np.ndarray[tuple[int], np.dtype[np.intp]]) -> Reports:
        return Reports(
            self.t_s[places],
            self.lat_lon_amsl[places],
            self.velocity_enu_m_s[places],
            self.roll_pitch_yaw_rad[places],
            self.height_m[places],
            self.tilt_down_rad,
            self.geoid_separation_m,
            self.utc_at_zero_s,
            self.accuracy_m,
        )
