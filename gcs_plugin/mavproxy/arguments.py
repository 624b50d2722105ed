"""What an operator types after `locate`, as an order for the camera component."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import all as mavlink

from mission.errors import SettingsError

LOCATE: Final[int] = mavlink.MAV_CMD_USER_1
ABORT: Final[int] = mavlink.MAV_CMD_USER_2
NEXT: Final[int] = mavlink.MAV_CMD_USER_3
GIVE_BACK: Final[int] = mavlink.MAV_CMD_USER_4
NAMES: Final = {LOCATE: "locate", ABORT: "abort", NEXT: "next", GIVE_BACK: "waypoint"}

_WAYPOINT: Final = 2.0
"""Of GIVE_BACK's first parameter."""

_SMALLEST: Final = 1e-6
"""Of a share that is sent: four zeros mean that no place was named."""


@dataclass(frozen=True, slots=True)
class TypedOrder:
    """A command for the camera component."""

    command: int
    """MAV_CMD."""
    params: tuple[float, ...] = ()

    @property
    def name(self) -> str:
        """In the operator's words."""
        return NAMES.get(self.command, str(self.command))


@dataclass(frozen=True, slots=True)
class PictureSize:
    """Of the video, in pixels."""

    width: int
    height: int


def order(words: Sequence[str], picture: PictureSize | None) -> TypedOrder:
    """The order in what was typed after `locate`.

    Nothing, ``box L,T,W,H``, ``point X,Y``, ``next``, ``waypoint`` or ``abort``.
    Numbers are shares of the picture when all are from 0 to 1, else pixels of the video; (0, 0) is its top left corner.

    Args:
        words: typed after `locate`.
        picture: size of the video, where it is known.

    Raises:
        SettingsError: it is none of these, a number is missing or none, or the place lies outside the picture.
    """
    if not words:
        return TypedOrder(LOCATE)
    match words[0]:
        case "box":
            return TypedOrder(LOCATE, _box(_numbers(words[1:], 4, "box LEFT,TOP,WIDTH,HEIGHT"), picture))
        case "point":
            return TypedOrder(LOCATE, _point(_numbers(words[1:], 2, "point X,Y"), picture))
        case "next" | "abort" | "waypoint" if len(words) > 1:
            raise SettingsError(f"`locate {words[0]}` takes nothing more")
        case "next":
            return TypedOrder(NEXT)
        case "waypoint":
            return TypedOrder(GIVE_BACK, (_WAYPOINT,))
        case "abort":
            return TypedOrder(ABORT)
        case other:
            raise SettingsError(f"`locate` does not know {other!r}", "`locate help` lists what it knows.")


def _box(numbers: tuple[float, ...], picture: PictureSize | None) -> tuple[float, ...]:
    left, top, width, height = numbers
    if width <= 0.0 or height <= 0.0:
        raise SettingsError("the box has no area", "Give LEFT,TOP,WIDTH,HEIGHT.")
    return _shares((left, top, left + width, top + height), picture, fractions=max(numbers) <= 1.0)


def _point(numbers: tuple[float, ...], picture: PictureSize | None) -> tuple[float, ...]:
    x, y = _shares(numbers, picture, fractions=max(numbers) <= 1.0)
    return max(x, _SMALLEST), max(y, _SMALLEST), 0.0, 0.0


def _shares(corners: tuple[float, ...], picture: PictureSize | None, *, fractions: bool) -> tuple[float, ...]:
    """Corners x, y, x, y, ... as shares of the picture's width and height."""
    if not fractions and picture is None:
        raise SettingsError("the size of the video is not known yet", "Give shares of the picture, 0 to 1.")
    sides = (1.0, 1.0) if fractions or picture is None else (picture.width, picture.height)
    shares = tuple(value / sides[i % 2] for i, value in enumerate(corners))
    if min(shares) < 0.0 or max(shares) > 1.0 + _SMALLEST:
        size = "1 x 1" if fractions or picture is None else f"{picture.width} x {picture.height} pixels"
        raise SettingsError(f"that place is outside the picture ({size})")
    return tuple(min(share, 1.0) for share in shares)


def _numbers(words: Sequence[str], count: int, form: str) -> tuple[float, ...]:
    """Numbers with commas or spaces between them."""
    parts = [part for word in words for part in word.split(",") if part]
    try:
        numbers = tuple(float(part) for part in parts)
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
        raise SettingsError(f"{' '.join(words)!r} is not {count} numbers", f"Type `locate {form}`.")
    return numbers
