"""Flights as other programs would have recorded them: a video, and the reports of the pose in each kind of log."""
