"""Faults of the link between an aircraft and what flies it: a bad radio, broken frames, and a record of what passed.

A `FaultRelay` stands between the aircraft (its `remote_port` is the relay's `vehicle_port`) and the program (which
listens on the relay's `program_port`). `LinkFaults` says what it does, a `Wiretap` notes what passed.
"""

from sitl.faults.mutation import FrameMutator, dialect_frames
from sitl.faults.relay import FaultRelay, LinkFaults, Towards
from sitl.faults.wiretap import Wiretap

__all__ = ["FaultRelay", "FrameMutator", "LinkFaults", "Towards", "Wiretap", "dialect_frames"]
