"""Nuisance parameters that are fitted to each scene before the diagnosis, as they differ by room.

The parameters are the pose of the reference depth relative to the camera, ambient light, and the
scale of the projected pattern. The scale drifts with the laser's wavelength. Effects under
diagnosis depart from the fitted values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration import correlation, heldout
from starling.diagnosis.scenes import estimated, pose
from starling.diagnosis.scenes.observation import infrared_observation, match_pairs
from starling.diagnosis.scenes.pose import PosedScene
from starling.sim import simulate
from starling.sim.captures.capture import CapturedScene
from starling.sim.commands.simulate_captures import scene_seed
from starling.sim.effects.effect import Value
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.captured.room_light import LIT_ROOM_W_M2
from starling.sim.scene.scene import ModelError, Scene
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

AMBIENT, SCALE = "ambient", "pattern_scale"  # Rows of the effect table.
TURN = ("model_turn", "model_turn.y", "model_turn.z")
SHIFT = ("model_shift", "model_shift.y", "model_shift.z")
_STEP = 2e-3  # Relative step of the tried scales: dots move by 1.5 px at the image's edge.
_STEPS = 3  # Steps to each side: three times the drift observed with temperature.
_FINE_STEP = 1e-3  # Relative step of the parabola about the best tried scale.
_LEAST_CORRELATION = 0.2  # Known patterns reach 0.8, and wrong ones 0.05 by chance.


@dataclass(frozen=True, slots=True)
class Nuisance:
    """One parameter that is fitted to a scene."""

    common: float  # Base value that settings of effects refer to, the same for all scenes.
    value: float  # Value fitted to this scene.


Nuisances = Mapping[str, Nuisance]  # By effect.


def fit_geometry(captured: CapturedScene, sensor: Sensor) -> Nuisances:
    """Fit the pose of the reference, then the scale of the pattern."""
    fitted = fit_reference_pose(captured, sensor)
    return {**fitted, **fit_pattern_scale(correct_reference(captured, fitted), sensor)}


def fit_reference_pose(captured: CapturedScene, sensor: Sensor) -> Nuisances:
    """Fit the pose of the reference depth relative to the camera, from disparity.

    Args:
        captured: captured scene.
        sensor: the base.

    Returns:
        Empty without an infrared pair, with a `scene.toml`, or with too little valid disparity.

    Raises:
        InputError: if no reference depth is known either.
    """
    frame = captured.fullest()
    if captured.known() is not None or frame.ir_left is None or frame.ir_right is None:
        return {}
    scene = estimated.plain_surface(captured)
    layers = simulate.render_layers(MitsubaScene(scene), sensor, samples=1)
    seed = scene_seed(0, f"pose of {captured.name}")  # Independent noise for each scene.
    pair = simulate.infrared(layers, scene, sensor, seed=seed)
    real_px = match_pairs(frame.ir_left[None], frame.ir_right[None], sensor)[0]
    simulated_px = infrared_observation(sensor, [pair]).ours_px[0]
    truth_m = estimated.reference_depth(captured)
    fitted = pose.fit_pose(real_px - simulated_px, truth_m, captured.info)
    if fitted is None:
        return {}
    values = (*fitted.turn_deg, *fitted.shift_m)
    return {name: Nuisance(0.0, value) for name, value in zip((*TURN, *SHIFT), values, strict=True)}


def correct_reference(captured: CapturedScene, nuisances: Nuisances) -> CapturedScene:
    """Move the reference depth of a captured scene to its fitted pose."""
    if TURN[0] not in nuisances:
        return captured
    rx, ry, rz = (nuisances[name].value for name in TURN)
    x, y, z = (nuisances[name].value for name in SHIFT)
    return PosedScene(
        name=captured.name,
        room=captured.room,
        path=captured.path,
        info=captured.info,
        frames=captured.frames,
        pose=ModelError(turn_deg=(rx, ry, rz), shift_m=(x, y, z)),
    )


def fit_pattern_scale(captured: CapturedScene, sensor: Sensor) -> Nuisances:
    """Fit the pattern scale of a scene without `scene.toml`.

    Args:
        captured: captured scene.
        sensor: the base.

    Raises:
        InputError: if no reference depth is known either.
    """
    if captured.known() is not None:
        return {}
    scale = estimate_pattern_scale(captured, estimated.plain_surface(captured), sensor)
    return {} if scale is None else {SCALE: Nuisance(sensor.projector.pattern_scale, scale)}


def light_nuisance(captured: CapturedScene, scene: Scene, sensor: Sensor) -> Nuisances:
    """Return the ambient light that was estimated with a scene, as a nuisance parameter.

    Ambient light is separated from reflectance by the dots. It is not fitted without images or with
    the projector off.

    Args:
        captured: captured scene.
        scene: estimated scene.
        sensor: the base.
    """
    if captured.fullest().ir_left is None or sensor.projector.power_w == 0:
        return {}
    return {AMBIENT: Nuisance(LIT_ROOM_W_M2, scene.ambient.irradiance_w_m2)}


def apply_to_sensor(sensor: Sensor, nuisances: Nuisances) -> Sensor:
    """Set the fitted pattern scale in the sensor."""
    if SCALE not in nuisances:
        return sensor
    return with_values(sensor, [("projector.pattern_scale", nuisances[SCALE].value)])


def shift_settings(settings: Mapping[str, Value], nuisances: Nuisances) -> dict[str, Value]:
    """Convert settings from the common base to a scene's fitted base; departures stay equal.

    Args:
        settings: value by effect, relative to the common base.
        nuisances: parameters fitted to the scene. The pose is corrected in the reference already.
    """
    shifted = dict(settings)
    for name in (settings.keys() & nuisances.keys()) - {*TURN, *SHIFT}:
        nuisance = nuisances[name]
        shifted[name] = max(0.0, nuisance.value + (float(settings[name]) - nuisance.common))
    return shifted


def common_settings(nuisances: Nuisances) -> dict[str, Value]:
    """Return the common base values of the fitted parameters."""
    return {name: nuisance.common for name, nuisance in nuisances.items()}


def fitted_values(nuisances: Nuisances) -> dict[str, float]:
    """Return the values fitted to a scene, by effect."""
    return {name: nuisance.value for name, nuisance in nuisances.items()}


def estimate_pattern_scale(captured: CapturedScene, scene: Scene, sensor: Sensor) -> float | None:
    """Estimate the pattern scale at which simulated dots coincide with the captured ones.

    The local correlation of both views is computed at several scales; a parabola is fitted about
    the best one.

    Args:
        captured: captured scene.
        scene: its surface, in any light.
        sensor: the base; its pattern scale is the centre of the search.

    Returns:
        None without an infrared pair or with the projector off. None also if the dots correlate at
        no scale: then the pattern is another one.
    """
    frame = captured.fullest()
    if frame.ir_left is None or frame.ir_right is None or sensor.projector.power_w == 0:
        return None
    real = [correlation.high_passed(image) for image in (frame.ir_left, frame.ir_right)]
    stage, base = MitsubaScene(scene), sensor.projector.pattern_scale
    scales = base * (1 + _STEP * np.arange(-_STEPS, _STEPS + 1))
    scores = [_correlation(real, stage, sensor, float(scale)) for scale in scales]
    best = int(np.argmax(scores))
    if scores[best] < _LEAST_CORRELATION:
        return None
    below, above = (
        _correlation(real, stage, sensor, float(scales[best] * (1 + offset)))
        for offset in (-_FINE_STEP, _FINE_STEP)
    )
    curvature = 2 * scores[best] - below - above
    offset = 0.5 * (above - below) / curvature if curvature > 0 else 0.0
    return float(scales[best] * (1 + _FINE_STEP * np.clip(offset, -2, 2)))


def _correlation(
    real: list[NDArray[np.float32]], stage: MitsubaScene, sensor: Sensor, scale: float
) -> float:
    """Average the local correlation over windows of both views, away from depth edges."""
    images, depth_m = heldout.simulate(stage, sensor, scale)
    values = []
    for captured, side in zip(real, ("left", "right"), strict=True):
        usable = heldout.away_from_edges(depth_m[side], sensor)
        simulated = correlation.high_passed(images[side])
        values.append(correlation.local_ncc(captured, simulated, usable))
    pooled = np.concatenate(values)
    return float(pooled.mean()) if pooled.size else 0.0
