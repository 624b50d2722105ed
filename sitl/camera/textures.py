"""Textures made from a seed: grass, paving, bricks, fronts of houses, roofs, bark, leaves, cloth and sky.

Every texture is a BGR picture that repeats without a seam (the sky only sideways). They have structure at all scales,
as real surfaces have, so that trackers, correlation and the video encoder have something true to work on.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from mission.records import Image

Field = NDArray[np.float32]
"""A seamless picture of one channel, (n, n), mean about 0."""


def noise(rng: np.random.Generator, size: int, roughness: float = 1.0, stretch: float = 1.0) -> Field:
    """Seamless noise whose amplitude falls with frequency as f ** -roughness; standard deviation 1.

    Args:
        rng: the source of randomness.
        size: side, pixels.
        roughness: 0 is white, 1 is cloudy, 2 is smooth.
        stretch: how much longer than wide the structures are, along the rows.
    """
    fy = np.fft.fftfreq(size)[:, None] * size
    fx = np.fft.rfftfreq(size)[None, :] * size
    frequency = np.hypot(fx * stretch, fy)
    frequency[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((size, size))) / frequency**roughness
    field = np.fft.irfft2(spectrum, s=(size, size)).astype(np.float32)
    return np.asarray(field / field.std(), dtype=np.float32)


def grass(rng: np.random.Generator, size: int = 512) -> Image:
    """A lawn: blades, tufts and worn places."""
    blades = noise(rng, size, 0.4, 0.35)
    tufts, patches = noise(rng, size, 1.1), noise(rng, size, 1.8)
    value = 0.55 * blades + 0.6 * tufts
    picture = _tint(np.array([72.0, 134.0, 118.0]), value, np.array([13.0, 21.0, 18.0]))
    dry = np.clip(patches - 0.9, 0.0, 1.0)[:, :, None]
    return _image(picture * (1.0 - 0.55 * dry) + 0.55 * dry * np.array([112.0, 150.0, 164.0]))


def paving(rng: np.random.Generator, size: int = 512, rows: int = 4) -> Image:
    """Concrete slabs with joints."""
    step = size // rows
    picture = _tint(np.array([150.0, 156.0, 160.0]), noise(rng, size, 0.6), np.array([7.0, 7.0, 7.0]))
    for r in range(rows):
        for c in range(rows):
            picture[r * step : (r + 1) * step, c * step : (c + 1) * step] += rng.normal(0.0, 9.0)
    joint = np.zeros((size, size), np.float32)
    joint[::step] = joint[1::step] = 1.0
    joint[:, ::step] = joint[:, 1::step] = 1.0
    soft = np.asarray(cv2.GaussianBlur(joint, (0, 0), 1.2))[:, :, None]
    return _image(picture * (1.0 - 0.7 * soft))


def bricks(rng: np.random.Generator, size: int = 256, courses: int = 16) -> Image:
    """Brickwork in stretcher bond."""
    high, long = size // courses, size // 4
    picture = np.full((size, size, 3), (150.0, 158.0, 165.0))
    for course in range(courses):
        offset = (course % 2) * long // 2
        for k in range(-1, 5):
            left, right = k * long + offset + 2, (k + 1) * long + offset
            colour = np.array([62.0, 84.0, 150.0]) * rng.uniform(0.75, 1.15) + rng.normal(0.0, 5.0, 3)
            picture[course * high + 2 : (course + 1) * high, max(0, left) : max(0, min(size, right))] = colour
    return _image(picture + 7.0 * noise(rng, size, 0.6)[:, :, None])


def front(rng: np.random.Generator, columns: int, width: int = 512, height: int = 256) -> Image:
    """The front of a house: rendered wall, two rows of windows and a door."""
    base = np.array([(196, 214, 222), (178, 200, 226), (205, 205, 200), (160, 190, 214)][int(rng.integers(4))], float)
    size = max(width, height)
    picture = _tint(base, noise(rng, size, 1.0)[:height, :width], np.array([5.0, 5.0, 5.0]))
    picture += 4.0 * noise(rng, size, 0.3)[:height, :width, None]
    door = int(rng.integers(columns))
    cell = width // columns
    for column in range(columns):
        middle = column * cell + cell // 2
        half = int(0.19 * cell)
        for top, bottom in ((int(0.14 * height), int(0.40 * height)), (int(0.58 * height), int(0.86 * height))):
            if column == door and top > height // 2:
                cv2.rectangle(picture, (middle - half, top - 6), (middle + half, height), (46, 58, 84), -1)
                cv2.rectangle(picture, (middle - half, top - 6), (middle + half, height), (225, 225, 225), 3)
                continue
            cv2.rectangle(picture, (middle - half - 3, top - 3), (middle + half + 3, bottom + 3), (236, 238, 238), -1)
            glass = rng.uniform(38.0, 95.0)
            cv2.rectangle(picture, (middle - half, top), (middle + half, bottom), (glass + 22, glass + 8, glass), -1)
            cv2.line(picture, (middle, top), (middle, bottom), (230, 232, 232), 3)
            cv2.line(
                picture, (middle - half, (top + bottom) // 2), (middle + half, (top + bottom) // 2), (230, 232, 232), 2
            )
    picture[int(0.95 * height) :] *= 0.6
    return _image(picture)


def roof(rng: np.random.Generator, size: int = 256, rows: int = 16) -> Image:
    """Clay tiles."""
    high = size // rows
    v, u = np.mgrid[0:size, 0:size]
    shade = 0.72 + 0.28 * ((v % high) / high) + 0.10 * np.cos(2.0 * np.pi * u / high)
    picture = np.array([58.0, 76.0, 138.0]) * shade[:, :, None]
    return _image(picture * (1.0 + 0.09 * noise(rng, size, 0.9))[:, :, None])


def bark(rng: np.random.Generator, size: int = 128) -> Image:
    """Bark, furrowed upwards."""
    return _image(_tint(np.array([56.0, 74.0, 92.0]), noise(rng, size, 0.8, 3.5).T, np.array([13.0, 16.0, 19.0])))


def leaves(rng: np.random.Generator, size: int = 256) -> Image:
    """Foliage: clumps of leaves with dark gaps."""
    clumps, single = noise(rng, size, 1.0), noise(rng, size, 0.2)
    picture = _tint(np.array([38.0, 82.0, 60.0]), clumps + 0.7 * single, np.array([11.0, 24.0, 18.0]))
    return _image(picture * np.clip(0.75 + 0.5 * (clumps + single > -0.7), 0.0, 1.1)[:, :, None])


def cloth(rng: np.random.Generator, size: int = 128) -> Image:
    """Folds and weave, light grey: it is multiplied by the garment's colour."""
    folds, weave = noise(rng, size, 1.5, 0.6), noise(rng, size, 0.2)
    return _image(_tint(np.array([222.0, 222.0, 222.0]), folds + 0.25 * weave, np.array([17.0, 17.0, 17.0])))


def sky(rng: np.random.Generator, size: int = 512) -> Image:
    """From the zenith (first row) to the horizon (last row), with clouds; repeats sideways."""
    clouds = np.clip(noise(rng, size, 1.5, 0.45) - 0.2, 0.0, 1.6)[:, :, None] / 1.6
    down = np.linspace(0.0, 1.0, size)[:, None, None]
    clear = np.array([205.0, 150.0, 102.0]) * (1.0 - down) + np.array([232.0, 216.0, 200.0]) * down
    return _image(clear * (1.0 - 0.8 * clouds) + 0.8 * clouds * np.array([246.0, 244.0, 242.0]))


def plain(rng: np.random.Generator, size: int = 64) -> Image:
    """Painted metal or asphalt: light grey with a little wear, to be multiplied by a colour."""
    return _image(_tint(np.array([214.0, 214.0, 214.0]), noise(rng, size, 0.7), np.array([9.0, 9.0, 9.0])))


def _tint(base: NDArray[np.float64], value: Field, spread: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(base + value[:, :, None] * spread)


def _image(picture: NDArray[np.float64]) -> Image:
    return np.clip(picture, 0.0, 255.0).astype(np.uint8)
