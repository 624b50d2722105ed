"""The parts of the MAVProxy module that know nothing of MAVProxy's command line."""
