"""Aircraft behind one interface, `Drone`."""
