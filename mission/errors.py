"""The errors an operator may meet: each says what happened and what to do about it."""

from __future__ import annotations

from mission.addresses import without_secrets


class SidestepError(Exception):
    """Something went wrong that the operator should know about.

    Args:
        cause: what happened, in the operator's words, without a trailing full stop.
        remedy: what to do about it; empty when there is nothing to do.

    Passwords in addresses are left out of both.
    """

    def __init__(self, cause: str, remedy: str = "") -> None:
        self.cause = without_secrets(cause)
        self.remedy = without_secrets(remedy)
        super().__init__(f"{self.cause}. {self.remedy}" if remedy else self.cause)


class InputError(SidestepError):
    """What was asked for, or a file that it needs, cannot be used as it is: nothing was tried."""


class SettingsError(InputError):
    """A setting or an argument is missing, of a wrong type or out of its range."""


class LinkError(SidestepError):
    """The MAVLink (or AR.Drone) link is not there, or fell silent."""


class VideoError(SidestepError):
    """The video cannot be opened, or stopped."""


class CalibrationError(SidestepError):
    """A calibration file cannot be read, or the pictures do not support a calibration."""


class CalibrationInputError(CalibrationError, InputError):
    """A camera file, or what a calibration is asked for, cannot be used as it is."""


class DetectionError(SidestepError):
    """No target is in view, the choice is ambiguous, or the target was lost."""


class FlightRefused(SidestepError):
    """The flight would be unsafe or leave its bounds, so it does not start."""


class FlightEnded(SidestepError):
    """The flight ended before it was done: the pilot took over, a failsafe fired, or an abort was ordered."""


class Aborted(FlightEnded):
    """The operator wants no more of it."""


class EstimateRefused(SidestepError):
    """The sightings cannot support a position; the cause and the remedy are named."""


class SightingsFormatError(InputError):
    """A sightings file does not follow its format; the message names file and line."""


class LogError(InputError):
    """A flight log or a video's metadata cannot be read, or holds too little to place a camera."""


class AnswerError(SidestepError):
    """The answer could not be stored or sent."""
