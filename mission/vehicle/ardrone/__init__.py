"""The Parrot AR.Drone 2.0 behind `Drone`: AT commands, navdata, PaVE video, its configuration, and flying by tilt."""
