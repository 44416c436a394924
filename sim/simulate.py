"""A scene and a sensor in; infrared pair, depth and a reason for every missing pixel out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from patterns import errors
from sim import imager, randomness, reference, render
from sim.depth import DepthMap, disparity_from_depth, measure
from sim.imager import Infrared
from sim.layers import Image, Layers, Mask, Truth, View
from sim.light.received import received
from sim.optics import image as optics
from sim.reason import Reason
from sim.scene import Scene
from sim.sensor import Imager, Sensor
from sim.stage import Stage

_WINDOW_PX = 9  # The window in which a matcher needs light.
_DARK_SNR = 2.0  # Below this mean signal over noise a window is dark.
_BURNT_SHARE = 0.25  # Above this share of pixels at the ceiling a window is saturated.


@dataclass(frozen=True, kw_only=True, slots=True)
class Shot:
    """One simulated reading of a sensor."""

    layers: Layers
    ir_left: Infrared
    ir_right: Infrared
    depth: DepthMap
    exposure_s: float
    gain: float


def simulate(
    scene: Scene | Stage, sensor: Sensor, *, seed: int = 0, frame: int = 0, samples: int = 16
) -> Shot:
    """Simulate one reading.

    Args:
        scene: what is seen; give a `Stage` to use one scene many times.
        sensor: what sees it.
        seed: of the capture; equal seeds give equal bits on one machine.
        frame: number in a capture of several frames; each has its own noise.
        samples: paths a coarse pixel of indirect light, where the scene has interreflection.

    Raises:
        InputError: if `samples` is not at least 1 or the scene cannot be loaded.
    """
    errors.in_interval("samples", samples, 1, 4096, "16 are enough for most scenes.")
    errors.in_interval("seed", seed, 0, 2**63 - 1, "Give a whole number from 0.")
    stage = scene if isinstance(scene, Stage) else Stage(scene)
    layers = render.layers(stage, sensor)
    if stage.scene.interreflection:
        from sim import indirect

        layers = indirect.add(layers, stage, sensor, samples=samples, seed=seed)
    return expose(layers, stage.scene, sensor, seed=seed, frame=frame)


def sequence(
    scene: Scene | Stage, sensor: Sensor, *, frames: int, seed: int = 0, samples: int = 16
) -> Iterator[Shot]:
    """Simulate readings of a scene that keeps still; it is rendered once.

    Args:
        scene, sensor, seed, samples: as `simulate`.
        frames: how many readings.
    """
    stage = scene if isinstance(scene, Stage) else Stage(scene)
    shot = simulate(stage, sensor, seed=seed, samples=samples)
    yield shot
    for frame in range(1, frames):
        shot = expose(shot.layers, stage.scene, sensor, seed=seed, frame=frame)
        yield shot


def expose(layers: Layers, scene: Scene, sensor: Sensor, *, seed: int = 0, frame: int = 0) -> Shot:
    """Turn rendered layers into a reading; nothing is rendered again.

    Args:
        layers: of this sensor's geometry and projector.
        scene: they are of; the strengths of its lights count.
        sensor: whose projector's strength, optics, imagers, matcher and post-processing act.
        seed: of the capture.
        frame: number in the capture.
    """
    wavelength = sensor.projector.wavelength_nm
    left = _image(layers.left, scene, sensor, "left", seed, frame)
    exposure = imager.control(sensor.left, left, wavelength)
    electrons = imager.mean_electrons(sensor.left, left, wavelength, exposure)
    ir_left = imager.read_out(
        sensor.left, electrons, randomness.generator(seed, frame, "imager", "noise left")
    )
    if sensor.kind == "structured_light":
        ir_right = reference.image(sensor)
    else:
        right = _image(layers.right, scene, sensor, "right", seed, frame)
        ir_right = imager.read_out(
            sensor.right,
            imager.mean_electrons(sensor.right, right, wavelength, exposure),
            randomness.generator(seed, frame, "imager", "noise right"),
        )
    causes = _geometric_causes(layers.truth, sensor) | _photometric_causes(
        sensor.left, electrons, ir_left
    )
    return Shot(
        layers=layers,
        ir_left=ir_left,
        ir_right=ir_right,
        depth=measure(ir_left, ir_right, sensor, causes=causes),
        exposure_s=exposure.exposure_s,
        gain=exposure.gain,
    )


def _image(
    view: View, scene: Scene, sensor: Sensor, side: Literal["left", "right"], seed: int, frame: int
) -> Image:
    light = received(view, scene, sensor, seed=seed, frame=frame)
    return optics.image(light, view.depth_m, sensor, side, seed=seed)


def _geometric_causes(truth: Truth, sensor: Sensor) -> dict[Reason, Mask]:
    """Causes that follow from where things are."""
    surface = np.isfinite(truth.depth_m)
    disparity = disparity_from_depth(
        truth.depth_m, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m
    )
    column = np.arange(sensor.width, dtype=np.float32)
    outside = surface & (column - disparity < -0.5)
    causes = {
        Reason.NO_SURFACE: ~surface,
        Reason.OUTSIDE_OVERLAP: outside,
        Reason.SHADOWED: surface & ~truth.lit & (sensor.projector.power_w > 0),
    }
    if sensor.kind == "stereo":  # Else there is no right imager to be hidden from.
        causes[Reason.OCCLUDED] = surface & ~truth.right_sees & ~outside
    return causes


def _photometric_causes(part: Imager, electrons: Image, infrared: Infrared) -> dict[Reason, Mask]:
    """Causes that follow from how much light there is."""
    window = (_WINDOW_PX, _WINDOW_PX)
    mean = np.asarray(cv2.blur(electrons, window), np.float32)
    step_e = 1 / part.dn_per_electron
    noise = np.sqrt(imager.noise_e(part, mean) ** 2 + np.float32(step_e * step_e / 12))
    burnt = (infrared >= part.saturation_dn).astype(np.float32)
    return {
        Reason.LOW_SIGNAL: mean < _DARK_SNR * noise,
        Reason.SATURATED: cv2.blur(burnt, window) > _BURNT_SHARE,
    }
