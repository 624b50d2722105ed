"""``python -m sitl.real_video vtest.avi``: follow everybody who is annotated, one after the other, and count.

With ``--unannotated`` whoever NanoDet sees in every hundredth frame is followed instead, in any video with people.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from mission.detect import NanoDetDetector
from mission.detect.nanodet import NanoDet
from mission.errors import DetectionError, VideoError
from mission.records import Box, Frame, Image
from mission.track import Track, Tracker
from sitl.real_video.annotations import Annotations, Walker, apart, read
from sitl.real_video.score import Followed, Steadiness, followed, steadiness

_EVERY = 100
_FOR = 200
"""Without annotations: frames between two starts, and for how many each is followed."""


def frames(path: Path, rate_hz: float, first: int = 0, last: int | None = None) -> list[Frame]:
    """Pictures of a video, at a rate that is known better than the file knows it.

    Args:
        path: of the video.
        rate_hz: frames a second.
        first: index of the first one wanted.
        last: and of the last one; all that follow without it.

    Raises:
        VideoError: OpenCV cannot read it.
    """
    video = cv2.VideoCapture(str(path))
    answer: list[Frame] = []
    index = 0
    while last is None or index <= last:
        done, image = video.read()
        if not done:
            break
        if index >= first:
            picture: Image = np.asarray(image, np.uint8)
            answer.append(Frame(picture, index / rate_hz, index))
        index += 1
    if not answer:
        raise VideoError(f"{path} holds no such picture", "vtest.avi is in Debian's package opencv-doc.")
    return answer


def follow(video: Sequence[Frame], box: Box, tracker: Tracker) -> list[Track]:
    """The tracks of who is in a box of the first frame through the others; none where nobody is seen in it."""
    try:
        tracker.start(video[0], box)
    except DetectionError:
        return []
    return [tracker.update(frame) for frame in video[1:]]


def begin(walker: Walker, known: Annotations, width_px: int) -> int:
    """The first frame in which somebody is alone and whole: where an operator would draw the box."""
    for frame, box in sorted(walker.boxes.items()):
        inside = box.left_px > 10.0 and box.right_px < width_px - 10.0
        if inside and not any(box.overlap(other) > 0.05 for other in known.others(walker, frame)):
            return frame
    return min(walker.boxes)


def unannotated(video: Sequence[Frame], network: NanoDet) -> Iterator[Steadiness]:
    """Follow everybody whom NanoDet sees alone in some frames."""
    detector = NanoDetDetector(network=network)
    for first in range(0, len(video) - 20, _EVERY):
        boxes = [d.box for d in detector.detect(video[first].image) if d.score > 0.5]
        for box in boxes:
            if box.height_px > 50.0 and not any(b is not box and apart(b, box) < 0.6 for b in boxes):
                tracks = follow(video[first : first + _FOR], box, Tracker(network))
                if tracks:
                    yield steadiness(tracks)


def main(arguments: Sequence[str] | None = None) -> None:
    """Follow, and print."""
    parser = argparse.ArgumentParser(prog="python -m sitl.real_video", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("video", type=Path, help="vtest.avi, or with --unannotated any other")
    parser.add_argument("--half", choices=("development", "held-out", "both"), default="both")
    parser.add_argument("--rate", type=float, help="frames a second; the annotations' without it")
    parser.add_argument("--unannotated", action="store_true", help="look only at what shows without annotations")
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    known, network, console = read(), NanoDet(), Console()
    video = frames(options.video, options.rate or known.rate_hz)
    if options.unannotated:
        console.print(_steadiness_table(list(unannotated(video, network))))
        return
    results = []
    for walker in known.walkers:
        if options.half in (walker.half, "both"):
            first, last = begin(walker, known, video[0].image.shape[1]), max(walker.boxes)
            tracks = follow(video[first : last + 1], walker.boxes[first], Tracker(network))
            results.append((followed(walker, tracks, known), steadiness(tracks)))
    console.print(_followed_table([one for one, _ in results]))
    console.print(_steadiness_table([one for _, one in results]))


def _followed_table(results: Sequence[Followed]) -> Table:
    table = Table("person", "frames", "right %", "wrong %", "nowhere %", "coasting %", "lost %", "switches")
    total = Followed("all", *(sum(column) for column in zip(*(_counts(r) for r in results), strict=True)))
    for r in (*results, total):
        known = max(1, r.known)
        shares = (f"{100.0 * n / known:.1f}" for n in (r.right, r.wrong, r.nowhere, r.coasting, r.lost))
        table.add_row(r.name, str(r.known), *shares, str(r.switches))
    return table


def _counts(r: Followed) -> tuple[int, ...]:
    return r.known, r.right, r.wrong, r.nowhere, r.coasting, r.lost, r.switches


def _steadiness_table(results: Sequence[Steadiness]) -> Table:
    table = Table("walks", "frames", "held %", "fragments", "jumps", "scatter / stated", "of the size")
    frames = sum(r.frames for r in results)
    held = sum(r.held * r.frames for r in results) / max(1, frames)
    scatter, size = (np.nanmedian([getattr(r, name) for r in results]) for name in ("scatter", "size_scatter"))
    table.add_row(
        str(len(results)),
        str(frames),
        f"{100.0 * held:.1f}",
        str(sum(r.fragments for r in results)),
        str(sum(r.jumps for r in results)),
        f"{scatter:.2f}",
        f"{size:.2f}",
    )
    return table


if __name__ == "__main__":
    main()
