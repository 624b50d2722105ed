"""The MAVLink camera component that a ground station talks to."""

from gcs_plugin.component.component import CameraComponent
from gcs_plugin.component.identity import Identity
from gcs_plugin.component.information import Picture
from gcs_plugin.component.link import StationLink
from gcs_plugin.component.orders import Follow, HandToAutopilot, LocateOrder, Mark, NextCandidate, Order

__all__ = [
    "CameraComponent",
    "Follow",
    "HandToAutopilot",
    "Identity",
    "LocateOrder",
    "Mark",
    "NextCandidate",
    "Order",
    "Picture",
    "StationLink",
]
