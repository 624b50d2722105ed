"""The camera: where a pixel looks, how it sits on the airframe, its calibration, and when a picture was taken."""

from mission.camera.file import Camera, read_camera, write_camera
from mission.camera.model import CameraModel, from_field_of_view
from mission.camera.mounting import Mounting

__all__ = ["Camera", "CameraModel", "Mounting", "from_field_of_view", "read_camera", "write_camera"]
