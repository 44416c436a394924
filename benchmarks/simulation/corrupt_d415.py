r"""Compare corrupted scanner depth with a real D415's depth of the same scenes.

`simulate` renders the scanner's surface, closed at its holes and smoothed; `corrupt` gets the depth
of that surface, then the scanner's own depth. Both get reflectance and ambient light from the
left infrared image. Captures: `d415-faro` in the folder $STARLING_CAPTURES.

Usage:
    python benchmarks/simulation/corrupt_d415.py [--scenes 0060 5881] [--pictures FOLDER]

Pictures show real captures, so their folder must be outside the project.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from starling import CapturedScene, Corruptor, Sensor
from starling.sim.captures import capture
from starling.sim.metrics import disparity_figures, reached_pixels, scored_pixels
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.captured import captured_scene
from starling.sim.sensor import resolve
from starling.sim.simulate import expose, render_layers

SEED = 1
IOU_MARGIN, NMAD_MARGIN_PX = 0.02, 0.01  # Targets: `corrupt` against `simulate`.
MODELS = ("simulate", "corrupt, surface", "corrupt, scanner")
COLUMNS = ("IoU", "NMAD against the device", "NMAD against the scanner", "holes")
Image = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Room:
    """One captured scene: disparities (h, w) [px], NaN where unknown."""

    scene: CapturedScene
    sensor: Sensor
    truth_px: Image
    device_px: Image


def main() -> None:
    """Print a row for each scene and model, and medians."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", nargs="*", default=[], help="all scenes if none")
    parser.add_argument("--pictures", type=Path, help="folder for pictures of each scene")
    options = parser.parse_args()
    print(f"| scene | depth | {' | '.join(COLUMNS)} |\n|{'---|' * (2 + len(COLUMNS))}")
    tables = []
    for room in rooms(options.scenes):
        disparities = readings(room)
        device = figures(room, room.device_px)
        rows = {"device": device} | {
            name: figures(room, image) for name, image in disparities.items()
        }
        tables.append(np.array(list(rows.values())))
        print_rows(room.scene.name, rows)
        if options.pictures:
            options.pictures.mkdir(parents=True, exist_ok=True)
            path = options.pictures / f"{room.scene.name}.png"
            cv2.imwrite(str(path), picture(room, disparities))
    names = ("device", *MODELS)
    medians = np.median(tables, axis=0)
    print_rows("median", dict(zip(names, medians.tolist(), strict=True)))
    reference, *others = (dict(zip(COLUMNS, row, strict=True)) for row in medians[1:].tolist())
    for name, row in zip(MODELS[1:], others, strict=True):
        lost = reference["IoU"] - row["IoU"]
        wider = abs(row[COLUMNS[1]] - reference[COLUMNS[1]])
        print(
            f"{name}: IoU below simulate's by {lost:.3f} (target <= {IOU_MARGIN}: "
            f"{verdict(lost <= IOU_MARGIN)}), NMAD off by {wider:.4f} px "
            f"(target <= {NMAD_MARGIN_PX}: {verdict(wider <= NMAD_MARGIN_PX)})"
        )


def rooms(names: list[str]) -> list[Room]:
    """Open the captured scenes of these names, or all."""
    path = Path(os.environ.get("STARLING_CAPTURES", "")) / "d415-faro"
    if not path.is_dir():
        raise SystemExit(f"no captures at {path}; set STARLING_CAPTURES to their folder")
    sensor = resolve.load("d415", captures=str(path))
    opened = []
    for scene in capture.open_set(path).scenes:
        if names and scene.name not in names:
            continue
        truth_m, device_m = scene.truth_m(), scene.frame(0).depth_m
        assert truth_m is not None and device_m is not None
        truth_px, device_px = (scene.info.disparity_px(image) for image in (truth_m, device_m))
        opened.append(Room(scene=scene, sensor=sensor, truth_px=truth_px, device_px=device_px))
    return opened


