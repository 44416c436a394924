"""NYU Depth V2, labelled part: 1449 images of a Kinect in one file, `nyu_depth_v2_labeled.mat`.

    images     (n, 3, 640, 480) uint8, in HDF5's order of axes: MATLAB's reversed
    rawDepths  (n, 640, 480) float [m], the Kinect's depth registered to the colour image; 0 = none
    depths     (n, 640, 480) float [m], the same with its holes filled by colorization
    scenes     (1, n) references to names of characters; optional

**Its "truth" is the camera's own depth.** In holes it is filled by another method (Levin's
colorization), not measured. Metrics on this data set measure the agreement with that fill.

Colour camera: 518.858, 519.470 px, principal point 325.582, 253.736 (camera_params.m of the
authors' toolbox). The images are undistorted, with a white rim of some pixels. Baseline of the
Kinect: 0.075 m.

Source: Silberman et al., Indoor segmentation and support inference from RGBD images, ECCV 2012,
and the data set's page.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from starling.learning.completion.data.readers.item import Item, ItemSource
from starling.learning.completion.method import Image
from starling.patterns.errors import needs, refuse
from starling.sim.geometry.pinhole import Pinhole

BASELINE_M = 0.075
_FX_PX, _FY_PX, _CX_PX, _CY_PX = 518.85790, 519.46961, 325.58245, 253.73617


def sources(path: Path) -> list[ItemSource]:
    """List the items of the file in its order. Images are read on demand.

    Args:
        path: `nyu_depth_v2_labeled.mat`.

    Raises:
        InputError: if `h5py` is not installed, or the file is missing, not HDF5, or incomplete.
    """
    with _opened(path) as file:
        number = len(file["images"])
        rooms = _scenes(file) if "scenes" in file else [f"{i:04d}" for i in range(number)]
    return [
        ItemSource(name=f"{index:04d}", room=room, files=(path,), load=partial(_load, path, index))
        for index, room in enumerate(rooms)
    ]


def _load(path: Path, index: int) -> Item:
    with _opened(path) as file:
        rgb = np.ascontiguousarray(file["images"][index].transpose(2, 1, 0))
        raw, truth = file["rawDepths"][index].T, file["depths"][index].T
    height, width = rgb.shape[:2]
    return Item(
        rgb=rgb,
        truth_m=_known(truth),
        sensor_m=_known(raw),
        camera=Pinhole(
            width=width, height=height, fx_px=_FX_PX, fy_px=_FY_PX, cx_px=_CX_PX, cy_px=_CY_PX
        ),
        baseline_m=BASELINE_M,
    )


def _known(depth: Any) -> Image:
    # Row-major: reversing MATLAB's axes leaves the array column-major.
    return np.ascontiguousarray(np.where(depth > 0, depth, np.nan), np.float32)


def _scenes(file: Any) -> list[str]:
    return ["".join(map(chr, np.ravel(file[place][()]))) for place in np.ravel(file["scenes"][()])]


def _opened(path: Path) -> Any:
    try:
        h5py = import_module("h5py")
    except ImportError as error:
        raise needs("NYU Depth V2", "h5py", "completion") from error
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise refuse("NYU Depth V2", "must be a readable HDF5 file", path, f"{error}.") from error
    missing = [name for name in ("images", "rawDepths", "depths") if name not in file]
    if missing:
        file.close()
        got = f"{path} without {', '.join(missing)}"
        rule = "must have images, rawDepths and depths"
        raise refuse("NYU Depth V2", rule, got, "Is it the labelled part?")
    return file
