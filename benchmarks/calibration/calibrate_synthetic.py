"""Calibrate simulated captures with ground truth: errors, convergence, coverage of intervals.

A sensor is perturbed at random, and three scenes are simulated with it. The simulation differs
from the fit in seed and sub-pixel positions, and has the preset's noise and speckle. The fit
starts from the preset. Cases:

- `metric`: surfaces known in metres.
- `reflectance`: as `metric`, with the reflectance of each body wrong by a factor from 0.5 to 2.
- `reference`: reference depth maps with 2 mm of noise, in the view of the nominal pinhole. The
  pattern is an image, and its field is also free.

    python benchmarks/calibration/calibrate_synthetic.py --sensor d435 --case metric --starts 40
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from starling.calibration import observation, parameters
from starling.calibration.geometry.geometry_fit import fit_geometry
from starling.calibration.observation import Observation
from starling.calibration.solution import Solution
from starling.patterns import errors
from starling.sim.captures import capture, writer
from starling.sim.captures import info as capture_info
from starling.sim.captures.info import CaptureInfo
from starling.sim.render import direct, emission
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.builtin import scenes as builtin
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.edits import with_values
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import InfraredPair, infrared

FREE = ("baseline", "focal", "projector", "dots")
DEPTH_NOISE_M = 2e-3
_TIMES_90 = 1.645  # Half width of the central 90 % of a normal distribution [std].
# Maximum errors of a converged fit: a tenth of the distance of dots at one metre.
_FOUND = {"baseline_m": 5e-4, "projector.position_m": 1e-3, "projector.rotation_deg": 0.1}


def nominal(name: str, width: int) -> Sensor:
    """Return a preset at another image size, 16:9."""
    sensor = presets.load(name)
    scale = width / sensor.width
    height = round(width * 9 / 16)
    values = {
        "width": width,
        "height": height,
        "fx_px": sensor.fx_px * scale,
        "fy_px": sensor.fy_px * scale,
        "cx_px": (width - 1) / 2,
        "cy_px": (height - 1) / 2,
        "imager.pixel_pitch_m": sensor.left.pixel_pitch_m / scale,
    }
    return with_values(sensor, values.items())


def perturb(sensor: Sensor, rng: np.random.Generator, *, field: bool) -> Sensor:
    """Return a randomly perturbed device of the sensor model."""
    part = sensor.projector
    values: list[tuple[str, float]] = [
        ("baseline_m", sensor.baseline_m + rng.uniform(-3e-3, 3e-3)),
        ("fx_px", sensor.fx_px * (1 + rng.uniform(-0.01, 0.01))),
        ("projector.power_w", part.power_w * 2 ** rng.uniform(-1, 1)),
        ("projector.dot_blur_mrad", rng.uniform(0, 1.5)),
    ]
    for place, axis in zip(part.position_m, "xyz", strict=True):
        values.append((f"projector.position_m.{axis}", place + rng.uniform(-5e-3, 5e-3)))
        values.append((f"projector.rotation_deg.{axis}", rng.uniform(-1, 1)))
    if field:
        wide = parameters.value(sensor, parameters.FIELD) * (1 + rng.uniform(-0.01, 0.01))
        values.append((parameters.FIELD, wide))
    return parameters.with_values(sensor, values)


def scenes(start: int) -> list[Scene]:
    """Return three builtin scenes that differ between starts."""
    return [builtin.tabletop(start), builtin.clutter(start), builtin.staircase(0.6)]


def capture_scene(scene: Scene, truth: Sensor, seed: int) -> tuple[InfraredPair, np.ndarray]:
    """Simulate a scene with the true sensor; return the infrared pair and the depth [m]."""
    layers = direct.layers(MitsubaScene(scene), truth, subpixels=3)
    return infrared(layers, scene, truth, seed=seed), layers.truth.depth_m


def metric_observation(
    scene: Scene, believed: Scene, truth: Sensor, claimed: Sensor, seed: int
) -> Observation:
    """Return an observation of a surface known in metres."""
    pair, depth_m = capture_scene(scene, truth, seed)
    assert pair.right is not None
    return Observation(
        name=scene.name,
        room=scene.name,
        info=_info(claimed),
        left=pair.left.astype(np.float32),
        right=pair.right.astype(np.float32),
        left_off=None,
        right_off=None,
        depth_m=None,
        truth_m=depth_m,
        scene=believed,
        metric=True,
        repeats=None,
    )


def wrong_reflectance(scene: Scene, rng: np.random.Generator) -> Scene:
    """Return the scene with the reflectance of each body wrong by a factor from 0.5 to 2."""
    bodies = []
    for body in scene.bodies:
        off = min(body.material.reflectance * 2 ** rng.uniform(-1, 1), 1.0)
        material = dataclasses.replace(body.material, reflectance=off)
        bodies.append(dataclasses.replace(body, material=material))
    return dataclasses.replace(scene, bodies=tuple(bodies))


def reference_observations(
    folder: Path, truth: Sensor, claimed: Sensor, start: int
) -> list[Observation]:
    """Return observations with noisy reference depth maps, written to and read from files."""
    rng = np.random.default_rng([11, start])
    info = _info(claimed)
    (folder / capture_info.FILE).write_text(capture_info.dumps(info))
    for number, scene in enumerate(scenes(start)):
        pair, depth_m = capture_scene(scene, truth, 1000 + 10 * start + number)
        assert pair.right is not None
        frame = folder / f"scene{number}" / "0"
        frame.mkdir(parents=True)
        noisy = depth_m + DEPTH_NOISE_M * rng.standard_normal(depth_m.shape)
        code = np.rint(np.nan_to_num(noisy, nan=0.0) / info.depth_unit_m).astype(np.uint16)
        cv2.imwrite(str(frame.parent / "truth.png"), code)
        cv2.imwrite(str(frame / "ir_left.png"), pair.left)
        cv2.imwrite(str(frame / "ir_right.png"), pair.right)
    return [observation.load(scene, claimed) for scene in capture.open_set(folder).scenes]


def _info(sensor: Sensor) -> CaptureInfo:
    return writer.info_of(
        sensor,
        source="benchmarks/calibration/calibrate_synthetic.py",
        licence="Apache-2.0",
        notes="",
    )


def with_images(sensor: Sensor, folder: Path) -> Sensor:
    """Return the sensor with its patterns as image files, whose dots do not depend on the field."""
    part = sensor.projector
    emitters = []
    for number, emitter in enumerate(emission.emitters(part)):
        drawn = emission.pattern(emitter.pattern, part.fov_x_deg, part.fov_y_deg, part.pattern_seed)
        path = folder / f"pattern-{number}.png"
        code = np.rint(drawn.image * (65535 / drawn.image.max())).astype(np.uint16)
        cv2.imwrite(str(path), code)
        emitters.append(dataclasses.replace(emitter, pattern=str(path)))
    light = dataclasses.replace(part, emitters=tuple(emitters))
    return dataclasses.replace(sensor, projector=light)


def run(sensor: Sensor, case: str, start: int) -> dict[str, object]:
    """Perturb, simulate and fit; return errors, standard deviations and times."""
    rng = np.random.default_rng([7, start])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        free = FREE
        if case == "reference":
            sensor, free = with_images(sensor, folder), (*FREE, "field")
        truth = perturb(sensor, rng, field=case == "reference")
        if case == "reference":
            (folder / "set").mkdir()
            observations = reference_observations(folder / "set", truth, sensor, start)
        else:
            observations = [
                metric_observation(
                    scene,
                    wrong_reflectance(scene, rng) if case == "reflectance" else scene,
                    truth,
                    sensor,
                    1000 + 10 * start + number,
                )
                for number, scene in enumerate(scenes(start))
            ]
        start_s, cpu = time.perf_counter(), time.process_time()
        try:
            solution = fit_geometry(observations, sensor, free=free)
        except errors.InputError as error:
            return {"start": start, "refused": str(error)}
        return {
            "start": start,
            "seconds": time.perf_counter() - start_s,
            "cpu_s": time.process_time() - cpu,
            "undetermined": list(solution.undetermined),
            "estimates": _compared(solution, truth),
        }


def _compared(solution: Solution, truth: Sensor) -> dict[str, tuple[float, float, float]]:
    """Return error, standard deviation and true value of each estimate."""
    comparison = {}
    for estimate in (*solution.estimates, *solution.derived):
        true = _true(truth, estimate.name)
        comparison[estimate.name] = (estimate.value - true, estimate.sd, true)
    return comparison


def _true(sensor: Sensor, name: str) -> float:
    return {
        "focal_baseline_px_m": lambda: sensor.focal_baseline_px_m,
        "projector.position_x_over_baseline": lambda: (
            sensor.projector.position_m[0] / sensor.baseline_m
        ),
        "focal_field_px": lambda: sensor.fx_px * parameters.value(sensor, parameters.FIELD),
    }.get(name, lambda: parameters.value(sensor, name))()


def summary(rows: list[dict]) -> dict[str, object]:
    """Return median errors, coverage of the intervals, and the share of converged fits."""
    fitted = [row["estimates"] for row in rows if "estimates" in row]
    names = list(fitted[0]) if fitted else []
    table = {}
    for name in names:
        error = np.array([fit[name][0] for fit in fitted])
        sd = np.array([fit[name][1] for fit in fitted])
        true = np.array([fit[name][2] for fit in fitted])
        table[name] = {
            "median_error": float(np.median(np.abs(error))),
            "median_error_pct": float(np.median(np.abs(error / true))) * 100 if all(true) else None,
            "median_sd": float(np.median(sd)),
            "covered_90": float(np.mean(np.abs(error) <= _TIMES_90 * sd)),
        }
    covered = [
        row["covered_90"]
        for name, row in table.items()
        if name in _INTERVALS and np.isfinite(row["median_sd"])
    ]
    return {
        "starts": len(rows),
        "converged": sum(_converged(fit) for fit in fitted) / len(rows),
        "covered_90": float(np.mean(covered)) if covered else None,
        "seconds": float(np.median([row["seconds"] for row in rows if "seconds" in row] or [0])),
        "cpu_s": float(np.median([row["cpu_s"] for row in rows if "cpu_s" in row] or [0])),
        "parameters": table,
    }


# Coverage excludes the width of dots, because fit and truth use different sub-pixel positions. It
# also excludes unidentifiable parameters, whose infinite intervals cover any value.
_INTERVALS = (
    "baseline_m",
    "fx_px",
    *(f"projector.position_m.{axis}" for axis in "xyz"),
    *(f"projector.rotation_deg.{axis}" for axis in "xyz"),
    "focal_baseline_px_m",
    "focal_field_px",
)


def _converged(fit: dict[str, tuple[float, float, float]]) -> bool:
    return all(
        abs(error) < limit
        for name, (error, sd, _) in fit.items()
        for prefix, limit in _FOUND.items()
        if name.startswith(prefix) and np.isfinite(sd) and "over" not in name
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sensor", default="d435", choices=("d435", "d415"))
    parser.add_argument("--case", default="metric", choices=("metric", "reflectance", "reference"))
    parser.add_argument("--starts", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--width", type=int, default=640)
    options = parser.parse_args()
    sensor = nominal(options.sensor, options.width)
    rows = []
    for start in range(options.first, options.first + options.starts):
        rows.append(run(sensor, options.case, start))
        print(json.dumps(rows[-1]), flush=True)
    print(json.dumps(summary(rows), indent=1))


if __name__ == "__main__":
    main()
