"""Why the pixels of a captured frame lack depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures import exr
from starling.sim.captures.capture import CapturedScene, Frame
from starling.sim.reason import Reason


def read(scene: CapturedScene, frame: Frame) -> NDArray[np.uint32] | None:
    """Read the reasons (h, w) of a simulated frame; a real frame has UNKNOWN reasons.

    Returns:
        Codes of `Reason`, or None without depth.

    Raises:
        InputError: if `frame.exr` is damaged or of another size.
    """
    path = scene.path / str(frame.number) / "frame.exr"
    if path.exists():
        reason = exr.read(path)[1].reason
        if reason.shape != scene.info.shape:
            raise errors.refuse(
                "frame.exr",
                f"must be {scene.info.width}x{scene.info.height} as capture.toml says",
                f"{path}, {reason.shape[1]}x{reason.shape[0]}",
                "Simulate it again.",
            )
        return reason
    if frame.depth_m is None:
        return None
    return np.where(np.isnan(frame.depth_m), np.uint32(Reason.UNKNOWN), np.uint32(Reason.VALID))
