"""The simulated camera: a scene, a lens, a sensor and a video stream."""

from sitl.camera.process import CameraProcess, CameraStats, start_camera

__all__ = ["CameraProcess", "CameraStats", "start_camera"]
