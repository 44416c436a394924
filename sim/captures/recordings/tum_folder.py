"""Sequences of the TUM RGB-D benchmark as recordings: depth, colour and poses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.captures.exchange import tum
from starling.sim.captures.exchange.stream import Moment
from starling.sim.captures.recordings.recording import ReadImage, RecordedFrame, Recording
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.stereo.depth import to_code

KIND = "TUM sequence"


def is_sequence(path: Path) -> bool:
    """Whether a folder lists depth images as TUM does."""
    return (path / "depth.txt").is_file()


def read(path: Path, camera: Pinhole | None) -> Recording:
    """Read a sequence; grey pictures are infrared images, others colour.

    Raises:
        InputError: as `tum.read`.
    """
    stream = tum.read(path, camera)
    return Recording(
        path=path,
        kind=KIND,
        frames=tuple(map(_frame, stream.moments)),
        camera=stream.camera,
        depth_unit_m=tum.UNIT_M,
    )


def _frame(moment: Moment) -> RecordedFrame:
    images: dict[str, ReadImage] = {"depth": _codes(moment.depth)}
    if moment.image is not None:
        name = "colour" if moment.image().ndim == 3 else "left"
        images[name] = moment.image
    facts: dict[str, Any] = {}
    if moment.world_from_camera is not None:
        facts["left_from_world"] = np.linalg.inv(moment.world_from_camera).tolist()
    return RecordedFrame(time_s=moment.time_s, images=images, facts=facts)


def _codes(read: Callable[[], NDArray[np.float32]]) -> Callable[[], NDArray[np.uint16]]:
    return lambda: to_code(read(), tum.UNIT_M)
