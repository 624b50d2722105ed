"""New frames while the flight goes well: the loop that every stage of the procedure runs in.

Each turn of it looks at what the operator, the pilot, the failsafes and the link did, and ends the stage by an
exception as soon as one of them ended the flight. Reading the drone's telemetry here is also what keeps the pilot
process from stopping the aircraft.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, TypeVar

from mission.errors import Aborted, FlightEnded, FlightRefused, LinkError, SidestepError, VideoError
from mission.records import Frame
from mission.vehicle.drone import Drone, Order, OrderState
from mission.video import VideoSource

Result = TypeVar("Result")

VIDEO_LOST_S = 1.0
"""No new picture for this long: the video has stopped."""
FRAME_WAIT_S = 0.05
"""How long one turn waits for a picture; well below the deadman's time."""


class FlightLoop:
    """Frames of a flight, and the order that is being flown.

    Args:
        drone: the aircraft.
        video: its camera's pictures.
        aborted: answers True as soon as the operator wants an end.
        clock: the program's clock, seconds.
        caution: is told what the autopilot would do that the operator may not expect.
        serve: called in every turn: what else this thread has to do meanwhile, such as answering ground stations.
    """

    def __init__(
        self,
        drone: Drone,
        video: VideoSource,
        aborted: Callable[[], bool],
        clock: Callable[[], float],
        caution: Callable[[str], None],
        serve: Callable[[], None] = lambda: None,
    ) -> None:
        self._drone = drone
        self._video = video
        self._aborted = aborted
        self._clock = clock
        self._caution = caution
        self._serve = serve
        self._order: Order | None = None
        self._last_index = -1
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="sidestep-work")
        self.last_frame_s = clock()
        """Program time at which the newest frame was taken up."""
        self.ours = False
        """Whether the aircraft is under our control, as far as is known."""
        self._work: Future[Any] | None = None

    def fly(self, order: Order) -> None:
        """From here the loop watches this order."""
        self._order = order
        self.ours = True

    def until_done(self, timeout_s: float) -> Iterator[Frame]:
        """Frames until the order that is being flown is done.

        Raises:
            FlightEnded: it is not done within the time.
            SidestepError: anything else that `frames` raises.
        """
        order = self._order
        for frame in self.frames(timeout_s):
            yield frame
            if order is None or order.state is OrderState.DONE:
                return
        raise FlightEnded(f"the aircraft did not finish its {order.kind if order else 'order'}", "It holds its place.")

    @property
    def video_note(self) -> str:
        """What is wrong with the video and was put right; empty where nothing is."""
        return self._video.stats().note

    def frames(self, timeout_s: float) -> Iterator[Frame]:
        """New frames, newest first, until the time is over.

        Raises:
            FlightEnded: abort, pilot or failsafe.
            FlightRefused: the aircraft does not take the order.
            LinkError: the link is gone.
            VideoError: no picture for `VIDEO_LOST_S`.
        """
        started = self._clock()
        self.last_frame_s = max(self.last_frame_s, started)
        while self._clock() - started < timeout_s:
            self._check()
            frame = self._video.latest(self._last_index, FRAME_WAIT_S)
            if frame is not None:
                self._last_index, self.last_frame_s = frame.index, self._clock()
                yield frame
            elif self._clock() - self.last_frame_s > VIDEO_LOST_S:
                why = self._video.stats().error
                raise VideoError(
                    f"no picture for {VIDEO_LOST_S:.0f} s{f' ({why})' if why else ''}",
                    "Check the camera and the video link; the aircraft holds.",
                )

    def meanwhile(self, work: Callable[[], Result]) -> Result:
        """Do something long in another thread while the flight is watched here.

        Raises:
            SidestepError: what `frames` raises, at once, although the work goes on; else what the work raises.
        """
        future = self._worker.submit(work)
        while not future.done():
            self._check()
            wait((future,), timeout=FRAME_WAIT_S)
        return future.result()

    def through(self, work: Callable[[], Result]) -> tuple[Result, SidestepError | None]:
        """The same for work that takes no flying and is worth its end whoever has the aircraft by then.

        Returns:
            What the work returns, and what ended the flight meanwhile.

        Raises:
            Aborted: the operator wants no more of it; at once, see `wait_for_work`.
            SidestepError: what the work raises; where the flight was ended meanwhile, its end beside that.
        """
        future, ended = self._worker.submit(work), None
        self._work = future
        while not future.done():
            try:
                self._check()
            except Aborted:
                raise
            except (FlightEnded, LinkError) as error:
                ended = ended or error
            wait((future,), timeout=FRAME_WAIT_S)
        try:
            return future.result(), ended
        except SidestepError as error:
            if ended is None:
                raise
            raise type(ended)(f"{ended.cause}; {error.cause}", ended.remedy) from error

    def wait_for_work(self, timeout_s: float = 10.0) -> None:
        """After an abort and the hold that followed: until the work in the other thread has ended."""
        for _ in range(round(timeout_s / FRAME_WAIT_S)):
            if self._work is None or self._work.done():
                return
            self._drone.telemetry()
            self._serve()
            wait((self._work,), timeout=FRAME_WAIT_S)

    def release_control(self, timeout_s: float = 5.0) -> str:
        """Order hold, unless somebody else has the aircraft; wait until it holds.

        Returns:
            Nothing when it holds, otherwise why that is not confirmed.
        """
        if not self.ours:
            return ""
        self.ours = False
        order = self._drone.hold()
        deadline = self._clock() + timeout_s
        while order.state in (OrderState.PENDING, OrderState.FLYING) and self._clock() < deadline:
            self._drone.telemetry()
            self._serve()
            self._video.latest(self._last_index, FRAME_WAIT_S)
        return "" if order.state is OrderState.DONE else order.reason or "no answer"

    def _check(self) -> None:
        for event in self._drone.events():
            if event.kind in ("pilot", "failsafe", "deadman", "pilot-process-lost"):
                self.ours = False
                raise FlightEnded(event.text, "Give the order again when the aircraft is yours.")
            if event.kind == "caution":
                self._caution(event.text)
            if event.kind == "gimbal-lost":
                raise FlightEnded(event.text, "Check the gimbal and its link; the aircraft holds.")
            if event.kind == "link-lost":
                raise LinkError(event.text, "Check the link; the autopilot's own failsafe holds the aircraft.")
        self._serve()
        if self._aborted():
            raise Aborted("aborted by the operator")
        if not self._drone.telemetry().connected:
            raise LinkError("telemetry stopped", "Check the link; the autopilot's own failsafe holds the aircraft.")
        order = self._order
        if order is not None and order.state is OrderState.REFUSED:
            self.ours = False
            raise FlightRefused(order.reason, "Nothing was flown.")
        if order is not None and order.state is OrderState.ENDED:
            self.ours = False
            raise FlightEnded(order.reason)
