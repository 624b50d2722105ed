import math

import pytest

from mission.calibration.theta import calibrate_theta
from mission.errors import CalibrationError


def test_the_papers_object_gives_the_papers_focal_length() -> None:
    camera = calibrate_theta(0.92, 0.57, 320.0, 640, 480)
    assert camera.intrinsics.fx == pytest.approx(516.5, abs=0.05)
    theta_deg = math.degrees(math.atan2(320.0, camera.intrinsics.fx))
    assert theta_deg / 320.0 == pytest.approx(0.0993, abs=1e-4)
    assert 0.01 < camera.focal_sigma < 0.03


@pytest.mark.parametrize(
    ("depth", "side", "pixels"),
    [(0.0, 0.5, 300.0), (1.0, -0.5, 300.0), (1.0, math.nan, 300.0), (1.0, 0.5, 330.0), (1.0, 0.02, 12.0)],
)
def test_what_cannot_be_or_says_too_little_is_refused(depth: float, side: float, pixels: float) -> None:
    with pytest.raises(CalibrationError):
        calibrate_theta(depth, side, pixels, 640, 480)
