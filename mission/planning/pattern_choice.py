"""The pattern for a wanted accuracy, chosen in flight: what the planner says for the distance that is presumed."""

from __future__ import annotations

from mission.camera.camera import Camera
from mission.errors import EstimateRefused, FlightRefused
from mission.planning.bound import Outlook
from mission.planning.pattern import fitted
from mission.planning.planner import SideRoom, plan_in_flight
from mission.records import NoiseModel, TargetPrior
from mission.settings import PatternSettings

FRAME_RATE_HZ = 15.0
"""Frames that are followed a second, cautiously."""


def chosen_pattern(
    settings: PatternSettings,
    range_m: float,
    camera: Camera,
    noise: NoiseModel,
    prior: TargetPrior,
    room: SideRoom,
) -> tuple[PatternSettings, str]:
    """The pattern to fly, and what is to be said of it.

    Without a wanted accuracy it is the pattern of the settings, shortened for a near target.

    Args:
        settings: of the pattern; its length is as much room as the operator has judged free, on its side.
        range_m: about how far away the target is, horizontally.
        camera: its lens and what is not known of it.
        noise: of the poses and the detector.
        prior: of the target.
        room: what limits and time leave; sides wider than the settings' length are not used.
    """
    wanted = settings.accuracy_percent
    if wanted is None:
        return fitted(settings, range_m), ""
    outlook = Outlook(range_m, camera.intrinsics, noise, prior, prior.speed_sigma_m_s, FRAME_RATE_HZ)
    left, right = (
        settings.length_m if settings.side == side or settings.kind == "s" else 0.0 for side in ("left", "right")
    )
    free = SideRoom(
        min(left, room.left_m), min(right, room.right_m), room.height_m, room.max_speed_m_s, room.max_time_s
    )
    try:
        plan = plan_in_flight(0.01 * wanted * range_m, outlook, free)
    except (EstimateRefused, FlightRefused) as error:
        return fitted(settings, range_m), f"no pattern is chosen ({error.cause}); flying {settings.length_m:g} m"
    percent = 100.0 * plan.worst_sigma_m / range_m
    reached = "" if percent <= 1.001 * wanted else f"; {wanted:g} % cannot be had in this room"
    chosen = plan.pattern.model_copy(update={"accuracy_percent": wanted})
    return chosen, f"for {percent:.1f} % at about {range_m:.0f} m{reached}"
