"""What the steadied poses of a flight are worth: the noise that goes into its header."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from mission.bundle.adjustment import AdjustedBundle
from mission.bundle.gauge_alignment import Similarity
from mission.records import NoiseModel

LEAST_STILL = 0.4
"""Share of the points that must agree with a world that stands still."""
_ENOUGH_STILL = 0.65
"""Share of them from which on the rest does no harm."""
_CORRELATION_S = 2.0
_DIRECTION_SIGMA_RAD = math.radians(0.4)
"""How far the path's direction, seen from the camera, is turned for a whole flight: 0.4 deg rms on rendered flights,
many times what the points tell, because the distances that go with it err together."""
_HEADING_MARGIN = 2.0
"""A turn looks almost like a travel past points that are all nearer or all farther, so the heading errs in proportion
to the way across, which is just what makes a distance wrong; and points that err together (a tree's outline, a corner
where one thing hides another) do so unseen by their residuals. On 44 rendered flights through streets the heading was
off by 2.2 times what they tell, relative to the first frame. It matters where nothing else errs as much: at night the
normalised error of 28 answers was 2.8 without this and 2.3 with it, in streets 1.8 either way."""
_PATH_MARGIN = 1.5
"""The path likewise."""
_SCALE_MARGIN = 1.5
"""The path's size comes from the telemetry alone, and how that drifts was measured on two autopilots only. On a third
the path was 3.0 % short where 1.2 % were stated; in five of seven flights taken apart the distance erred like it."""


def adjusted_noise(bundle: AdjustedBundle, similarity: Similarity, stated: NoiseModel) -> NoiseModel:
    """The noise of the steadied poses.

    Args:
        bundle: what the pictures tell of the path's shape.
        similarity: what the telemetry tells of the whole.
        stated: by the aircraft, of its own poses.
    """
    own = np.einsum("ii->i", bundle.covariance).reshape(-1, 6)
    heading = _HEADING_MARGIN * math.sqrt(float(own[:, 2].mean()))
    tilt = math.sqrt(float(0.5 * own[:, :2].sum(axis=1).mean()))
    place = _PATH_MARGIN * math.sqrt(float(own[:, 3:].mean()))
    drawn = drawn_by_movers(bundle.still_share)
    heading = math.hypot(heading, drawn * stated.heading_sigma_rad)
    tilt = math.hypot(tilt, drawn * stated.tilt_sigma_rad)
    span_s = float(bundle.cameras.t_s[-1] - bundle.cameras.t_s[0])
    open_ = similarity.covariance
    return replace(
        stated,
        position_sigma_m=place,
        position_walk_m_per_sqrt_s=place / math.sqrt(max(0.5 * span_s, 0.1)),
        heading_sigma_rad=heading,
        heading_correlation_s=_CORRELATION_S,
        tilt_sigma_rad=tilt,
        tilt_correlation_s=_CORRELATION_S,
        # The pictures tie the attitude to the path: most of what is left is turned with it, all together.
        heading_bias_sigma_rad=math.hypot(heading, _DIRECTION_SIGMA_RAD),
        tilt_bias_sigma_rad=tilt,
        # What errs all along is not seen in how the reports differ from the pictures.
        position_scale_sigma=math.hypot(stated.position_scale_sigma, _SCALE_MARGIN * math.sqrt(open_[0, 0])),
        world_heading_sigma_rad=math.hypot(stated.world_heading_sigma_rad, math.sqrt(open_[3, 3])),
        world_tilt_sigma_rad=math.hypot(stated.world_tilt_sigma_rad, math.sqrt(0.5 * (open_[1, 1] + open_[2, 2]))),
    )


def drawn_by_movers(still_share: float) -> float:
    """How far what moves may have drawn the attitude, as a share of what the telemetry leaves it: 0 to 1.

    Where people walk the camera's own way for a moment, they are a still world at another distance, and where little
    else is seen they decide. No residual shows that, so the bundle's covariance does not either: of 43 rendered
    flights through a crowd those with more than 65 % of the sightings still were off in heading by 0.7 times what was
    stated then, 1.4 at worst, the others by up to 4.4 times. At the share that is refused the pictures are taken to
    tell nothing.

    Args:
        still_share: of the points' sightings, those that agree with a world that stands still.
    """
    return float(np.clip((_ENOUGH_STILL - still_share) / (_ENOUGH_STILL - LEAST_STILL), 0.0, 1.0))
