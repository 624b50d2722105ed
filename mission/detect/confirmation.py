"""Who is seen in two looks running: a detector takes other things for people now and then, seldom twice in a place."""

from __future__ import annotations

from collections.abc import Sequence

from mission.records import Detection

SAME_PERSON = 0.3
"""Overlap of two looks' boxes that are the same person."""


class Confirmation:
    """Confirms detections by the look before: two of two, the smallest M-of-N rule of track initiation."""

    def __init__(self) -> None:
        self._before: Sequence[Detection] = ()

    def confirmed(self, found: Sequence[Detection]) -> list[Detection]:
        """Those of this look that the look before had, too.

        Args:
            found: all that the detector found in this look's picture.
        """
        before, self._before = self._before, found
        return [d for d in found if any(d.box.overlap(other.box) > SAME_PERSON for other in before)]
