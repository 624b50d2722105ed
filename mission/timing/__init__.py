"""The offset between video time and telemetry time, by rotations that both have seen."""
