"""Which of the people in view is the target."""

from __future__ import annotations

from collections.abc import Sequence

from mission.errors import DetectionError
from mission.records import Box, Detection


def choose(
    detections: Sequence[Detection],
    image_size: tuple[int, int],
    box: Box | None = None,
    point: tuple[float, float] | None = None,
) -> Detection:
    """Choose the target: the operator's box or point decides, otherwise whoever is nearest to the image centre.

    Args:
        detections: the people found.
        image_size: width and height, pixels.
        box: drawn by the operator, pixels of this picture.
        point: clicked by the operator, pixels of this picture; `box` wins over it.

    Raises:
        DetectionError: nobody is in view, or nobody is where the operator pointed.
    """
    if not detections:
        raise DetectionError(
            "Nobody was found in the picture",
            "Point the camera at the person (a body of at least 40 px in the picture is needed) and try again.",
        )
    if box is not None:
        marked = [d for d in detections if _marked(d.box, box)]
        if not marked:
            raise DetectionError(_where(detections, "inside the box that was drawn"), _POINT_AGAIN)
        return max(marked, key=lambda d: d.box.overlap(box))
    if point is not None:
        # A click misses thin bodies easily, so half a body's width beside the box still counts.
        near = [d for d in detections if _grown(d.box).contains(*point)]
        if not near:
            raise DetectionError(_where(detections, "where the operator pointed"), _POINT_AGAIN)
        return min(near, key=lambda d: _distance(d, point))
    centre = (image_size[0] / 2.0, image_size[1] / 2.0)
    return min(detections, key=lambda d: _distance(d, centre))


_BESIDE = 0.1
_HALF = 0.5
_POINT_AGAIN = "Draw the box or click on the body of one of the people that were found, or leave it out."


def _marked(body: Box, drawn: Box) -> bool:
    """Whether a drawn box means this body: operators draw wide around it, on its middle, or a little beside it.

    Wide around: half of the body is inside. On its middle: half of what was drawn is on the body. Beside: they share a
    tenth of the area that they cover together.
    """
    part = body.overlap(drawn)
    sizes = body.width_px * body.height_px, drawn.width_px * drawn.height_px
    shared_px = part / (1.0 + part) * sum(sizes)
    return part >= _BESIDE or shared_px >= _HALF * min(sizes) > 0.0


def _where(detections: Sequence[Detection], where: str) -> str:
    places = ", ".join(f"({d.box.centre_px[0]:.0f}, {d.box.centre_px[1]:.0f})" for d in detections)
    return f"Nobody was found {where}; people are at pixels {places}"


def _grown(box: Box) -> Box:
    return Box(box.left_px - box.width_px / 2, box.top_px, box.width_px * 2, box.height_px)


def _distance(detection: Detection, point: tuple[float, float]) -> float:
    """How far the point is from the body's centre, in units of the body's half width and half height."""
    x, y = detection.box.centre_px
    return max(
        abs(x - point[0]),
        # Heights differ little between people in view and the camera may be tilted: what counts is mostly the side.
        0.25 * abs(y - point[1]),
    )
