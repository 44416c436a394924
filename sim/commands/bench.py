"""`starling bench`: time the pipeline and its baseline of bare library calls in one run."""

from __future__ import annotations

import dataclasses
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from starling.sim import effects, simulate
from starling.sim.console import progress
from starling.sim.effects import Value, setting
from starling.sim.geometry import frames
from starling.sim.render import backend, direct, emission, plugin_scene
from starling.sim.render.layers import Layers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.matcher import named
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.post import chain
from starling.sim.stereo.registration import register

_SIZE = (1280, 720)
_SUBPIXELS = 2
_SEARCH_PX = 128


def bench(
    *, repeats: int = 5, samples: int = 16, track: progress.Progress = progress.silent
) -> dict[str, Any]:
    """Time the pipeline on `clutter` at 1280x720 and its baseline, alternating in each round.

    The baseline is two bare `mi.render` calls and one bare `StereoSGBM.compute` (3WAY, block 5,
    128 disparities). The renders cast as many primary and shadow rays as the pipeline.

    Args:
        repeats: rounds; medians are reported.
        samples: paths per coarse pixel for the time with indirect light.
        track: wraps the loop over rounds. The first round compiles and is not counted.

    Returns:
        Medians [s], their ratios to the baseline, stage times [ms] and peak memory [GiB].
    """
    sensor = _sensor()
    scene = scenes.clutter()
    stage = MitsubaScene(scene)
    bounced = MitsubaScene(dataclasses.replace(scene, interreflection=1.0))
    shot = simulate.simulate(stage, sensor)
    layers = shot.layers
    exact = dataclasses.replace(sensor, matcher=named("d4xx"))
    floor = _floor(stage, sensor)
    jobs: dict[str, Callable[[], Any]] = {
        "floor": lambda: floor(shot.ir_left, shot.ir_right),
        "pipeline": lambda: simulate.simulate(stage, sensor),
        "pipeline_d4xx": lambda: simulate.simulate(stage, exact),
        "layers": lambda: direct.layers(stage, sensor, subpixels=_SUBPIXELS),
        "expose": lambda: simulate.expose(layers, scene, sensor),
        "expose_d4xx": lambda: simulate.expose(layers, scene, exact),
        "moved": _moving(sensor),
        "indirect": lambda: simulate.simulate(bounced, sensor, samples=samples),
        "effects": _effects(layers, scene, sensor),
        "effects_all": _effects(layers, *_all_on(scene, sensor)),
    }
    times = {name: [] for name in jobs}
    for _ in track(range(repeats + 1), "bench"):
        for name, job in jobs.items():
            started = time.perf_counter()
            job()
            times[name].append(time.perf_counter() - started)
    median = {name: float(np.median(values[1:])) for name, values in times.items()}
    return {
        "pipeline_s": median["pipeline"],
        "pipeline_d4xx_s": median["pipeline_d4xx"],
        "floor_s": median["floor"],
        "ratio": median["pipeline"] / median["floor"],
        "ratio_d4xx": median["pipeline_d4xx"] / median["floor"],
        "second_frame_ratio": median["moved"] / median["pipeline"],
        "indirect_s": median["indirect"],
        "effects_ms": {
            "layers": 1e3 * median["layers"],
            "expose and match": 1e3 * median["expose"],
            "expose and match d4xx": 1e3 * median["expose_d4xx"],
            "preset's own": 1e3 * median["effects"],
            "all on": 1e3 * median["effects_all"],
        },
        "peak_gib": peak_gib(),
        "variant": str(backend.mitsuba().variant()),
        "size": list(_SIZE),
    }


def _effects(layers: Layers, scene: Scene, sensor: Sensor) -> Callable[[], None]:
    """Return a job: one capture of the infrared pair and its post-processing, without matching."""
    shot = simulate.expose(layers, scene, sensor)
    seed = 0

    def run() -> None:
        nonlocal seed
        seed += 1  # Avoids cached random fields, which are drawn once per capture.
        simulate.infrared(layers, scene, sensor, seed=seed)
        depth = chain.process(shot.depth, sensor, causes={}, past=shot.depth.history)
        if sensor.post.registered:
            register(depth.depth_m, sensor)

    return run


def _all_on(scene: Scene, sensor: Sensor) -> tuple[Scene, Sensor]:
    """Set all effects but the matcher's and those that need a new render to mid-range values."""
    settings: dict[str, Value] = {}
    for row in effects.table():
        first = row.parameters[0]
        if row.rerender or row.stage is effects.Stage.MATCHER or first.neutral is None:
            continue
        if first.choices:
            settings[row.name] = next(choice for choice in first.choices if choice != first.neutral)
        elif first.low is not None and first.high is not None:
            settings[row.name] = (first.low + first.high) / 2
    moved, lit = setting.apply(sensor, scene, settings)
    return lit, moved


def peak_gib() -> float:
    """Peak resident memory of this process [GiB].

    On Linux a process inherits `ru_maxrss` from its parent; `VmHWM` is its own.
    """
    status = Path("/proc/self/status")
    if status.exists():
        lines = (line.split() for line in status.read_text(encoding="ascii").splitlines())
        return next(int(words[1]) for words in lines if words[0] == "VmHWM:") / 2**20
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**30 if sys.platform == "darwin" else peak / 2**20


def _sensor() -> Sensor:
    """Return the D435 preset at 1280x720 with the fast matcher."""
    preset = presets.load("d435")
    width, height = _SIZE
    scale = width / preset.width
    return dataclasses.replace(
        preset,
        width=width,
        height=height,
        fx_px=preset.fx_px * scale,
        fy_px=preset.fy_px * scale,
        cx_px=width / 2,
        cy_px=height / 2,
        matcher=named("fast"),
    )


def _floor(stage: MitsubaScene, sensor: Sensor) -> Callable[[Any, Any], None]:
    mi = backend.mitsuba()
    lit = plugin_scene.lit(stage, sensor, emission.irradiance_at_unit_distance(sensor.projector))
    left = stage.scene.world_from_left
    eyes = (left, frames.right_of(left, sensor.baseline_m))
    cameras = [
        plugin_scene.camera(sensor, eye, sampler=plugin_scene.fixed(_SUBPIXELS)) for eye in eyes
    ]
    integrator = plugin_scene.direct()
    matcher = cv2.StereoSGBM.create(0, _SEARCH_PX, 5, 200, 800, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY)

    def run(ir_left: Any, ir_right: Any) -> None:
        for camera in cameras:
            image = mi.render(lit, sensor=camera, integrator=integrator, spp=_SUBPIXELS**2)
            np.array(image)
        matcher.compute(ir_left, ir_right)

    return run


def _moving(sensor: Sensor) -> Callable[[], Any]:
    """Return a job: the next frame of a sensor that moves through one scene."""
    scene = scenes.clutter()
    stage = MitsubaScene(scene)
    step = 0

    def run() -> Any:
        nonlocal step
        step += 1
        stage.scene = dataclasses.replace(
            scene, world_from_left=scene.world_from_left @ frames.pose((0.01 * step, 0.0, 0.0))
        )
        return simulate.simulate(stage, sensor)

    return run
