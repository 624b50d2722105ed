"""One order to the autopilot: when to send it, and when it may be sent again.

A lost answer is no reason to order again: the order may have been carried out, and the pilot may have undone it since.
"""

from __future__ import annotations

from mission.vehicle.pilot.controls import Controls, Ordered

_AGAIN_S = 0.7
_ON_ITS_WAY_S = 0.3
"""A report that comes sooner after an order may have left the autopilot before it."""


class Request:
    """Sent once, and again only where it was surely not carried out.

    That is so when the autopilot refused it, or when it did not answer though no packet of its is missing since. On a
    link that is known to lose packets that cannot be known: there it is so when the autopilot has reported since that
    nothing changed (a change that was undone at once, whose reports and answer were all lost, is not seen).

    Args:
        order: what is ordered.
    """

    def __init__(self, order: Ordered) -> None:
        self._order = order
        self._sent_s: float | None = None
        self._attempt = -1

    def due(self, controls: Controls, now_s: float, unchanged_s: float | None) -> int | None:
        """The number of the attempt (0 the first) when the order is to be sent now, None when it is not.

        Whoever asks has made sure that nobody else changed what is ordered, and sends at once.

        Args:
            controls: tell what the autopilot answered.
            now_s: program time.
            unchanged_s: when the autopilot last reported that it is still as before the order.
        """
        if self._sent_s is not None and not self._may_repeat(controls, self._sent_s, now_s, unchanged_s):
            return None
        self._sent_s, self._attempt = now_s, self._attempt + 1
        return self._attempt

    def _may_repeat(self, controls: Controls, sent_s: float, now_s: float, unchanged_s: float | None) -> bool:
        if now_s - sent_s < _AGAIN_S:
            return False
        answer = controls.answer(self._order, sent_s)
        if answer == "lossy":
            return unchanged_s is not None and unchanged_s - sent_s > _ON_ITS_WAY_S
        return answer in ("refused", "not-received")
