"""Score the simulation of a held-out scene against its real infrared images.

The scene's surface comes from its reference. The left image gives the reflectance, smoothed until
no dot remains, and the level of ambient light. If it shows the sensor's own dots, it also gives a
map of ambient light. All three use the initial sensor. Both images give the scene's
pattern scale, because the laser's wavelength drifts with temperature. All other parameters come
from the calibrated sensor.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from starling.calibration import correlation
from starling.calibration.observation import Observation, Side, truth_px
from starling.patterns import errors
from starling.sim import metrics
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import disparity_from_depth

if TYPE_CHECKING:  # Loads the renderer, which takes seconds.
    from starling.sim.render.mitsuba_scene import MitsubaScene

Array = NDArray[np.float32]

# Sigma of the smoothing of reflectance in fits and scores [px]. Detail would absorb a part of
# what is fitted (docs/results/calibration.md).
SMOOTHING_PX = 12.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneScore:
    """One held-out scene."""

    scene: str
    room: str
    scale: float  # Pattern scale that its images were simulated with.
    real: dict[Side, Array]  # (h, w) [DN]
    simulated: dict[Side, Array]  # (h, w) [DN above black], without noise.
    ncc: dict[Side, Array]  # (n,) of the windows, simulated against real.
    mirrored: dict[Side, Array]  # (n,) of the windows, with the mirrored pattern: chance level.
    ceiling: Array  # (n,) of the windows: real right image warped to the left view against left.


def score(
    observation: Observation, sensor: Sensor, *, scale: float = 1.0, mirrored: Sensor | None = None
) -> SceneScore:
    """Simulate a held-out scene and compare it with the camera's images.

    Args:
        observation: loaded with `smoothing_px=SMOOTHING_PX`, with infrared and a surface.
        sensor: calibrated on other scenes.
        scale: the scene's pattern scale.
        mirrored: the same sensor with mirrored patterns, for the control.

    Raises:
        InputError: if images or surface are missing.
    """
    if observation.left is None or observation.scene is None:
        raise errors.refuse(
            f"held-out scene {observation.name}",
            "must have infrared images and a surface",
            "less",
            "Hold out another scene.",
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

    return SceneScore(
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
    stage: MitsubaScene, sensor: Sensor, scale: float, *, subpixels: int = 2
) -> tuple[dict[Side, Array], dict[Side, Array]]:
    """Simulate noiseless infrared images [DN above black] and depths [m] of each imager, (h, w).

    Args:
        stage: loaded scene.
        sensor: camera.
        scale: pattern scale.
        subpixels: n of the n x n rays of a pixel.
    """
    from starling.sim.imaging.noiseless import noiseless
    from starling.sim.render import direct

    light = dataclasses.replace(sensor.projector, pattern_scale=scale)
    scaled = dataclasses.replace(sensor, projector=light)
    layers = direct.layers(stage, scaled, subpixels=subpixels)
    depth: dict[Side, Array] = {"left": layers.left.depth_m}
    if layers.right is not None:
        depth["right"] = layers.right.depth_m
    return noiseless(layers, stage.scene, scaled), depth


def away_from_edges(depth_m: Array, sensor: Sensor) -> NDArray[np.bool_]:
    """Select pixels (h, w) of a view that show a surface away from depth edges.

    Args:
        depth_m: (h, w) depth in the view; NaN where there is no surface.
        sensor: sensor whose disparity defines the edges.
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
    """Correlate the left image with the real right image, warped by the reference depth."""
    disparity = truth_px(observation)
    if observation.right is None or disparity is None:
        return np.empty(0, np.float32)
    warped, inside = correlation.right_in_left(observation.right, disparity)
    usable = inside & ~metrics.depth_edges(disparity)
    return correlation.local_ncc(left, correlation.high_passed(warped), usable)
