"""Video in: any stream or file that FFmpeg reads becomes frames with the program's time, newest first."""

from mission.video.source import VideoSource, open_video
from mission.video.stats import VideoState, VideoStats

__all__ = ["VideoSource", "VideoState", "VideoStats", "open_video"]
