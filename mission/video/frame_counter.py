"""Stamps that count frames instead of telling the time: their rate, from when the frames arrived.

Some cameras stamp each frame one nominal interval after the last one, whatever they really deliver. Their clock then
runs evenly, but several per cent too fast or too slow, which no real clock does. A straight line through the arrivals
of the last seconds gives its rate; its offset is that of the least delayed frames, as everywhere (`mission.clock`).
"""

from __future__ import annotations

from collections import deque
from typing import Final

import numpy as np

_KEPT_S: Final = 10.0
_SPAN_S: Final = 4.0
"""A rate from less than this would be jitter."""
_EVERY: Final = 5
"""Frames between two fits."""
_UNEVEN_S: Final = 0.04
"""Arrivals that stray further from a line (rms) follow none."""
_LEAST_DELAYED: Final = 5.0
"""Percentile."""


class FrameCounter:
    """The line from stamps to arrivals, fitted again every few frames."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, float]] = deque()
        self._since_fit = 0
        self._line: tuple[float, float, float] | None = None

    def observe(self, stamp_s: float, arrived_s: float) -> None:
        """Take in a frame: its stamp, and when it arrived."""
        self._seen.append((stamp_s, arrived_s))
        while arrived_s - self._seen[0][1] > _KEPT_S:
            self._seen.popleft()
        self._since_fit += 1
        if self._since_fit >= _EVERY:
            self._since_fit = 0
            self._fit()

    @property
    def rate(self) -> float | None:
        """Seconds of the stamps for each second of the arrivals; None where they follow no line, or not long enough."""
        return None if self._line is None else 1.0 / self._line[0]

    def to_local(self, stamp_s: float) -> float:
        """Arrival of a frame that is not delayed.

        Raises:
            ValueError: there is no line.
        """
        if self._line is None:
            raise ValueError("the rate of the stamps is not known")
        slope, stamp, arrived = self._line
        return arrived + slope * (stamp_s - stamp)

    def _fit(self) -> None:
        seen = np.array(self._seen)
        stamps, arrived = seen[:, 0] - seen[-1, 0], seen[:, 1] - seen[-1, 1]
        spread = float(np.square(stamps - stamps.mean()).sum())
        if -arrived[0] < _SPAN_S or spread < 1e-9:
            return
        slope = float((stamps - stamps.mean()) @ (arrived - arrived.mean())) / spread
        off = arrived - slope * stamps
        if not slope > 0.0 or float(off.std()) > _UNEVEN_S:
            self._line = None
            return
        self._line = slope, float(seen[-1, 0]), float(seen[-1, 1] + np.percentile(off, _LEAST_DELAYED))
