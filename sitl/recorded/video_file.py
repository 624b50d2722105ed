"""Pictures into an MP4 file as drones record it: H.264, constant rate, no B-frames."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

from mission.records import Image


def write_video(path: Path, pictures: Iterable[Image], fps: float, bit_rate: int = 4_000_000) -> int:
    """Write a video; returns the number of pictures.

    Args:
        path: of the file.
        pictures: BGR, all of one size.
        fps: pictures a second.
        bit_rate: bits a second.
    """
    number = 0
    rate = Fraction(fps).limit_denominator(1000)
    with av.open(str(path), "w") as out:
        stream = None
        for picture in pictures:
            if stream is None:
                options = {"preset": "superfast", "bf": "0", "g": str(round(fps)), "threads": "1"}
                stream = out.add_stream("libx264", rate=rate, options=options)
                stream.height, stream.width = picture.shape[:2]
                stream.pix_fmt, stream.bit_rate = "yuv420p", bit_rate
            yuv = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420), np.uint8)
            frame = av.VideoFrame.from_ndarray(yuv, "yuv420p")
            frame.pts, frame.time_base = number, 1 / rate
            out.mux(stream.encode(frame))
            number += 1
        if stream is not None:
            out.mux(stream.encode())
    return number
