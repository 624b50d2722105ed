"""The answer on its ways: messages to the stations, a marker, the autopilot, the log and the pictures."""
