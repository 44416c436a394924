"""What is fitted to each scene before effects are asked for: it differs from room to room.

How its reference stands to the camera, how brightly it is lit, and how far the projector's pattern
is spread, as its laser's wavelength drifts with warmth. What all scenes are asked about departs
from each one's own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.calibration import correlation, heldout
from starling.diagnosis.scenes import estimated, pose
from starling.diagnosis.scenes.observation import matched
from starling.diagnosis.scenes.pose import Posed
from starling.sim import simulate
from starling.sim.captures.capture import CapturedScene
from starling.sim.commands.simulate_captures import scene_seed
from starling.sim.effects.effect import Value
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene.captured.room_light import LIT_ROOM_W_M2
from starling.sim.scene.scene import ModelError, Scene
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor

AMBIENT, SCALE = "ambient", "pattern_scale"  # Rows of the effect table.
TURN = ("model_turn", "model_turn.y", "model_turn.z")
SHIFT = ("model_shift", "model_shift.y", "model_shift.z")
_STEP = 2e-3  # Of the scales that are tried: dots some 1.5 px apart at the image's edge.
_STEPS = 3  # To each side: three times what warmth was seen to do.
_CLOSER = 1e-3
_AGREE = 0.2  # Least correlation with the dots: 0.8 where the pattern is known, 0.05 by chance.


@dataclass(frozen=True, slots=True)
class Nuisance:
    """One number of a scene."""

    common: float  # What effects name as the base, the same for all scenes,
    own: float  # and what this scene has there.


Nuisances = Mapping[str, Nuisance]  # By effect.


def of_geometry(captured: CapturedScene, sensor: Sensor) -> Nuisances:
    """Fit all that tells where things lie (`of_reference`, then `of_dots`)."""
    found = of_reference(captured, sensor)
    return {**found, **of_dots(put_right(captured, found), sensor)}


def of_reference(captured: CapturedScene, sensor: Sensor) -> Nuisances:
    """Fit how the reference of a scene stands to the camera, by the disparity of its pair.

    Args:
        captured: what was captured of it.
        sensor: the base.

    Returns:
        Nothing where there is no pair, a file says what the scene is, or too little is seen.

    Raises:
        InputError: if no reference depth is known either.
    """
    frame = captured.fullest()
    if captured.known() is not None or frame.ir_left is None or frame.ir_right is None:
        return {}
    scene = estimated.surface(captured)
    layers = simulate.rendered(Stage(scene), sensor, samples=1)
    seed = scene_seed(0, f"pose of {captured.name}")  # Else all poses would share its noise.
    pair = simulate.infrared(layers, scene, sensor, seed=seed)
    assert pair.right is not None
    real_px = matched(frame.ir_left[None], frame.ir_right[None], sensor)[0]
    simulated_px = matched(pair.left[None], pair.right[None], sensor)[0]
    truth_m = captured.truth_m()
    assert truth_m is not None
    found = pose.fitted(real_px - simulated_px, truth_m, captured.info)
    if found is None:
        return {}
    values = (*found.turn_deg, *found.shift_m)
    return {name: Nuisance(0.0, one) for name, one in zip((*TURN, *SHIFT), values, strict=True)}


def put_right(captured: CapturedScene, nuisances: Nuisances) -> CapturedScene:
    """A captured scene with its reference as it was fitted."""
    if TURN[0] not in nuisances:
        return captured
    rx, ry, rz = (nuisances[name].own for name in TURN)
    x, y, z = (nuisances[name].own for name in SHIFT)
    return Posed(
        name=captured.name,
        room=captured.room,
        path=captured.path,
        info=captured.info,
        frames=captured.frames,
        pose=ModelError(turn_deg=(rx, ry, rz), shift_m=(x, y, z)),
    )


def of_dots(captured: CapturedScene, sensor: Sensor) -> Nuisances:
    """Fit what tells where dots lie, to a scene of which no file says what it is.

    Args:
        captured: what was captured of it.
        sensor: the base.

    Raises:
        InputError: if no reference depth is known either.
    """
    if captured.known() is not None:
        return {}
    scale = pattern_scale(captured, estimated.surface(captured), sensor)
    return {} if scale is None else {SCALE: Nuisance(sensor.projector.pattern_scale, scale)}


def of_light(captured: CapturedScene, scene: Scene, sensor: Sensor) -> Nuisances:
    """Say how a scene is lit, which was estimated from its images.

    Ambient light is told from reflectance by the dots: without images, or with the projector off,
    it was not fitted.

    Args:
        captured: what was captured of it.
        scene: as estimated.
        sensor: the base.
    """
    if captured.fullest().ir_left is None or sensor.projector.power_w == 0:
        return {}
    return {AMBIENT: Nuisance(LIT_ROOM_W_M2, scene.ambient.irradiance_w_m2)}


def on_sensor(sensor: Sensor, nuisances: Nuisances) -> Sensor:
    """The base as it was when a scene was captured."""
    if SCALE not in nuisances:
        return sensor
    return with_values(sensor, [("projector.pattern_scale", nuisances[SCALE].own)])


def own(settings: Mapping[str, Value], nuisances: Nuisances) -> dict[str, Value]:
    """What effects set in one scene: they depart from its own base as they do from the common one.

    Args:
        settings: value by effect, from the common base.
        nuisances: of the scene. Where its reference stands is put right already.
    """
    moved = dict(settings)
    for name in (settings.keys() & nuisances.keys()) - {*TURN, *SHIFT}:
        one = nuisances[name]
        moved[name] = max(0.0, one.own + (float(settings[name]) - one.common))
    return moved


def commonly(nuisances: Nuisances) -> dict[str, Value]:
    """Settings at which every scene has the common base."""
    return {name: one.common for name, one in nuisances.items()}


def pattern_scale(captured: CapturedScene, scene: Scene, sensor: Sensor) -> float | None:
    """Scale of the pattern at which simulated dots lie where the infrared images have them.

    A parabola through local correlations of the images, both views', about the best of some scales.
    None where there is no infrared pair or no light, or where dots agree at no scale: then they are
    another pattern's.

    Args:
        captured: what was captured of the scene.
        scene: its surface, in any light.
        sensor: the base, whose own scale is the middle of those that are tried.
    """
    frame = captured.fullest()
    if frame.ir_left is None or frame.ir_right is None or sensor.projector.power_w == 0:
        return None
    real = [correlation.high_passed(one) for one in (frame.ir_left, frame.ir_right)]
    stage, base = Stage(scene), sensor.projector.pattern_scale
    tried = base * (1 + _STEP * np.arange(-_STEPS, _STEPS + 1))
    agreement = [_agreement(real, stage, sensor, float(one)) for one in tried]
    best = int(np.argmax(agreement))
    if agreement[best] < _AGREE:
        return None
    below, above = (
        _agreement(real, stage, sensor, float(tried[best] * (1 + off)))
        for off in (-_CLOSER, _CLOSER)
    )
    bent = 2 * agreement[best] - below - above
    off = 0.5 * (above - below) / bent if bent > 0 else 0.0
    return float(tried[best] * (1 + _CLOSER * np.clip(off, -2, 2)))


def _agreement(
    real: list[NDArray[np.float32]], stage: Stage, sensor: Sensor, scale: float
) -> float:
    """Mean correlation of both views' windows away from depth edges."""
    images, depth_m = heldout.simulate(stage, sensor, scale)
    found = []
    for seen, side in zip(real, ("left", "right"), strict=True):
        usable = heldout.away_from_edges(depth_m[side], sensor)
        made = correlation.high_passed(images[side])
        found.append(correlation.local_ncc(seen, made, usable))
    every = np.concatenate(found)
    return float(every.mean()) if every.size else 0.0
