"""Time and memory of a calibration from three scenes at 1280x720, and the cost of one iteration.

The scenes are simulated with a D435 that differs from its preset. Their surfaces are known in
metres. Every fit runs in its own process, so that its peak memory can be measured.

    python benchmarks/speed/calibrate_speed.py
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from starling import calibration
from starling.calibration import observation, parameters
from starling.calibration.geometry import residuals
from starling.sim.captures import capture
from starling.sim.commands import bench, simulate_captures
from starling.sim.render import backend, emission, plugin_scene
from starling.sim.sensor import edits, presets

EDITS = ("width=1280", "height=720", "fx_px=640", "fy_px=640", "cx_px=639.5", "cy_px=359.5")
TRUTH = {
    "baseline_m": 0.0512,
    "fx_px": 643.0,
    "projector.position_m.x": 0.0275,
    "projector.position_m.y": 0.001,
    "projector.rotation_deg.y": 0.4,
    "right.alignment.offset_y_px": 0.3,
}
SCENES = ("tabletop", "clutter", "staircase")
GEOMETRY = ("baseline", "alignment", "focal", "centre", "projector", "dots")
LEVELS = ("photometry", "noise")
FITS = {"all but the pattern": (*GEOMETRY, *LEVELS), "pattern and levels": ("pattern", *LEVELS)}
ROUNDS = 5


def nominal():
    """The preset at 1280x720."""
    return edits.apply(presets.load("d435"), EDITS)


def captured(folder: Path):
    """Return the scenes of a folder."""
    return [scene for name in SCENES for scene in capture.open_set(str(folder / name)).scenes]


def fit(folder: str, name: str) -> None:
    """Fit in this process and print seconds and peak memory."""
    with tempfile.TemporaryDirectory() as patterns:
        start, cpu = time.perf_counter(), time.process_time()
        result = calibration.fit(
            captured(Path(folder)), nominal(), free=FITS[name], heldout=(), folder=Path(patterns)
        )
        figures = {
            "seconds": round(time.perf_counter() - start, 1),
            "cpu_s": round(time.process_time() - cpu, 1),
            "memory_gib": bench.peak_gib(),
            "stages_s": dict(result.seconds),
            "steps": {key: len(solution.cost) for key, solution in result.solutions.items()},
        }
    print(json.dumps({name: figures}))


def iteration(folder: Path) -> dict[str, float]:
    """Time one view's part of an iteration, and a plain render with as many rays."""
    mi, sensor = backend.mitsuba(), nominal()
    view_observation = observation.load(captured(folder)[1], sensor)
    view = residuals.make_views([view_observation], sensor)[0]
    free = parameters.free(GEOMETRY, sensor)
    light = emission.irradiance_at_unit_distance(sensor.projector)
    lit = plugin_scene.lit(view.stage, sensor, light)
    place = view.stage.scene.world_from_left
    camera = plugin_scene.camera(sensor, place, sampler=plugin_scene.fixed(2))
    integrator = plugin_scene.direct()

    def bare() -> None:
        np.array(mi.render(lit, sensor=camera, integrator=integrator, spp=4))

    def rendered() -> None:
        residuals.predict(view, sensor, free)

    def reduced() -> None:
        residuals.normal_equations(predicted, size_px=24, blur_px=0.0, variance=None)

    predicted = residuals.predict(view, sensor, free)
    times = {job.__name__: [] for job in (bare, rendered, reduced)}
    for _ in range(ROUNDS + 1):
        for job in (bare, rendered, reduced):
            start = time.perf_counter()
            job()
            times[job.__name__].append(time.perf_counter() - start)
    result = {name: statistics.median(values[1:]) for name, values in times.items()}
    result["columns"] = len(free)
    result["ratio_rendered"] = result["rendered"] / result["bare"]
    result["ratio"] = (result["rendered"] + result["reduced"]) / result["bare"]
    return result


def main() -> None:
    """Simulate the captures, fit them, and time an iteration."""
    if len(sys.argv) > 1:
        fit(*sys.argv[1:])
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        true = parameters.with_values(nominal(), TRUTH.items())
        for number, scene in enumerate(SCENES):
            simulate_captures.simulate_captures(scene, true, folder / scene, seed=number)
        for groups in FITS:
            subprocess.run([sys.executable, __file__, name, groups], check=True)
        print(json.dumps({"iteration": iteration(folder)}, indent=1))


if __name__ == "__main__":
    main()