class Models:
    """`simulate` and `corrupt` of one captured scene, rendered once."""

    def __init__(self, room: Room) -> None:
        """Estimate the light, and render the scanner's surface."""
        scene, sensor = room.scene, room.sensor
        self.room = room
        light = captured_scene.estimate_light(scene, sensor)
        self.scene = captured_scene.scene_from_light(scene, light)
        self.layers = render_layers(MitsubaScene(self.scene), sensor)
        # `corrupt` has one level of ambient light.
        even = captured_scene.estimate_light(scene, sensor, even_ambient=True)
        self.reflectance = even.reflectance
        self.corruptor = Corruptor(sensor, matrix(sensor), effects={"ambient": even.ambient_w_m2})

    def simulated(self, sensor: Sensor, frame: int = 0) -> Image:
        """Return the disparity (h, w) that a sensor of the room's geometry reads [px]."""
        shot = expose(self.layers, self.scene, sensor, seed=SEED, frame=frame)
        return self.room.scene.info.disparity_px(shot.depth.depth_m)

    def corrupted(self, depth_m: Image, frame: int = 0) -> Image:
        """Return the disparity (h, w) of a corrupted depth image [px]."""
        reading = self.corruptor(depth_m, reflectance=self.reflectance, seed=SEED, frame=frame)
        return self.room.scene.info.disparity_px(reading.depth_m)


def readings(room: Room) -> dict[str, Image]:
    """Return the disparity (h, w) of each model [px]."""
    models, truth_m = Models(room), room.scene.truth_m()
    assert truth_m is not None
    surface_m = models.layers.truth.depth_m
    images = (
        models.simulated(room.sensor),
        models.corrupted(surface_m),
        models.corrupted(truth_m),
    )
    return dict(zip(MODELS, images, strict=True))


def matrix(sensor: Sensor) -> NDArray[np.float64]:
    """Return the sensor's intrinsics (3, 3) [px]."""
    fx, fy, cx, cy = sensor.fx_px, sensor.fy_px, sensor.cx_px, sensor.cy_px
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def figures(room: Room, disparity_px: Image) -> list[float]:
    """Return hole overlap with the device, spread of disparity, and share of holes."""
    scored, reached = scored_pixels(room.truth_px), reached_pixels(room.truth_px)
    agreement = disparity_figures(
        disparity_px, room.device_px, scored, holes_of_px=room.device_px, holes_where=reached
    )
    error = disparity_figures(disparity_px, room.truth_px, scored)
    overlap = agreement.ndp_iou
    assert overlap is not None
    holes = 1 - float(np.isfinite(disparity_px[reached]).mean())
    return [overlap, agreement.nmad_px, error.nmad_px, holes]


def print_rows(name: str, rows: dict[str, list[float]]) -> None:
    """Print the figures of a scene."""
    for model, values in rows.items():
        print(
            f"| {name} | {model} | {' | '.join(f'{value:.3f}' for value in values)} |", flush=True
        )


def verdict(reached: bool) -> str:
    """Return the word for a target."""
    return "reached" if reached else "missed"


def picture(room: Room, disparities: dict[str, Image]) -> NDArray[np.uint8]:
    """Draw disparities of device, simulation and corruption; black is no depth."""
    shown = [room.device_px, *(disparities[name] for name in MODELS[:2]), room.truth_px]
    low, high = np.nanquantile(room.truth_px, (0.01, 0.99))
    tiles = []
    for image in shown:
        level = np.nan_to_num(np.clip((image - low) / (high - low), 0, 1) * 255).astype(np.uint8)
        colours = cv2.applyColorMap(level, cv2.COLORMAP_TURBO)
        colours[~np.isfinite(image)] = 0
        tiles.append(colours)
    rows = [np.hstack(tiles[:2]), np.hstack(tiles[2:])]
    return np.asarray(np.vstack(rows), np.uint8)


if __name__ == "__main__":
    main()
