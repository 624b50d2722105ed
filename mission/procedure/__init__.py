"""The procedure of one sidestep, a state machine: detect, choose, hover, centre, fly the pattern, estimate, report."""
