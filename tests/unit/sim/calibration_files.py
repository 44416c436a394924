"""Calibrations of devices in three formats, for tests."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

BLOCK = """ Intrinsic of "{stream}" / {width}x{height} / {{Z16}}
  Width:      \t{width}
  Height:     \t{height}
  PPX:        \t{ppx}
  PPY:        \t{ppy}
  Fx:         \t{fx}
  Fy:         \t{fx}
  Distortion: \tBrown Conrady
  Coeffs:     \t0  \t0  \t0  \t0  \t{k3}
  FOV (deg):  \t71.57 x 44.14

"""
BASELINE = """Extrinsic from "Depth"\t  To\t  "Color" :
 Rotation Matrix:
   1   0   0
   0   1   0
   0   0   1

 Translation Vector: 0.0150563241913915  6.23119412921369e-05  -0.000343817780958489

Extrinsic from "Depth"\t  To\t  "Infrared 2" :
 Rotation Matrix:
   1   0   0
   0   1   0
   0   0   1

 Translation Vector: {x}  0  0
"""


def block(stream: str, size: str, fx: float, ppx: float, ppy: float, k3: str = "0") -> str:
    width, height = size.split("x")
    values = {"fx": fx, "ppx": ppx, "ppy": ppy, "k3": k3}
    return BLOCK.format(stream=stream, width=width, height=height, **values)


# A D415 as `rs-enumerate-devices -c` lists it (jie0530/d3roma, xiaomeng/intrinsics.txt).
DEPTH = block("Depth", "1280x720", 887.829284667969, 631.876708984375, 373.140869140625)
SMALL = block("Depth", "640x480", 591.886169433594, 314.58447265625, 248.76057434082)
COLOUR = block("Color", "1280x720", 908.89111328125, 625.026306152344, 346.491912841797)
D415 = "Device info:\n" + SMALL + DEPTH + COLOUR + BASELINE.format(x="-0.0547803528606892")

ECHO = """---
header:
  frame_id: camera_infra2_optical_frame
height: 480
width: 848
distortion_model: plumb_bob
d:
- 0.0
- 0.0
k: [424.2, 0.0, 423.4, 0.0, 424.3, 236.0, 0.0, 0.0, 1.0]
r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
p:
- 424.2
- 0.0
- 423.4
- -21.21
- 0.0
- 424.3
- 236.0
- 0.0
- 0.0
- 0.0
- 1.0
- 0.0
binning_x: 0
---
height: 3
"""
FILE = """image_width: 640
image_height: 480
camera_name: left
camera_matrix:
  rows: 3
  cols: 3
  data: [390.1, 0, 320.5, 0, 390.2, 236.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, 0, 0, 0, 0]
projection_matrix:
  rows: 3
  cols: 4
  data: [384.2, 0, 319.5, 0, 0, 384.2,
         236.4, 0, 0, 0, 1, 0]
"""
OAK: dict[str, Any] = {  # luxonis/depthai-boards, boards/BW1098OBC.json.
    "board_config": {
        "cameras": {
            "CAM_A": {"hfov": 68.7938},
            "CAM_B": {
                "hfov": 71.86,
                "extrinsics": {"to_cam": "CAM_C", "specTranslation": {"x": -7.5, "y": 0, "z": 0}},
            },
            "CAM_C": {
                "hfov": 71.86,
                "extrinsics": {"to_cam": "CAM_A", "specTranslation": {"x": 3.75, "y": 0, "z": 0}},
            },
        },
        "stereo_config": {"left_cam": "CAM_B", "right_cam": "CAM_C"},
    }
}


def written(folder: Path, name: str, content: Any) -> Path:
    text = content if isinstance(content, str) else json.dumps(content)
    (folder / name).write_text(text)
    return folder / name


def without(*keys: str) -> dict[str, Any]:
    board = json.loads(json.dumps(OAK))
    table = board
    for key in keys[:-1]:
        table = table[key]
    del table[keys[-1]]
    return board


def moved(x: Any) -> dict[str, Any]:
    board = json.loads(json.dumps(OAK))
    board["board_config"]["cameras"]["CAM_B"]["extrinsics"]["specTranslation"]["x"] = x
    return board
