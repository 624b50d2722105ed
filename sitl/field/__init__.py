"""Flights as GPS drones fly them, without real time: a gimbal, 10 to 60 m up, people 20 to 120 m away."""
