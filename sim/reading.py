"""What a depth camera returns for one frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image, Labels, Mask
from starling.sim.imaging.imager import Infrared
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot
from starling.sim.stereo.depth import DepthMap, to_code
from starling.sim.stereo.post.temporal import History


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Reading:
    """One reading of a depth camera, each image (h, w) of the sensor's size.

    Attributes:
        ir_left: image of the left imager, or of the only one [DN].
        ir_right: image of the right imager [DN]; None for structured light.
        depth_m: depth along the optical axis [m], NaN where missing.
        depth_u16: code as the device writes it; 0 where missing.
        reason: codes of `starling.Reason`; 0 if and only if there is depth.
        lit: whether the projector reaches the surface.
        right_sees: whether the right imager sees the surface.
        true_depth_m: the input in the sensor's camera [m]; NaN without a surface.
        exposure_s: exposure of the images [s].
        gain: gain of the images, 1 is none.
        history: pass it as `past` with the next frame, for a temporal filter; None without one.
    """

    ir_left: Infrared
    ir_right: Infrared | None
    depth_m: Image
    depth_u16: NDArray[np.uint16]
    reason: Labels
    lit: Mask
    right_sees: Mask
    true_depth_m: Image
    exposure_s: float
    gain: float
    history: History | None

    @classmethod
    def from_shot(cls, shot: Shot, depth: DepthMap, sensor: Sensor) -> Reading:
        """Collect what a device returns, with a depth map that replaces the shot's."""
        truth = shot.layers.truth
        return cls(
            ir_left=shot.ir_left,
            ir_right=shot.ir_right,
            depth_m=depth.depth_m,
            depth_u16=to_code(depth.depth_m, sensor.post.depth_unit_m),
            reason=depth.reason,
            lit=truth.lit,
            right_sees=truth.right_sees,
            true_depth_m=truth.depth_m,
            exposure_s=shot.exposure_s,
            gain=shot.gain,
            history=shot.depth.history,
        )
