"""Measuring a camera: intrinsics, latency, and the baseline table of an aircraft without GPS."""
