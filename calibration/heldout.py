"""How like a held-out scene's real infrared its re-simulation is.

The scene's surface is its reference. Its own left image tells its reflectance, smoothed until no
dot is left in it, the level of its ambient light and, where dots are the sensor's, how that varies
by place: all three with the sensor that the fit began from. The right image has no say in these.
Both images tell one number, the scene's pattern scale, as the laser's wavelength drifts with
temperature and nobody measured that. Everything else comes from the calibrated sensor.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from starling.calibration import correlation
from starling.calibration.observation import Observation, truth_px
from starling.patterns import errors
from starling.sim import metrics
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import disparity_from_depth

if TYPE_CHECKING:  # Loads the renderer, which takes seconds.
    from starling.sim.render.mitsuba_scene import Stage

Array = NDArray[np.float32]
Side = Literal["left", "right"]

SMOOTHING_PX = 12.0  # Of the image that a held-out scene's reflectance is made of, and no narrower.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scored:
    """One held-out scene."""

    scene: str
    room: str
    scale: float  # Pattern scale that its images were simulated with.
    real: dict[Side, Array]  # (h, w) [DN]
    simulated: dict[Side, Array]  # (h, w) [DN above black], without noise.
    ncc: dict[Side, Array]  # (n,) of the windows, simulated against real.
    mirrored: dict[Side, Array]  # Likewise with the pattern turned over: chance.
    ceiling: Array  # (n,) of the windows: real right image in the left view against the left.


def score(
    observation: Observation, sensor: Sensor, *, scale: float = 1.0, mirrored: Sensor | None = None
) -> Scored:
    """Simulate a held-out scene and compare it with what the camera saw.

    Args:
        observation: loaded with `smoothing_px=SMOOTHING_PX`, with infrared and a surface.
        sensor: calibrated on other scenes.
        scale: the scene's pattern scale.
        mirrored: the same sensor with its patterns turned over, for the control.

    Raises:
        InputError: if images or surface are missing.
    """
    if observation.left is None or observation.scene is None:
        raise errors.refuse(
            f"held-out scene {observation.name}",
            "must have infrared images and a surface",
            "less",
            "Hold out another one.",
        )
    real: dict[Side, Array] = {"left": observation.left}
    if observation.right is not None:
        real["right"] = observation.right
    simulated, depth = simulate(observation.stage, sensor, scale)
    control = simulate(observation.stage, mirrored, scale)[0] if mirrored else {}
    usable = {side: _usable(observation, sensor, side, depth[side]) for side in real}
    high = {side: correlation.high_passed(image) for side, image in real.items()}

    def compared(images: dict[Side, Array]) -> dict[Side, Array]:
        return {
            side: correlation.local_ncc(
                high[side], correlation.high_passed(images[side]), usable[side]
            )
            for side in real
            if side in images
        }

    return Scored(
        scene=observation.name,
        room=observation.room,
        scale=scale,
        real=real,
        simulated=simulated,
        ncc=compared(simulated),
        mirrored=compared(control),
        ceiling=_ceiling(observation, high["left"]),
    )


def simulate(
    stage: Stage, sensor: Sensor, scale: float
) -> tuple[dict[Side, Array], dict[Side, Array]]:
    """Infrared images without noise [DN above black], and depths that each imager sees [m].

    All are (h, w).
    """
    from starling.sim.imaging.noiseless import noiseless
    from starling.sim.render import direct

    light = dataclasses.replace(sensor.projector, pattern_scale=scale)
    scaled = dataclasses.replace(sensor, projector=light)
    layers = direct.layers(stage, scaled)
    depth: dict[Side, Array] = {"left": layers.left.depth_m}
    if layers.right is not None:
        depth["right"] = layers.right.depth_m
    return noiseless(layers, stage.scene, scaled), depth


def away_from_edges(depth_m: Array, sensor: Sensor) -> NDArray[np.bool_]:
    """Pixels (h, w) of a view that see a surface away from depth edges.

    Args:
        depth_m: (h, w) that the view sees; NaN where it sees nothing.
        sensor: whose disparity tells what an edge is.
    """
    disparity = disparity_from_depth(depth_m, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m)
    return np.isfinite(disparity) & ~metrics.depth_edges(disparity)


def _usable(
    observation: Observation, sensor: Sensor, side: Side, depth_m: Array
) -> NDArray[np.bool_]:
    usable = away_from_edges(depth_m, sensor)
    if side == "left" and observation.truth_m is not None:
        usable &= np.isfinite(observation.truth_m)
    return usable


def _ceiling(observation: Observation, left: Array) -> Array:
    """How like the left image its own camera's right one is, warped by the reference."""
    disparity = truth_px(observation)
    if observation.right is None or disparity is None:
        return np.empty(0, np.float32)
    warped, inside = correlation.right_in_left(observation.right, disparity)
    usable = inside & ~metrics.depth_edges(disparity)
    return correlation.local_ncc(left, correlation.high_passed(warped), usable)
