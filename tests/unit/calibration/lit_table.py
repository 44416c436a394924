"""A simulated capture of a table by a small camera, for the tests of level fits."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np

from starling.calibration.observation import Observation
from starling.calibration.photometry.photometry_fit import Photometry
from starling.sim import simulate
from starling.sim.captures import writer
from starling.sim.render import direct
from starling.sim.render.layers import Layers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Scene
from starling.sim.sensor import edits, presets
from starling.sim.sensor.sensor import Sensor

SIZE = [
    ("width", 320),
    ("height", 192),
    ("fx_px", 163.0),
    ("fy_px", 163.0),
    ("cx_px", 159.5),
    ("cy_px", 95.5),
    ("imager.auto_exposure_level", 0.0),
    ("imager.exposure_s", 0.016),
]
START = edits.with_values(presets.load("d435"), SIZE)
TRUTH = edits.with_values(
    START,
    [
        ("projector.power_w", 0.22),
        ("projector.falloff", 1.5),
        ("imager.lens.vignetting", 3.0),
        ("imager.lens.blur_px", 0.75),
        ("imager.black_level_dn", 6.0),
        ("projector.speckle_contrast", 0.2),
    ],
)
AMBIENT_W_M2 = 0.15
INFO = writer.info_of(START, source="made by a test", licence="", notes="")
SCENE = scenes.tabletop(3)
AMBIENT = f"scene.ambient.irradiance_w_m2[{SCENE.name}]"


@cache
def captured_layers() -> Layers:
    return direct.layers(MitsubaScene(SCENE), TRUTH, subpixels=3)


@cache
def fitted_layers() -> dict[str, Layers]:
    return {SCENE.name: direct.layers(MitsubaScene(SCENE), START, subpixels=4)}


def observed(
    seed: int = 7,
    *,
    sensor: Sensor = TRUTH,
    off: bool = False,
    frames: int = 1,
    scene: Scene = SCENE,
    layers: Layers | None = None,
) -> Observation:
    """Simulate a capture; the observation's scene has a different ambient light."""
    light = dataclasses.replace(scene.ambient, irradiance_w_m2=AMBIENT_W_M2)
    lit = dataclasses.replace(scene, ambient=light)
    layers = layers or captured_layers()
    pairs = [
        simulate.infrared(layers, lit, sensor, seed=seed, frame=frame) for frame in range(frames)
    ]
    dark = edits.with_values(sensor, [("projector.power_w", 0.0)])
    codes = np.stack([pair.left for pair in pairs])
    pair_off = simulate.infrared(layers, lit, dark, seed=seed, frame=frames) if off else None

    def image(read: np.ndarray | None) -> np.ndarray | None:
        return None if read is None else read.astype(np.float32)

    return Observation(
        name=scene.name,
        room=scene.name,
        info=INFO,
        left=image(pairs[0].left),
        right=image(pairs[0].right),
        left_off=image(pair_off.left) if pair_off else None,
        right_off=image(pair_off.right) if pair_off else None,
        scene=scene,
        metric=True,
        repeats=codes.astype(np.uint8) if frames > 1 else None,
    )


def values_by_name(fit: Photometry) -> dict[str, float]:
    return {estimate.name: estimate.value for estimate in fit.solution.estimates}


def deviations(fit: Photometry) -> dict[str, float]:
    return {estimate.name: estimate.sd for estimate in fit.solution.estimates}
