"""Pictures of calibration boards, rendered through a known lens."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from mission.camera import CameraModel
from mission.records import CameraIntrinsics, Image

LENS = CameraIntrinsics(640, 480, 516.0, 514.0, 312.0, 247.0, (-0.18, 0.05, 0.0008, -0.0005, 0.0))
SQUARE_M = 0.03
COLUMNS, ROWS = 9, 7
_PX_PER_SQUARE = 60


def chessboard() -> Image:
    across, down = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    cells = np.where((across + down) % 2 == 0, 20, 235).astype(np.uint8)
    big = np.kron(cells, np.ones((_PX_PER_SQUARE, _PX_PER_SQUARE), np.uint8))
    return np.asarray(cv2.cvtColor(big, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def charuco() -> Image:
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard((COLUMNS, ROWS), SQUARE_M, 0.022, markers)
    drawn = board.generateImage((COLUMNS * _PX_PER_SQUARE, ROWS * _PX_PER_SQUARE), marginSize=0)
    return np.asarray(cv2.cvtColor(drawn, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def pictures(pattern: Image, count: int, rng: np.random.Generator, tilt_deg: float = 35.0) -> list[tuple[str, Image]]:
    """Views with random tilt, distance and place, all of the board inside the picture as far as it goes."""
    lens = LENS
    model = CameraModel(lens)
    x, y = np.meshgrid(np.arange(lens.width_px) + 0.5, np.arange(lens.height_px) + 0.5)
    rays = model.ray(np.column_stack([x.ravel(), y.ravel()]))
    views = []
    for index in range(count):
        tilt = np.radians(rng.uniform(-tilt_deg, tilt_deg, 2))
        turn = Rotation.from_euler("xyz", [tilt[0], tilt[1], rng.uniform(-0.2, 0.2)])
        depth = rng.uniform(0.33, 0.55)
        corner = np.array([(-1) ** index, (-1) ** (index // 2)]) * rng.uniform(0.2, 1.0)
        room = np.array([0.62, 0.465]) * depth - 0.5 * np.array([COLUMNS, ROWS]) * SQUARE_M * 0.95
        centre = np.array([*(corner * np.maximum(room, 0.0)), depth])
        normal = turn.apply([0.0, 0.0, 1.0])
        points = rays * ((centre @ normal) / (rays @ normal))[:, None]
        on_board = turn.inv().apply(points - centre)[:, :2] / SQUARE_M + np.array([COLUMNS, ROWS]) / 2.0
        where = (on_board * _PX_PER_SQUARE - 0.5).astype(np.float32).reshape(lens.height_px, lens.width_px, 2)
        image = cv2.remap(
            pattern,
            where[..., 0],
            where[..., 1],
            cv2.INTER_AREA,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(180,) * 3,
        )
        soft = cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0.0, 3.0, image.shape)
        views.append((f"view{index:02d}.png", np.clip(soft, 0, 255).astype(np.uint8)))
    return views
