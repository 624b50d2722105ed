"""Locating people in recorded flights: nobody flies, the pictures and the log are all there is."""
