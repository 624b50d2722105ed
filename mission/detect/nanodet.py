"""People by NanoDet, a small convolutional network, through OpenCV's own inference (no other library is needed).

The network (nanodet.onnx, see nanodet.LICENSE.md) sees people of a fifth of the size that HOG needs. It answers,
for each cell of three grids with strides of 8, 16 and 32 px, 80 class scores and, per side of the box, a distribution
over 11 distances in strides (Generalized Focal Loss, Li et al. 2020): the distance is the distribution's mean.
"""

from __future__ import annotations

import threading
from importlib import resources

import cv2
import numpy as np

from mission.detect.detector import crop, suppress
from mission.errors import DetectionError
from mission.records import Box, Detection, Image, Vector

INPUT_PX = 416
"""The size that the network was trained for; any multiple of 32 works, as it is convolutional."""
STRIDES_PX = (8, 16, 32)
PERSON = 0
"""COCO class."""
BINS = 11

# The normalisation that it was trained with, upstream's (B, G, R).
_MEAN = np.array([103.53, 116.28, 123.675], np.float32)
_INVERSE_STD = 1.0 / np.array([57.375, 57.12, 58.395], np.float32)


class NanoDet:
    """The network; one forward pass at a time.

    Raises:
        DetectionError: the installed OpenCV cannot read the network.
    """

    def __init__(self) -> None:
        weights = resources.files("mission.detect").joinpath("nanodet.onnx").read_bytes()
        try:
            self._net = cv2.dnn.readNetFromONNX(np.frombuffer(weights, np.uint8))
        except cv2.error as error:
            raise DetectionError(
                f"OpenCV {cv2.__version__} cannot read the NanoDet network ({error.err})",
                "Install opencv-python-headless 4.10 or newer below 5, or choose the hog detector.",
            ) from error
        self._outputs = self._net.getUnconnectedOutLayersNames()
        self._lock = threading.Lock()

    def people(self, image: Image, threshold: float) -> list[Detection]:
        """All cells that see a person, before non-maximum suppression.

        Args:
            image: BGR; height and width are multiples of 32 px.
            threshold: smallest class score, 0 to 1.
        """
        width = image.shape[1]
        blob = ((image.astype(np.float32) - _MEAN) * _INVERSE_STD).transpose(2, 0, 1)[None]
        with self._lock:
            self._net.setInput(np.ascontiguousarray(blob))
            outputs = self._net.forward(self._outputs)
        found: list[Detection] = []
        for stride, scores, distances in zip(STRIDES_PX, outputs[:3], outputs[3:], strict=True):
            person = scores[0, :, PERSON]
            for cell in np.flatnonzero(person >= threshold):
                row, column = divmod(int(cell), width // stride)
                left, top, right, bottom = _expected_distance(distances[0, cell]) * stride
                x, y = (column + 0.5) * stride, (row + 0.5) * stride
                box = Box(x - left, y - top, left + right, top + bottom)
                found.append(Detection(box, float(person[cell])))
        return found


def _expected_distance(logits: Vector) -> Vector:
    """Mean of the distribution of each of the four sides (left, top, right, bottom), in strides."""
    sides = logits.reshape(4, BINS).astype(np.float64)
    likelihood = np.exp(sides - sides.max(axis=1, keepdims=True))
    return np.asarray(likelihood @ np.arange(BINS) / likelihood.sum(axis=1))


class NanoDetDetector:
    """NanoDet on the whole picture, or on a part of it enlarged to the network's input.

    Args:
        threshold: smallest class score that counts, 0 to 1.
        network: to share one that is already loaded.
    """

    def __init__(self, threshold: float = 0.4, network: NanoDet | None = None) -> None:
        self._threshold = threshold
        self._network = network or NanoDet()

    @property
    def name(self) -> str:
        """``nanodet``."""
        return "nanodet"

    def detect(self, image: Image, region: Box | None = None) -> list[Detection]:
        """See `mission.detect.detector.Detector.detect`."""
        part, left, top = crop(image, region)
        if part.shape[0] < 16 or part.shape[1] < 8:
            return []
        scale = min(INPUT_PX / max(part.shape[:2]), 4.0)
        shrunk = cv2.resize(
            part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        )
        canvas = np.full((_up32(shrunk.shape[0]), _up32(shrunk.shape[1]), 3), 114, np.uint8)
        canvas[: shrunk.shape[0], : shrunk.shape[1]] = shrunk
        found = suppress(self._network.people(canvas, self._threshold), self._threshold, 0.5)
        fx, fy = shrunk.shape[1] / part.shape[1], shrunk.shape[0] / part.shape[0]
        return [
            Detection(
                Box(left + d.box.left_px / fx, top + d.box.top_px / fy, d.box.width_px / fx, d.box.height_px / fy),
                d.score,
            )
            for d in found
        ]


class WindowedNanoDet:
    """NanoDet on an upright window (`mission.detect.window`) with the body about 96 px tall: the body's extent, finely.

    The boxes of all cells that see the same person are averaged, weighted by the square of their score.
    """

    BODY_PX = 96.0
    SIZE = (128, 160)

    def __init__(self, network: NanoDet, threshold: float = 0.3) -> None:
        self._network = network
        self._threshold = threshold

    def bodies(self, image: Image) -> list[Detection]:
        """All people in the window, window pixels, best first.

        Args:
            image: the window, BGR; height and width are multiples of 32 px.
        """
        cells = self._network.people(image, self._threshold)
        return [_averaged(best, cells) for best in suppress(cells, self._threshold, 0.5)]


def _averaged(best: Detection, cells: list[Detection]) -> Detection:
    same = [d for d in cells if d.box.overlap(best.box) > 0.6]
    weights = np.array([d.score**2 for d in same])
    sides = [(d.box.left_px, d.box.top_px, d.box.width_px, d.box.height_px) for d in same]
    left, top, width, height = np.average(sides, axis=0, weights=weights)
    return Detection(Box(float(left), float(top), float(width), float(height)), best.score)


def _up32(pixels: int) -> int:
    return -(-pixels // 32) * 32
