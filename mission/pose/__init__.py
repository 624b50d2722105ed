"""Where the aircraft was and how it was turned: interpolated reports, steps undone, snapshots."""
