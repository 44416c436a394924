"""Measure how much of a sensor's error the reflectance of a captured scene absorbs.

    python benchmarks/calibration/absorbed_detail.py --rooms 0060

A captured room of `d415-faro` is simulated with a changed sensor. Its images replace the captured
ones. Reflectance is then estimated from them with the unchanged sensor. Printed is the share of the
change that remains between images and model: 1 if the reflectance absorbs nothing. The change is a
high-passed image, and the share is a regression on it. Captures: folder $STARLING_CAPTURES.
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import cv2
from numpy.typing import NDArray

from starling import Scene, Sensor
from starling.calibration import correlation, heldout
from starling.calibration.fit_sensor import without_waves
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene
from starling.sim.imaging.noiseless import noiseless
from starling.sim.render import direct
from starling.sim.render.layers import Layers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.captured import captured_scene
from starling.sim.sensor import resolve
from starling.sim.sensor.edits import with_values
from starling.sim.simulate import infrared

CHANGES: dict[str, tuple[str, Any]] = {
    "pattern scale 1.001": ("projector.pattern_scale", 1.001),
    "5 % of the dots dropped": ("projector.dropped_dots", 0.05),
}
ESTIMATES: dict[str, dict[str, Any]] = {
    "smoothed by 12 px": {"smoothing_px": heldout.SMOOTHING_PX, "within_surfaces": True},
    "in detail": {},
    "in detail, left image alone": {"left_only": True},
}
Image = NDArray[Any]


def main() -> None:
    """Print the remaining share of each change, by estimate."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rooms", nargs="*", default=[], help="all rooms if none")
    options = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    sensor = without_waves(resolve.load("d415", captures=str(path)))
    for scene in capture.open_set(path).scenes:
        if not options.rooms or scene.room in options.rooms:
            room = captured_scene.load(scene.path, sensor)
            for label, change in CHANGES.items():
                shares(scene, room, sensor, label, change)


def shares(
    scene: CapturedScene, room: Scene, sensor: Sensor, label: str, change: tuple[str, Any]
) -> None:
    """Print the remaining shares of one change."""
    stage = MitsubaScene(room)
    fixed = at_metered_exposure(sensor, room, direct.layers(stage, sensor))
    changed = with_values(fixed, [change])
    layers = direct.layers(stage, changed)
    seen = noiseless(layers, room, changed)
    change_dn = seen["left"] - noiseless(direct.layers(stage, fixed), room, fixed)["left"]
    pair = infrared(layers, room, changed, seed=1)
    assert pair.right is not None
    with tempfile.TemporaryDirectory() as folder:
        copied = Path(folder, scene.name)
        shutil.copytree(scene.path, copied)
        shutil.copy(scene.path.parent / "capture.toml", folder)
        frame = copied / str(scene.fullest().number)
        cv2.imwrite(str(frame / "ir_left.png"), pair.left)
        cv2.imwrite(str(frame / "ir_right.png"), pair.right)
        inner = heldout.away_from_edges(layers.left.depth_m, sensor)
        for name, arguments in ESTIMATES.items():
            estimated = captured_scene.load(copied, fixed, **arguments)
            model_layers = direct.layers(MitsubaScene(estimated), fixed)
            rest = seen["left"] - noiseless(model_layers, estimated, fixed)["left"]
            first, second = (correlation.without_mean(image)[inner] for image in (change_dn, rest))
            share = (first * second).sum() / (first * first).sum()
            print(f"{scene.name}, {label}, {name}: {share:.2f}", flush=True)


def at_metered_exposure(sensor: Sensor, room: Scene, layers: Layers) -> Sensor:
    """Return the sensor at the exposure that it chooses, without exposure control."""
    exposure = infrared(layers, room, sensor, seed=1).exposure
    values = {"auto_exposure_level": 0.0, "exposure_s": exposure.exposure_s, "gain": exposure.gain}
    return with_values(sensor, [(f"imager.{key}", value) for key, value in values.items()])


if __name__ == "__main__":
    main()
