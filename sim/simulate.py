"""A scene and a sensor in; infrared pair, depth and a reason for every missing pixel out."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from starling.patterns import errors
from starling.sim.geometry import motion
from starling.sim.imaging import imager
from starling.sim.imaging.imager import Infrared
from starling.sim.imaging.lens_input import received
from starling.sim.imaging.optics import image as optics
from starling.sim.reason import Reason
from starling.sim.render import direct
from starling.sim.render.layers import Image, Layers, Mask, Truth, View
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene.scene import Scene
from starling.sim.sensor.post import refuse_single_frame
from starling.sim.sensor.sensor import Imager, Sensor
from starling.sim.stereo.depth import DepthMap, disparity_from_depth
from starling.sim.stereo.measurement import measure
from starling.sim.stereo.post.temporal import History
from starling.sim.stereo.registration import refuse_without, register

Side = Literal["left", "right"]

_WINDOW_PX = 9  # The window in which a matcher needs light.
_DARK_SNR = 2.0  # Below this mean signal over noise a window is dark.
_BURNT_SHARE = 0.25  # Above this share of pixels at the ceiling a window is saturated.


@dataclass(frozen=True, kw_only=True, slots=True)
class Shot:
    """One simulated reading of a sensor."""

    layers: Layers
    ir_left: Infrared
    ir_right: Infrared | None  # None: structured light, which has one imager.
    depth: DepthMap
    registered_m: Image | None  # Depth in the colour camera's image, where that is asked for.
    exposure_s: float
    gain: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Pair:
    """One reading of the imagers."""

    left: Infrared
    right: Infrared | None  # None: structured light.
    matched_left: Infrared  # With the bits that `left` lacks and the matcher reads.
    matched_right: Infrared | None
    electrons: Image  # Expected in the left imager's pixels, before noise (h, w).
    exposure: imager.Exposure


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
        InputError: if `samples` is not at least 1, the scene cannot be loaded, the sensor
            filters over time (see `sequence`), or it registers depth to no colour camera.
    """
    refuse_impossible(sensor, 1)
    stage = scene if isinstance(scene, Stage) else Stage(scene)
    layers = rendered(stage, sensor, samples=samples, seed=seed)
    return expose(layers, stage.scene, sensor, seed=seed, frame=frame)


def sequence(
    scene: Scene | Stage, sensor: Sensor, *, frames: int, seed: int = 0, samples: int = 16
) -> Iterator[Shot]:
    """Simulate readings of a scene that keeps still; it is rendered once.

    Args:
        scene: as in `simulate`.
        sensor: likewise.
        frames: how many readings.
        seed: as in `simulate`.
        samples: likewise.

    Raises:
        InputError: as `simulate`, or a filter over time where there is one frame alone; nothing
            is rendered before.
    """
    refuse_impossible(sensor, frames)
    return _readings(scene, sensor, frames=frames, seed=seed, samples=samples)


def refuse_impossible(sensor: Sensor, frames: int) -> None:
    """Refuse post-processing that has nothing to work on, which needs no rendering to be known.

    Args:
        sensor: whose post-processing will act.
        frames: how many frames of one scene follow each other.

    Raises:
        InputError: a filter over time on one frame, or registration without a colour camera.
    """
    refuse_single_frame(sensor.post, frames)
    if sensor.post.registered:
        refuse_without(sensor)


def _readings(
    scene: Scene | Stage, sensor: Sensor, *, frames: int, seed: int, samples: int
) -> Iterator[Shot]:
    stage = scene if isinstance(scene, Stage) else Stage(scene)
    layers = rendered(stage, sensor, samples=samples, seed=seed)
    past = None
    for frame in range(frames):
        shot = expose(layers, stage.scene, sensor, seed=seed, frame=frame, past=past)
        past = shot.depth.history
        yield shot


def expose(
    layers: Layers,
    scene: Scene,
    sensor: Sensor,
    *,
    seed: int = 0,
    frame: int = 0,
    past: History | None = None,
) -> Shot:
    """Turn rendered layers into a reading; nothing is rendered again.

    Args:
        layers: of this sensor's geometry and projector.
        scene: they are of; the strengths of its lights count.
        sensor: whose projector's strength, optics, imagers, matcher and post-processing act.
        seed: of the capture.
        frame: number in the capture.
        past: `depth.history` of the frame before, which a filter over time goes on from.
    """
    pair = infrared(layers, scene, sensor, seed=seed, frame=frame)
    causes = _geometric_causes(layers.truth, sensor) | _photometric_causes(sensor.left, pair)
    depth = measure(pair.matched_left, pair.matched_right, sensor, causes=causes, past=past)
    return Shot(
        layers=layers,
        ir_left=pair.left,
        ir_right=pair.right,
        depth=depth,
        registered_m=register(depth.depth_m, sensor) if sensor.post.registered else None,
        exposure_s=pair.exposure.exposure_s,
        gain=pair.exposure.gain,
    )


