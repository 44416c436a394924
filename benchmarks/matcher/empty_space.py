"""Measure depth where no surface is, around objects alone in space.

    python benchmarks/matcher/empty_space.py
    python benchmarks/matcher/empty_space.py d435 --picture docs/pictures/empty-space.png

Arguments are sensor presets. `off` is the matcher without `checks.dark_noise`.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh import creation, transformations

from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import sources
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot, expose, render_layers

PICTURE_PX = 420  # Width of one panel of the picture.


@dataclass(frozen=True, kw_only=True, slots=True)
class EmptySpace:
    """Figures of one shot."""

    surface: float  # Share of the frame that shows the object.
    false: float  # Share of the frame with depth, but without surface.
    farthest_px: float  # Largest distance of such a pixel from the object, along rows or columns.
    fill: float  # Share of the object with depth.


def box() -> trimesh.Trimesh:
    """Cube of 0.3 m."""
    return creation.box((0.3, 0.3, 0.3))


def duck() -> trimesh.Trimesh:
    """Curved body, head and beak, with bumps."""
    body = creation.icosphere(4, 0.12).apply_scale((1.3, 0.9, 1.0))
    head = creation.icosphere(4, 0.07).apply_translation((-0.12, 0.14, 0.0))
    beak = creation.cone(0.03, 0.08, sections=24)
    beak.apply_transform(transformations.rotation_matrix(-math.pi / 2, (0, 1, 0)))
    beak.apply_translation((-0.18, 0.14, 0.0))
    whole = trimesh.util.concatenate([body, head, beak])
    x, y = whole.vertices[:, :1], whole.vertices[:, 1:2]
    whole.vertices = whole.vertices * (1 + 0.02 * np.sin(40 * x) * np.sin(40 * y))
    return whole


def arm() -> trimesh.Trimesh:
    """Chain of four links with a base and a gripper of two fingers."""
    place, lean = np.array([0.0, -0.35, 0.0]), 0.0
    parts = [creation.box((0.2, 0.04, 0.2)).apply_translation(place)]
    for number, (length_m, bend) in enumerate([(0.3, 0.4), (0.28, 0.7), (0.22, 0.6), (0.12, 0.5)]):
        lean += bend
        way = np.array([math.sin(lean), math.cos(lean), 0.25 * (-1) ** number])
        tip = place + length_m * way / np.linalg.norm(way)
        link = creation.cylinder(0.035 - 0.005 * number, segment=[place, tip], sections=24)
        joint = creation.box((0.09 - 0.01 * number,) * 3).apply_translation(tip)
        parts += [link, joint]
        place = tip
    for side in (-0.03, 0.03):
        finger = creation.box((0.015, 0.1, 0.03)).apply_translation(
            place + np.array([side, -0.05, 0.0])
        )
        parts.append(finger)
    return trimesh.util.concatenate(parts)


OBJECTS = {"box": box, "duck": duck, "arm": arm}


def without_check(sensor: Sensor) -> Sensor:
    """Return the sensor with a matcher that does not test for darkness."""
    checks = dataclasses.replace(sensor.matcher.checks, dark_noise=0.0)
    return dataclasses.replace(sensor, matcher=dataclasses.replace(sensor.matcher, checks=checks))


def shots(solid: trimesh.Trimesh, *sensors: Sensor) -> list[Shot]:
    """Simulate an object alone in space, rendered once, as sensors of one geometry see it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "object.ply"
        solid.export(path)
        scene = MitsubaScene(sources.load_mesh(path, sensors[0]))
    layers = render_layers(scene, sensors[0])
    return [expose(layers, scene.scene, sensor) for sensor in sensors]


def measure(shot: Shot) -> EmptySpace:
    """Measure depth without surface."""
    surface = np.isfinite(shot.layers.truth.depth_m)
    distance = cv2.distanceTransform((~surface).astype(np.uint8), cv2.DIST_C, cv2.DIST_MASK_5)
    false = shot.depth.valid & ~surface
    return EmptySpace(
        surface=float(surface.mean()),
        false=float(false.mean()),
        farthest_px=float(distance[false].max(initial=0)),
        fill=float(shot.depth.valid[surface].mean()),
    )


def panels(before: Shot, after: Shot) -> NDArray[np.uint8]:
    """Draw the infrared image and both depth images side by side (h, w, 3)."""
    truth = after.layers.truth.depth_m
    low, high = np.nanmin(truth) * 0.9, np.nanmax(truth) * 1.1
    row = [cv2.cvtColor(cv2.convertScaleAbs(after.ir_left, alpha=2), cv2.COLOR_GRAY2BGR)]
    for shot in (before, after):
        share = np.nan_to_num(np.clip((shot.depth.depth_m - low) / (high - low), 0, 1))
        colours = cv2.applyColorMap((share * 255).astype(np.uint8), cv2.COLORMAP_TURBO)
        row.append(np.where(shot.depth.valid[..., None], colours, 0).astype(np.uint8))
    height = round(PICTURE_PX * truth.shape[0] / truth.shape[1])
    return np.hstack([cv2.resize(view, (PICTURE_PX, height)) for view in row])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("presets", nargs="*", default=list(presets.names()))
    parser.add_argument("--picture", type=Path, help="PNG: infrared, depth without check, depth")
    arguments = parser.parse_args()
    print("preset     object  surface   off: false  farthest   fill   on: false  farthest   fill")
    rows = []
    for name in arguments.presets:
        sensor = presets.load(name)
        for label, solid in OBJECTS.items():
            before, after = shots(solid(), without_check(sensor), sensor)
            rows.append(panels(before, after))
            off, on = measure(before), measure(after)
            halves = (
                f"{figures.false:12.4f} {figures.farthest_px:6.0f} px {figures.fill:6.3f}"
                for figures in (off, on)
            )
            print(f"{name:10} {label:6} {off.surface:8.3f}", *halves, flush=True)
    if arguments.picture:
        cv2.imwrite(str(arguments.picture), np.vstack(rows))


if __name__ == "__main__":
    main()
