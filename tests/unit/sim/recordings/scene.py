"""A dotted plane seen by a rectified pair, and the files that cameras and programs write of it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.captures import png
from starling.sim.geometry.pinhole import Pinhole

WIDTH, HEIGHT = 320, 240
FX, CX, CY = 240.5, 158.25, 119.5
BASELINE_M, DISPARITY_PX = 0.05, 12
DEPTH_M = FX * BASELINE_M / DISPARITY_PX
CAMERA = Pinhole(width=WIDTH, height=HEIGHT, fx_px=FX, fy_px=FX, cx_px=CX, cy_px=CY)
K = [[FX, 0, CX], [0, FX, CY], [0, 0, 1.0]]


def dotted(
    number: int = 0,
    *,
    dots: float = 0.008,
    pattern: int = 0,
    width: int = WIDTH,
    height: int = HEIGHT,
) -> NDArray[np.uint8]:
    """Return an image of blurred dots on an even background; each number has its own noise."""
    rng = np.random.default_rng(pattern)
    image = (rng.random((height, width)) < dots).astype(np.float32) * 1500
    image = cv2.GaussianBlur(image, (0, 0), 1.4) + 40
    rng = np.random.default_rng((number, 1))
    return np.clip(image + rng.normal(0, 0.7, image.shape), 0, 255).astype(np.uint8)


def pair(
    number: int = 0,
    *,
    dots: float = 0.008,
    pattern: int = 0,
    rows_px: int = 0,
    disparity_px: int = DISPARITY_PX,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return left and right image of a plane; `rows_px` shifts the right one down."""
    pad = 40
    size = {"width": WIDTH + 2 * pad, "height": HEIGHT + 2 * pad}
    wide = dotted(number, dots=dots, pattern=pattern, **size)
    left = wide[pad : pad + HEIGHT, pad : pad + WIDTH]
    row, column = pad - rows_px, pad + disparity_px
    return left.copy(), wide[row : row + HEIGHT, column : column + WIDTH].copy()


def depth_code(unit_m: float = 1e-3) -> NDArray[np.uint16]:
    """Return the plane's depth, with a hole."""
    code = np.full((HEIGHT, WIDTH), round(DEPTH_M / unit_m), np.uint16)
    code[:20, :20] = 0
    return code


CAMERA_INFO = f"""image_width: {WIDTH}
image_height: {HEIGHT}
camera_name: left
camera_matrix:
  rows: 3
  cols: 3
  data: [{FX}, 0, {CX}, 0, {FX}, {CY}, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0, 0, 0, 0, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [{FX}, 0, {CX}, SHIFT, 0, {FX}, {CY}, 0, 0, 0, 1, 0]
"""
LEFT_INFO = CAMERA_INFO.replace("SHIFT", "0")
RIGHT_INFO = CAMERA_INFO.replace("SHIFT", repr(-FX * BASELINE_M))
LISTING = f"""
 Intrinsic of "Depth" / {WIDTH}x{HEIGHT} / {{Z16}}
  Width:      \t{WIDTH}
  Height:     \t{HEIGHT}
  PPX:        \t{CX}
  PPY:        \t{CY}
  Fx:         \t{FX}
  Fy:         \t{FX}
  Distortion: \tBrown Conrady
  Coeffs:     \t0  0  0  0  0

Extrinsic from "Depth"\t  To\t  "Infrared 2" :
 Rotation Matrix:
   1  0  0
   0  1  0
   0  0  1
 Translation Vector:  -{BASELINE_M}  0  0
"""


def write_frames(folder: Path, count: int, *, first: int = 0) -> None:
    """Write pairs and depth images as `ir1_N.png`, `ir2_N.png` and `d_N.png`, from N = `first`."""
    for number in range(count):
        left, right = pair(number)
        for name, image in {"ir1": left, "ir2": right, "d": depth_code()}.items():
            (folder / f"{name}_{first + number}.png").write_bytes(png.encode(image))
