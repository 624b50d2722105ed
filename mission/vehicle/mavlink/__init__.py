"""PX4 and ArduPilot behind `Drone`: link, telemetry, commands, and their pilot process."""
