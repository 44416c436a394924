"""How ambient light varies over a real room, told by the projector's dots, place by place.

In squares of 32 px with one surface the image is fitted by what a calibrated sensor's projector and
even ambient light make of that surface: the ratio of both tells the ambient light there, whatever
the reflectance. The same is asked of an image that is simulated with even light, as a control.

Usage:
    STARLING_CAPTURES=... python benchmarks/ambient_d415.py --sensor FILE --rooms 4426 6422 ...
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.variable_projection import cut
from learning.captured import SMOOTHING_PX
from sim import asked_sensor, capture, simulate
from sim.capture import CapturedScene
from sim.light.signals import signals
from sim.metrics import depth_edges
from sim.scenes import captured
from sim.sensor import Sensor
from sim.stage import Stage

SIDE_PX = 32
LEAST_DN = 1.0  # Of dots and of ambient light in a square: darker ones tell too little.


def main() -> None:
    """Print a line a room."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sensor", required=True)
    parser.add_argument("--rooms", nargs="+", required=True)
    asked = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    sensor = asked_sensor.load(asked.sensor, captures=str(path))
    first: dict[str, CapturedScene] = {}
    for scene in capture.open_set(path).scenes:
        if scene.room in asked.rooms:
            first.setdefault(scene.room, scene)
    print("room   squares   ambient light over its median, 10 and 90 %: real, simulated")
    for room, scene in first.items():
        found = of_room(scene, sensor)
        count, ends = len(found[0]), [np.quantile(one, (0.1, 0.9)) for one in found]
        told = "   ".join(f"{low:.2f} {high:.2f}" for low, high in ends)
        print(f"{room:6} {count:6}   {told}", flush=True)


def of_room(scene: CapturedScene, sensor: Sensor) -> list[NDArray[np.float64]]:
    """Ambient light of a room's squares over its median: by the real image, and by a simulated."""
    believed = captured.load(scene.path, sensor, smoothing_px=SMOOTHING_PX, within_surfaces=True)
    layers = simulate.rendered(Stage(believed), sensor, samples=4)
    light = signals(layers.left, believed, sensor, "left")
    level = believed.ambient.irradiance_w_m2
    lit = light.laser.astype(np.float32), (level * light.ambient).astype(np.float32)
    pair = simulate.infrared(layers, believed, sensor)
    real = scene.fullest().ir_left
    assert real is not None
    images = [np.asarray(one, np.float32) for one in (real, pair.left)]
    edges = depth_edges(scene.info.disparity_px(layers.truth.depth_m))
    even = ~np.any(cut(edges, SIDE_PX), axis=1)
    both = [_ratio(image - np.float32(sensor.left.black_level_dn), lit) for image in images]
    told = even & np.all([np.isfinite(one) for one in both], axis=0)
    return [one[told] / np.median(one[told]) for one in both]


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