def infrared(
    layers: Layers, scene: Scene, sensor: Sensor, *, seed: int = 0, frame: int = 0
) -> Pair:
    """Turn rendered layers into the infrared pair alone (see `expose`)."""
    wavelength = sensor.projector.wavelength_nm
    views: dict[Side, View] = {"left": layers.left}
    if layers.right is not None:
        views["right"] = layers.right
    parts: dict[Side, Imager] = {"left": sensor.left, "right": sensor.right}

    def formed(side: Side, by: Sensor = sensor) -> Image:
        light = received(views[side], scene, by, seed=seed, frame=frame)
        return optics.image(light, views[side].depth_m, by, side, seed=seed)

    def metered() -> Image:
        """What exposure goes by: it follows over many frames, not one frame's own flicker."""
        if not (sensor.projector.flicker and sensor.left.auto_exposure_level):
            return images["left"]
        steady = dataclasses.replace(sensor.projector, flicker=0.0)
        return formed("left", dataclasses.replace(sensor, projector=steady))

    def read_out(side: Side) -> imager.Readout:
        return imager.read_out(
            parts[side],
            electrons[side],
            exposure_s=exposure.exposure_s,
            unit=sensor.unit,
            side=side,
            seed=seed,
            frame=frame,
        )

    # The work is in libraries that let go of Python's lock: two threads are nearly twice as fast.
    with ThreadPoolExecutor(2) as pool:
        images = dict(zip(views, pool.map(formed, views), strict=True))
        exposure = imager.control(sensor.left, metered(), wavelength)
        electrons = {
            side: imager.mean_electrons(parts[side], image, wavelength, exposure)
            for side, image in images.items()
        }
        read = dict(zip(views, pool.map(read_out, views), strict=True))
    right = read.get("right")
    return Pair(
        left=read["left"].delivered,
        right=right and right.delivered,
        matched_left=read["left"].matched,
        matched_right=right and right.matched,
        electrons=electrons["left"],
        exposure=exposure,
    )


def rendered(
    stage: Stage,
    sensor: Sensor,
    *,
    samples: int = 16,
    seed: int = 0,
    step_px: float = motion.STEP_PX,
) -> Layers:
    """Render a scene's layers, for `expose` to make readings of (arguments as in `simulate`).

    Where the sensor moves, for as long as its exposure control takes, in moments between which no
    point moves by more than `step_px`.
    """
    errors.in_interval("samples", samples, 1, 4096, "16 are enough for most scenes.")
    errors.in_interval("seed", seed, 0, 2**63 - 1, "Give a whole number from 0.")
    exposure_s = sensor.left.exposure_s
    if sensor.left.auto_exposure_level and not stage.scene.motion.still:
        still = infrared(direct.layers(stage, sensor), stage.scene, sensor, seed=seed)
        exposure_s = still.exposure.exposure_s
    layers = direct.layers(stage, sensor, exposure_s=exposure_s, step_px=step_px)
    if stage.scene.interreflection:
        from starling.sim.render import indirect

        layers = indirect.add(layers, stage, sensor, samples=samples, seed=seed)
    return layers


def _geometric_causes(truth: Truth, sensor: Sensor) -> dict[Reason, Mask]:
    """Causes that follow from where things are."""
    surface = np.isfinite(truth.depth_m)
    causes = {
        Reason.NO_SURFACE: ~surface,
        Reason.SHADOWED: surface & ~truth.lit & (sensor.projector.power_w > 0),
    }
    if sensor.kind == "structured_light":  # There is no right imager to be hidden from.
        return causes
    true_baseline_m = sensor.baseline_m * (1 + sensor.baseline_error)
    disparity = disparity_from_depth(
        truth.depth_m, focal_px=sensor.fx_px, baseline_m=true_baseline_m
    )
    outside = surface & (np.arange(sensor.width, dtype=np.float32) - disparity < -0.5)
    causes[Reason.OUTSIDE_OVERLAP] = outside
    causes[Reason.OCCLUDED] = surface & ~truth.right_sees & ~outside
    return causes


def _photometric_causes(part: Imager, pair: Pair) -> dict[Reason, Mask]:
    """Causes that follow from how much light there is."""
    window = (_WINDOW_PX, _WINDOW_PX)
    mean = np.asarray(cv2.blur(pair.electrons, window), np.float32)
    step_e = 1 / part.dn_per_electron
    noise_e = imager.noise_e(part, mean, pair.exposure.exposure_s)
    noise = np.sqrt(noise_e**2 + np.float32(step_e * step_e / 12))
    burnt = (pair.left >= part.saturation_dn).astype(np.float32)
    return {
        Reason.LOW_SIGNAL: mean < _DARK_SNR * noise,
        Reason.SATURATED: cv2.blur(burnt, window) > _BURNT_SHARE,
    }
