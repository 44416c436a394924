"""Measure how ambient light varies over a real room, and how well the simulation models it.

In squares of 32 px with one surface, projector light and modelled ambient light are fitted to the
left image. Their ratio gives the true over the modelled ambient light, independent of reflectance.
The model has uniform ambient light, or light that varies over the image
(`starling.sim.scene.captured.ambient_share`). A simulated image with uniform light is the control.
The right image, which neither model uses, gives the strength of real over simulated dots by square.

Usage:
    STARLING_CAPTURES=... python benchmarks/diagnosis/ambient_d415.py --sensor FILE \
        --rooms 4426 6422 ...
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rooms import first_of_each

from starling.calibration.correlation import without_mean
from starling.calibration.least_squares.variable_projection import cut
from starling.diagnosis.scenes import fit_scene
from starling.learning.data.captured import SMOOTHING_PX
from starling.sim import simulate
from starling.sim.captures.capture import CapturedScene
from starling.sim.imaging.noiseless import noiseless
from starling.sim.metrics import depth_edges
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.captured import captured_scene
from starling.sim.scene.scene import Scene
from starling.sim.sensor import resolve
from starling.sim.sensor.sensor import Sensor

SIDE_PX = 32
LEAST_DN = 1.0  # Least mean light of the dots in a square; darker squares are too noisy [DN].
AGREE = 0.3  # Least correlation with simulated dots for an estimate of their strength.


def main() -> None:
    """Print one line per room."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sensor", required=True)
    parser.add_argument("--rooms", nargs="+", required=True)
    options = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    base = resolve.load(options.sensor, captures=str(path))
    first = first_of_each(path, options.rooms)
    print(
        "10th and 90th percentile of true over modelled ambient light: uniform, varying, control;"
    )
    print("right image: spread of dot strength [%] and RMS residual [DN]: uniform, varying")
    for room, scene in first.items():
        sensor = fit_scene.apply_to_sensor(base, fit_scene.fit_pattern_scale(scene, base))
        rooms = [load_room(scene, sensor, even_ambient=even) for even in (True, False)]
        measured = [measure_room(scene, room_model, sensor) for room_model in rooms]
        ends = [measured[0][0], measured[1][0], measured[0][1]]
        text = "   ".join(f"{low:.2f} {high:.2f}" for low, high in ends)
        right = "   ".join(f"{100 * values[2]:.0f} {values[3]:.2f}" for values in measured)
        print(f"{room:6} {text}   {right}", flush=True)


def load_room(scene: CapturedScene, sensor: Sensor, *, even_ambient: bool) -> Scene:
    """Load the scene that is estimated from a captured room."""
    return captured_scene.load(
        scene.path,
        sensor,
        smoothing_px=SMOOTHING_PX,
        within_surfaces=True,
        even_ambient=even_ambient,
    )


def measure_room(
    scene: CapturedScene, room: Scene, sensor: Sensor
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
    """Measure the left image (real and simulated) and the right image of a room.

    Returns:
        Four values. The first two are for the real and for the simulated image: 10th and 90th
        percentile over the median of true over modelled ambient light. The others are spread of
        dot strength and RMS residual [DN] of the right image.
    """
    layers = simulate.render_layers(MitsubaScene(room), sensor, samples=4)
    light = captured_scene.mean_signals(layers.left, room, sensor)
    level = room.ambient.irradiance_w_m2
    lit = light.laser.astype(np.float32), (level * light.ambient).astype(np.float32)
    expected = noiseless(layers, room, sensor)
    simulated_dn = simulate.infrared(layers, room, sensor).left - np.float32(
        sensor.left.black_level_dn
    )
    frame = scene.fullest()
    assert frame.ir_left is not None and frame.ir_right is not None
    images = [frame.ir_left - np.float32(sensor.left.black_level_dn), simulated_dn]
    one_surface = _one_surface(layers.truth.depth_m, scene)
    ratios = [_ratio(image, lit) for image in images]
    known = one_surface & np.all([np.isfinite(ratio) for ratio in ratios], axis=0)
    real, simulated = (
        np.quantile(ratio[known] / np.median(ratio[known]), (0.1, 0.9)) for ratio in ratios
    )
    assert layers.right is not None
    right_dn = frame.ir_right - np.float32(sensor.right.black_level_dn)
    spread, rms = _right(right_dn, expected["right"], _one_surface(layers.right.depth_m, scene))
    return real, simulated, spread, rms


def _one_surface(depth_m: NDArray, scene: CapturedScene) -> NDArray[np.bool_]:
    """Mask of the squares with one surface."""
    return ~np.any(cut(depth_edges(scene.info.disparity_px(depth_m)), SIDE_PX), axis=1)


def _right(
    real: NDArray, simulated: NDArray, one_surface: NDArray[np.bool_]
) -> tuple[float, float]:
    """Half the central 68 % interval of the log strength of dots, and the RMS residual [DN]."""
    real_dots, simulated_dots = (
        cut(without_mean(np.asarray(image, np.float32)), SIDE_PX)[one_surface]
        for image in (real, simulated)
    )
    common = (real_dots * simulated_dots).mean(axis=1)
    square = (simulated_dots**2).mean(axis=1)
    agree = common / np.sqrt(square * (real_dots**2).mean(axis=1) + 1e-12)
    strength = np.log((common / square)[agree > AGREE])
    low, high = np.quantile(strength, (0.16, 0.84))
    difference = np.asarray(real, np.float32) - np.asarray(simulated, np.float32)
    residual = cut(difference, SIDE_PX)[one_surface]
    return float(high - low) / 2, float(np.sqrt(np.mean(residual**2)))


def _ratio(image: NDArray, lit: tuple[NDArray, NDArray]) -> NDArray[np.float64]:
    """Estimate true over modelled ambient light by square, NaN where there is too little light.

    The reflectance may vary linearly over a square.
    """
    laser, ambient = (cut(layer, SIDE_PX).astype(np.float64) for layer in lit)
    measured = cut(image, SIDE_PX).astype(np.float64)
    y, x = np.mgrid[-1 : 1 : SIDE_PX * 1j, -1 : 1 : SIDE_PX * 1j]
    columns = np.stack([laser, ambient, ambient * x.ravel(), ambient * y.ravel()], axis=-1)
    length = np.sqrt((columns**2).sum(axis=1, keepdims=True)) + 1e-30
    columns = columns / length
    matrix = np.einsum("nmi,nmj->nij", columns, columns) + 1e-9 * np.eye(4)
    right = np.einsum("nmi,nm->ni", columns, measured)
    fit = np.linalg.solve(matrix, right[..., None])[..., 0] / length[:, 0]
    laser_dn, ambient_dn = fit[:, 0] * laser.mean(axis=1), fit[:, 1] * ambient.mean(axis=1)
    known = (laser_dn > LEAST_DN) & (ambient_dn > 0)
    return np.where(known, fit[:, 1] / np.where(known, fit[:, 0], 1), np.nan)


if __name__ == "__main__":
    main()
