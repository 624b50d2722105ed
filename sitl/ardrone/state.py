"""The aircraft's state as navdata reports it: the bits of the second header word, and the flight's state machine.

Source: ARDroneLib, config.h (ARDRONE_STATES) and control_states.h.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag


class StateBit(IntFlag):
    """Bits of `ardrone_state`."""

    FLYING = 1 << 0
    VIDEO = 1 << 1
    VISION = 1 << 2
    ALTITUDE_CONTROL = 1 << 4
    USER_FEEDBACK = 1 << 5
    """The pilot asks for the air (bit 9 of REF)."""
    COMMAND = 1 << 6
    """A configuration command came and has not been acknowledged yet."""
    CAMERA_READY = 1 << 7
    NAVDATA_DEMO = 1 << 10
    NAVDATA_BOOTSTRAP = 1 << 11
    COM_LOST = 1 << 13
    BATTERY_LOW = 1 << 15
    USER_EMERGENCY = 1 << 16
    MAGNETO_NEEDS_CALIBRATION = 1 << 18
    ANGLES_OUT_OF_RANGE = 1 << 19
    PIC_VERSION_OK = 1 << 23
    ATCODEC_THREAD = 1 << 24
    NAVDATA_THREAD = 1 << 25
    VIDEO_THREAD = 1 << 26
    ACQUISITION_THREAD = 1 << 27
    COM_WATCHDOG = 1 << 30
    EMERGENCY = 1 << 31


class ControlState(IntEnum):
    """What the aircraft does; the upper 16 bits of the demo option's first word."""

    DEFAULT = 0
    INIT = 1
    LANDED = 2
    FLYING = 3
    HOVERING = 4
    TEST = 5
    TAKING_OFF = 6
    GOING_TO_FIX = 7
    """Braking before it hovers."""
    LANDING = 8
    LOOPING = 9

    @property
    def in_the_air(self) -> bool:
        """Whether the motors carry it."""
        return self in _IN_THE_AIR


_IN_THE_AIR = (
    ControlState.FLYING,
    ControlState.HOVERING,
    ControlState.TAKING_OFF,
    ControlState.GOING_TO_FIX,
    ControlState.LANDING,
)
