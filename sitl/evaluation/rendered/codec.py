"""The video's way through H.264 and back, one picture at a time."""

from __future__ import annotations

from fractions import Fraction

import av
import cv2
import numpy as np
from av.video.codeccontext import VideoCodecContext

from mission.errors import VideoError
from mission.records import Image
from sitl.scenario.schema import CameraSettings


class H264:
    """An encoder as drones have it (fast, no look-ahead, no B-frames, a key frame each second), and its decoder.

    Args:
        camera: picture size, rate, bit rate.
    """

    def __init__(self, camera: CameraSettings) -> None:
        rate = Fraction(camera.fps).limit_denominator(1000)
        bit_rate = camera.bitrate_kbit_s * 1000
        encoder = VideoCodecContext.create("libx264", "w")
        encoder.width, encoder.height, encoder.pix_fmt = camera.width_px, camera.height_px, "yuv420p"
        encoder.bit_rate, encoder.framerate, encoder.time_base = bit_rate, rate, 1 / rate
        encoder.options = {
            "preset": "superfast",
            "tune": "zerolatency",
            "g": str(max(1, round(camera.fps))),
            "bf": "0",
            "threads": "1",
            "maxrate": str(bit_rate),
            "bufsize": str(bit_rate // 2),
        }
        decoder = VideoCodecContext.create("h264", "r")
        decoder.thread_count = 1
        self._encoder, self._decoder, self._count = encoder, decoder, 0

    def through(self, picture: Image) -> Image:
        """What arrives of a picture, (height, width, 3).

        Raises:
            VideoError: the picture did not come back at once.
        """
        frame = av.VideoFrame.from_ndarray(
            np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420), np.uint8), "yuv420p"
        )
        frame.pts, frame.time_base = self._count, self._encoder.time_base
        self._count += 1
        decoded = [image for packet in self._encoder.encode(frame) for image in self._decoder.decode(packet)]
        if len(decoded) != 1:
            raise VideoError(f"the codec gave {len(decoded)} pictures for one")
        return np.asarray(cv2.cvtColor(decoded[0].to_ndarray(), cv2.COLOR_YUV2BGR_I420), np.uint8)
