"""How ambient light varies over a real room, and what it is worth to know.

In squares of 32 px with one surface the left image is fitted by what a calibrated sensor's
projector and the ambient light that is believed make of that surface: the ratio of both tells the
ambient light there over what is believed, whatever the reflectance. It is asked with light that is
believed even and with light by the dots' places (`starling.sim.scene.captured.ambient_share`), and as a control of
an image that is simulated with even light. Then the right image, which has no say in either: how
strong its dots are over simulated ones, square by square.

Usage:
    STARLING_CAPTURES=... python benchmarks/diagnosis/ambient_d415.py --sensor FILE --rooms 4426 6422 ...
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from unittest import mock

import numpy as np
from numpy.typing import NDArray
from rooms import first_of_each

from starling.calibration import detail
from starling.calibration.least_squares.variable_projection import cut
from starling.diagnosis.scenes import fit_scene
from starling.learning.data.captured import SMOOTHING_PX
from starling.sim import simulate
from starling.sim.captures.capture import CapturedScene
from starling.sim.imaging.noiseless import noiseless
from starling.sim.metrics import depth_edges
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene.captured import ambient_share, captured_scene
from starling.sim.scene.scene import Scene
from starling.sim.sensor import resolve
from starling.sim.sensor.sensor import Sensor

SIDE_PX = 32
LEAST_DN = 1.0  # Of dots and of ambient light in a square: darker ones tell too little.
AGREE = 0.3  # Correlation with simulated dots from which a square's strength is known.


def main() -> None:
    """Print a line a room."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sensor", required=True)
    parser.add_argument("--rooms", nargs="+", required=True)
    asked = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    base = resolve.load(asked.sensor, captures=str(path))
    first = first_of_each(path, asked.rooms)
    print("10 and 90 % of ambient light over what is believed: even, by place, simulated; then of")
    print("the right image's dots the spread of strength [%] and what is off [DN]: even, by place")
    for room, scene in first.items():
        sensor = fit_scene.on_sensor(base, fit_scene.of_dots(scene, base))
        with mock.patch.object(ambient_share, "told", return_value=None):
            even = believed(scene, sensor)
        by_place = believed(scene, sensor)
        found = [of_room(scene, one, sensor) for one in (even, by_place)]
        ends = [found[0][0], found[1][0], found[0][1]]
        text = "   ".join(f"{low:.2f} {high:.2f}" for low, high in ends)
        right = "   ".join(f"{100 * one[2]:.0f} {one[3]:.2f}" for one in found)
        print(f"{room:6} {text}   {right}", flush=True)


def believed(scene: CapturedScene, sensor: Sensor) -> Scene:
    """A captured room as it is estimated."""
    return captured_scene.load(scene.path, sensor, smoothing_px=SMOOTHING_PX, within_surfaces=True)


def of_room(
    scene: CapturedScene, room: Scene, sensor: Sensor
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float]:
    """Ambient light of squares over what is believed, by real and by simulated image: 10th and 90th
    percentile over the median. Then the right image.
    """
    layers = simulate.rendered(Stage(room), sensor, samples=4)
    light = captured_scene.in_the_mean(layers.left, room, sensor)
    level = room.ambient.irradiance_w_m2
    lit = light.laser.astype(np.float32), (level * light.ambient).astype(np.float32)
    made = noiseless(layers, room, sensor)
    drawn = simulate.infrared(layers, room, sensor).left - np.float32(sensor.left.black_level_dn)
    frame = scene.fullest()
    assert frame.ir_left is not None and frame.ir_right is not None
    images = [frame.ir_left - np.float32(sensor.left.black_level_dn), drawn]
    even = _even(layers.truth.depth_m, scene)
    both = [_ratio(image, lit) for image in images]
    told = even & np.all([np.isfinite(one) for one in both], axis=0)
    real, simulated = (np.quantile(one[told] / np.median(one[told]), (0.1, 0.9)) for one in both)
    assert layers.right is not None
    seen = frame.ir_right - np.float32(sensor.right.black_level_dn)
    spread, off = _right(seen, made["right"], _even(layers.right.depth_m, scene))
    return real, simulated, spread, off


def _even(depth_m: NDArray, scene: CapturedScene) -> NDArray[np.bool_]:
    """Squares with one surface."""
    return ~np.any(cut(depth_edges(scene.info.disparity_px(depth_m)), SIDE_PX), axis=1)


def _right(real: NDArray, made: NDArray, even: NDArray[np.bool_]) -> tuple[float, float]:
    """Half of the middle 68 % of the logarithm of dots' strength, and root mean square [DN]."""
    seen, own = (
        cut(detail.high_passed(np.asarray(one, np.float32)), SIDE_PX)[even] for one in (real, made)
    )
    common, square = (seen * own).mean(axis=1), (own**2).mean(axis=1)
    agree = common / np.sqrt(square * (seen**2).mean(axis=1) + 1e-12)
    strength = np.log((common / square)[agree > AGREE])
    low, high = np.quantile(strength, (0.16, 0.84))
    off = cut(np.asarray(real, np.float32) - np.asarray(made, np.float32), SIDE_PX)[even]
    return float(high - low) / 2, float(np.sqrt(np.mean(off**2)))


def _ratio(image: NDArray, lit: tuple[NDArray, NDArray]) -> NDArray[np.float64]:
    """Ambient light over what is believed, by square; NaN where too little is lit.

    Reflectance may run over a square as a plane does.
    """
    laser, ambient = (cut(one, SIDE_PX).astype(np.float64) for one in lit)
    seen = cut(image, SIDE_PX).astype(np.float64)
    y, x = np.mgrid[-1 : 1 : SIDE_PX * 1j, -1 : 1 : SIDE_PX * 1j]
    columns = np.stack([laser, ambient, ambient * x.ravel(), ambient * y.ravel()], axis=-1)
    length = np.sqrt((columns**2).sum(axis=1, keepdims=True)) + 1e-30
    columns = columns / length
    matrix = np.einsum("nmi,nmj->nij", columns, columns) + 1e-9 * np.eye(4)
    right = np.einsum("nmi,nm->ni", columns, seen)
    found = np.linalg.solve(matrix, right[..., None])[..., 0] / length[:, 0]
    of_laser, of_ambient = found[:, 0] * laser.mean(axis=1), found[:, 1] * ambient.mean(axis=1)
    known = (of_laser > LEAST_DN) & (of_ambient > 0)
    return np.where(known, found[:, 1] / np.where(known, found[:, 0], 1), np.nan)


if __name__ == "__main__":
    main()
