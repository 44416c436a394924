"""Nuisance parameters that are fitted to each scene before the diagnosis, as they differ by room.

The parameters are the pose of the reference depth relative to the camera, ambient light, and the
scale of the projected pattern. The scale drifts with the laser's wavelength. Exposure and gain are
read from `frame.json`. Effects under diagnosis depart from these values.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration import correlation, heldout
from starling.diagnosis.scenes import estimated, pose
from starling.diagnosis.scenes.observation import infrared_observation, match_pairs
from starling.diagnosis.scenes.pose import PosedScene
from starling.patterns import errors
from starling.sim import simulate
from starling.sim.captures import frame_record
from starling.sim.captures.capture import CapturedScene
from starling.sim.commands.simulate_captures import scene_seed
from starling.sim.effects import setting as setting
from starling.sim.effects.effect import Value
from starling.sim.imaging.imager.exposure import Exposure
from starling.sim.imaging.signals import signals
from starling.sim.render import direct
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.captured import known_geometry, room_light
from starling.sim.scene.captured.room_light import LIT_ROOM_W_M2
from starling.sim.scene.scene import ModelError, Scene
from starling.sim.sensor.sensor import Sensor

AMBIENT, SCALE = "ambient", "pattern_scale"  # Rows of the effect table.
TURN = ("model_turn", "model_turn.y", "model_turn.z")
SHIFT = ("model_shift", "model_shift.y", "model_shift.z")
EXPOSURE, GAIN, AUTO_EXPOSURE = "exposure", "gain", "auto_exposure"
_EQUAL_EXPOSURE = 0.01  # Relative difference of exposures that counts as equal.
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


def recorded_exposure(
    captured: CapturedScene, exposures: Sequence[Exposure], sensor: Sensor
) -> Nuisances:
    """Return exposure time and gain of `frame.json` where they differ from the sensor's.

    Auto exposure of the sensor gives way to a recorded time. It stays where light and reflectance
    are estimated: the level of such a scene is arbitrary, and auto exposure corrects it.

    Args:
        captured: captured scene.
        exposures: exposure of its first repeat; empty if the camera records none.
        sensor: the base.

    Raises:
        InputError: if no imager has this exposure time or gain.
    """
    imager = sensor.left
    if not exposures or (imager.auto_exposure_level > 0 and captured.known() is None):
        return {}
    exposure_s, gain = exposures[0].exposure_s, exposures[0].gain
    with errors.naming(f"{captured.path}, {frame_record.FILE}"):
        dataclasses.replace(imager, exposure_s=exposure_s, gain=gain)
    values = {
        EXPOSURE: Nuisance(imager.exposure_s, exposure_s),
        GAIN: Nuisance(imager.gain, gain),
        AUTO_EXPOSURE: Nuisance(imager.auto_exposure_level, 0.0),
    }
    return {
        name: nuisance
        for name, nuisance in values.items()
        if not math.isclose(nuisance.common, nuisance.value, rel_tol=_EQUAL_EXPOSURE)
    }


def fit_light(
    captured: CapturedScene, scene: Scene, sensor: Sensor, fitted: Nuisances
) -> tuple[Scene, Nuisances]:
    """Fit ambient light, unless `scene.toml` states it.

    The contrast of the dots separates it from reflectance. It is not fitted without images or with
    the projector off.

    Args:
        captured: captured scene.
        scene: scene of its `scene.toml`, or estimated with its light.
        sensor: the base.
        fitted: parameters fitted earlier; ambient light among them is not fitted again.

    Returns:
        The scene in fitted light, and all fitted parameters.
    """
    known, image = captured.known(), captured.fullest().ir_left
    if image is None or sensor.projector.power_w == 0:
        return scene, fitted
    if known is None:
        light = Nuisance(LIT_ROOM_W_M2, scene.ambient.irradiance_w_m2)
        return scene, {**fitted, AMBIENT: light}
    if known_geometry.states_ambient(known):
        return scene, fitted
    if AMBIENT not in fitted:
        stated, common = captured.info.black_level_dn, scene.ambient.irradiance_w_m2
        black_dn = sensor.left.black_level_dn if stated is None else stated
        dotted = np.maximum(image.astype(np.float32) - np.float32(black_dn), 0)
        view = direct.layers(MitsubaScene(scene), sensor).left
        signal = signals(view, scene, sensor, "left")
        light = Nuisance(common, room_light.ambient_w_m2(dotted, signal, sensor.left))
        fitted = {**fitted, AMBIENT: light}
    lit = dataclasses.replace(scene.ambient, irradiance_w_m2=fitted[AMBIENT].value)
    return dataclasses.replace(scene, ambient=lit), fitted


def apply_to_sensor(sensor: Sensor, nuisances: Nuisances) -> Sensor:
    """Set the fitted parameters that belong to the sensor: pattern scale, exposure, gain."""
    values = {
        name: nuisance.value
        for name, nuisance in nuisances.items()
        if not setting.acts_on_scene_only(name)
    }
    return setting.on_sensor(sensor, values) if values else sensor


def shift_settings(settings: Mapping[str, Value], nuisances: Nuisances) -> dict[str, Value]:
    """Convert settings from the common base to a scene's fitted base; departures stay equal.

    Departures of exposure time and gain are factors.

    Args:
        settings: value by effect, relative to the common base.
        nuisances: parameters fitted to the scene. The pose is corrected in the reference already.
    """
    shifted = dict(settings)
    for name in (settings.keys() & nuisances.keys()) - {*TURN, *SHIFT}:
        nuisance = nuisances[name]
        if name in (EXPOSURE, GAIN):
            shifted[name] = float(settings[name]) * nuisance.value / nuisance.common
            continue
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

    The local correlation of both views is computed at several scales, with one ray per pixel. A
    parabola is fitted about the best one, with all rays.

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
    coarse = [_correlation(real, stage, sensor, float(scale), subpixels=1) for scale in scales]
    best = float(scales[np.argmax(coarse)])
    middle = _correlation(real, stage, sensor, best)
    if middle < _LEAST_CORRELATION:
        return None
    below, above = (
        _correlation(real, stage, sensor, best * (1 + offset))
        for offset in (-_FINE_STEP, _FINE_STEP)
    )
    curvature = 2 * middle - below - above
    offset = 0.5 * (above - below) / curvature if curvature > 0 else 0.0
    return float(best * (1 + _FINE_STEP * np.clip(offset, -2, 2)))


def _correlation(
    real: list[NDArray[np.float32]],
    stage: MitsubaScene,
    sensor: Sensor,
    scale: float,
    *,
    subpixels: int = 2,
) -> float:
    """Average the local correlation over windows of both views, away from depth edges."""
    images, depth_m = heldout.simulate(stage, sensor, scale, subpixels=subpixels)
    values = []
    for captured, side in zip(real, ("left", "right"), strict=True):
        usable = heldout.away_from_edges(depth_m[side], sensor)
        simulated = correlation.high_passed(images[side])
        values.append(correlation.local_ncc(captured, simulated, usable))
    pooled = np.concatenate(values)
    return float(pooled.mean()) if pooled.size else 0.0
