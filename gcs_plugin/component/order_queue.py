"""The desk between the link and the loop that does the work: at most one order waits or runs."""

from __future__ import annotations

from collections.abc import Callable

from gcs_plugin.component.orders import LocateOrder, Order


class OrderQueue:
    """Orders in, one at a time; the loop takes them, and asks whether it should stop.

    Args:
        refusal: why the aircraft cannot carry out an order now, in the operator's words; empty when it can.
    """

    def __init__(self, refusal: Callable[[Order], str]) -> None:
        self._refusal = refusal
        self._waiting: Order | None = None
        self._running: Order | None = None
        self._stop = False

    @property
    def busy(self) -> bool:
        """Whether an order waits or runs."""
        return self._waiting is not None or self._running is not None

    @property
    def waiting(self) -> bool:
        """Whether an order waits that the loop has not taken yet."""
        return self._waiting is not None

    @property
    def flying(self) -> bool:
        """Whether an order to fly waits or runs."""
        return isinstance(self._waiting, LocateOrder) or isinstance(self._running, LocateOrder)

    def why_not(self, order: Order) -> str:
        """Why an order is not taken now; empty when it is. Orders that only track give way to any other."""
        if self.flying:
            return "busy: another locate is running"
        return self._refusal(order)

    def put(self, order: Order) -> None:
        """Leave an order; what runs and does not fly ends."""
        self._waiting = order
        self._stop = self._running is not None

    def take(self) -> Order | None:
        """The order that waits, which now runs."""
        if self._waiting is not None:
            self._running, self._waiting, self._stop = self._waiting, None, False
            return self._running
        return None

    def stop(self) -> bool:
        """Ask for an end of whatever waits or runs; whether there was any."""
        any_order = self.busy
        self._waiting = None
        self._stop = self._running is not None
        return any_order

    def should_stop(self) -> bool:
        """Whether the loop should end what it does."""
        return self._stop

    def done(self) -> None:
        """The order that ran has ended."""
        self._running, self._stop = None, False
