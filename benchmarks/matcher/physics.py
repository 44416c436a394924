"""Measure laws of a depth camera in simulation: geometry, bias, noise, holes from the renderer.

Usage: python benchmarks/matcher/physics.py [--sensor d435] [--picture docs/pictures/bias.png]
"""

from __future__ import annotations

import argparse
import dataclasses
import statistics
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from starling.sim import metrics
from starling.sim.geometry import frames
from starling.sim.render import direct
from starling.sim.render.layers import Layers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import materials
from starling.sim.scene.builtin import scenes, solids
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.matcher import named
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import expose, simulate
from starling.sim.stereo.depth import DepthMap, disparity_from_depth

GEOMETRY_M = (0.5, 1.0, 2.0, 4.0)
NOISE_M = (0.5, 0.7, 1.0, 1.4, 2.0)
# Each distance is averaged over five nearby ones. Matcher bias depends on the fraction of the
# disparity, and a fronto-parallel wall has a single fraction.
AROUND = (0.96, 0.98, 1.0, 1.02, 1.04)
FRACTIONS = np.arange(16) / 16
SAMPLES = (1, 4, 16, 64)
HOLE_SEEDS = (0, 1, 2)


def wall(sensor: Sensor, distance_m: float) -> Layers:
    """Render a wall at a distance."""
    return direct.layers(MitsubaScene(scenes.wall(distance_m)), sensor)


def depth_of(seen: Layers, sensor: Sensor) -> DepthMap:
    """Return the sensor's depth of rendered layers."""
    return expose(seen, scenes.wall(), sensor).depth


def geometry(sensor: Sensor) -> dict[float, float]:
    """Return the disparity of noise-free images minus f b / z [px], by distance [m]."""
    errors = {}
    for distance in GEOMETRY_M:
        expected = sensor.focal_baseline_px_m / distance
        seen = wall(sensor, distance)
        shift = metrics.shift_px(
            seen.left.projector_direct,
            seen.right.projector_direct,
            near_px=expected,
            margin_px=int(expected) + 40,
        )
        errors[distance] = shift - expected
    return errors


def bias_curve(sensor: Sensor) -> dict[float, float]:
    """Return the mean disparity error [px] by fraction of the disparity, for walls near 1 m."""
    curve = {}
    for fraction in FRACTIONS:
        disparity = np.floor(sensor.focal_baseline_px_m) + fraction
        seen = wall(sensor, sensor.focal_baseline_px_m / disparity)
        truth = disparity_from_depth(
            seen.truth.depth_m, focal_px=sensor.fx_px, baseline_m=sensor.baseline_m
        )
        error = depth_of(seen, sensor).disparity_px - truth
        curve[float(fraction)] = float(np.nanmean(error[60:-60, 100:-100]))
    return curve


def plane_rms_m(depth_m: np.ndarray) -> float:
    """Return the RMS distance in z from a plane fitted to the central 40 % of rows and columns."""
    height, width = depth_m.shape
    rows, columns = np.mgrid[
        int(0.3 * height) : int(0.7 * height), int(0.3 * width) : int(0.7 * width)
    ]
    z = depth_m[rows, columns].ravel().astype(np.float64)
    known = np.isfinite(z)
    basis = np.stack([rows.ravel(), columns.ravel(), np.ones(z.size)], axis=1)[known]
    plane, *_ = np.linalg.lstsq(basis, z[known], rcond=None)
    return float(np.sqrt(np.mean((basis @ plane - z[known]) ** 2)))


def noise(sensor: Sensor, walls: dict[float, list[Layers]]) -> dict[float, float]:
    """Return the plane-fit RMS [m] by distance [m]."""
    return {
        distance: float(
            np.sqrt(
                np.mean(
                    [plane_rms_m(depth_of(layers, sensor).depth_m) ** 2 for layers in wall_layers]
                )
            )
        )
        for distance, wall_layers in walls.items()
    }


def exponent(values: dict[float, float]) -> float:
    """Return the slope of log(value) over log(distance)."""
    return float(np.polyfit(np.log(list(values)), np.log(list(values.values())), 1)[0])


def fixed_exposure(sensor: Sensor) -> Sensor:
    """Return the same sensor with auto exposure off."""
    left, right = (
        dataclasses.replace(part, auto_exposure_level=0.0) for part in (sensor.left, sensor.right)
    )
    return dataclasses.replace(sensor, left=left, right=right)


def corner() -> Scene:
    """Return two white walls at a right angle, 1.5 m away, with strong indirect light."""
    turned = ((45.0, 1.0), (-45.0, -1.0))
    walls = (
        solids.body(
            f"wall {angle:g}",
            solids.plane(3.0, 4.0),
            materials.PAPER,
            frames.pose((0, 0, 1.5))
            @ frames.pose((0, 0, 0), (0, angle, 0))
            @ frames.pose((1.5 * side, 0, 0)),
        )
        for angle, side in turned
    )
    return Scene(name="corner", bodies=tuple(walls))


def hole_rates(sensor: Sensor, scene: Scene) -> dict[int, float]:
    """Return the rate of no-depth pixels [%] by samples of indirect light; mean over seeds."""
    stage = MitsubaScene(dataclasses.replace(scene, interreflection=1.0))

    def rate(samples: int, seed: int) -> float:
        shot = simulate(stage, sensor, samples=samples, seed=seed)
        return 100 * float(1 - shot.depth.valid.mean())

    return {n: statistics.fmean(rate(n, seed) for seed in HOLE_SEEDS) for n in SAMPLES}


def draw(curves: dict[str, dict[float, float]], path: Path) -> None:
    """Plot bias against the fraction of the disparity."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 3.2), layout="constrained")
    for name, curve in curves.items():
        axes.plot([*curve, 1.0], [*curve.values(), curve[0.0]], marker=".", label=name)
    axes.axhline(0, color="0.7", linewidth=0.8)
    axes.set(xlabel="fraction of the true disparity [px]", ylabel="mean disparity error [px]")
    axes.legend(frameon=False)
    figure.savefig(path, dpi=120)


def listed(values: Iterable[tuple[float, float]], form: str) -> str:
    """Format `key: value` pairs on one line."""
    return ", ".join(f"{key:g}: {value:{form}}" for key, value in values)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sensor", default="d435")
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    sensor = presets.load(arguments.sensor)

    print(
        "geometry, error of f b / z [px] by distance [m]:", listed(geometry(sensor).items(), "+.4f")
    )
    curves = {
        name: bias_curve(dataclasses.replace(sensor, matcher=named(name)))
        for name in ("d4xx", "fast")
    }
    for name, curve in curves.items():
        print(f"bias of {name} [px] by fraction:", listed(curve.items(), "+.3f"))
        print(
            f"bias of {name}: mean {np.mean(list(curve.values())):+.4f} px, "
            f"from {min(curve.values()):+.3f} to {max(curve.values()):+.3f}"
        )
    if arguments.picture:
        draw(curves, arguments.picture)

    walls = {z: [wall(sensor, z * near) for near in AROUND] for z in NOISE_M}
    for name, chosen in (("auto exposure", sensor), ("fixed exposure", fixed_exposure(sensor))):
        rms = noise(chosen, walls)
        millimetres = listed(((z, 1e3 * value) for z, value in rms.items()), ".2f")
        print(f"plane-fit RMS [mm] by distance [m], {name}: {millimetres}")
        print(f"exponent over distance, {name}: {exponent(rms):.2f}")
    for scene in (scenes.clutter(), corner()):
        rates = hole_rates(sensor, scene)
        print(f"holes [%] of {scene.name} by samples:", listed(rates.items(), ".3f"))


if __name__ == "__main__":
    main()
