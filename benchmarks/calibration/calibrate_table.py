"""Compare the projected patterns of two devices of one camera model.

The pattern of one D415 is recovered from its rooms (d415-faro). The pattern of another D415 is
recovered from emitter-on minus emitter-off images (d415-table), on the surface of the device's
depth. Then the first device's pattern is projected on the second device's table, unchanged and
with each emitter's pose fitted. The second device's own pattern is the upper bound.

Usage:
    STARLING_CAPTURES=... python benchmarks/calibration/calibrate_table.py
"""

import dataclasses
import os
import shutil
import tempfile
from pathlib import Path

import numpy as np

from starling.calibration import correlation, observation
from starling.calibration.pattern import emitter_model, lattice, pattern_fit, recovery, views
from starling.sim.captures import capture
from starling.sim.sensor import resolve

_ROOMS = ("0060", "1982", "4426")
_PEDESTAL_DN = 10.0  # Keeps a difference of images above 0.


def main() -> None:
    """Print the lattices of both devices and the correlations."""
    captures = Path(os.environ["STARLING_CAPTURES"])
    first = _first_unit(captures / "d415-faro")
    seen, sensor = _second_unit(captures / "d415-table")
    second = recovery.recover(seen, sensor).fitted.model
    for name, model in (("first unit", first), ("second unit", second)):
        print(name)
        for number, emitter in enumerate(model.emitters):
            print(f"  emitter {number}: {_description(emitter)}")
    # Emitters are matched by the angle of their lattices.
    order = [
        min(range(2), key=lambda k: abs(_angle(second.emitters[k]) - _angle(emitter)))
        for emitter in first.emitters
    ]
    second_emitters = [second.emitters[k] for k in order]
    posed = [_with_pose(a, b) for a, b in zip(first.emitters, second_emitters, strict=True)]
    scene = seen[0].scene
    for name, model in (
        ("as it is", dataclasses.replace(first, scales={scene: 1.0})),
        ("each emitter posed anew", dataclasses.replace(second, emitters=tuple(posed))),
        ("the second unit's own", second),
    ):
        text = "  ".join(
            f"{view.side} {np.median(n):.3f} {np.percentile(n, 25):.3f}"
            for view, n in ((view, _ncc(view, sensor, model)) for view in seen)
        )
        print(f"{name}: {text}")


def _first_unit(path: Path) -> emitter_model.EmitterModel:
    sensor = resolve.load("d415", captures=str(path))
    scenes = [scene for scene in capture.open_set(path).scenes if scene.room in _ROOMS]
    seen = [v for s in scenes for v in views.make_views(observation.load(s, sensor), sensor)]
    return recovery.recover(seen, sensor).fitted.model


def _second_unit(path: Path):
    """Return views of the emitter's light only, on the surface of the device's depth."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "table"
        shutil.copytree(path, copy, copy_function=shutil.copyfile)
        (scene,) = capture.open_set(copy).scenes
        shutil.copyfile(scene.path / str(scene.frames[0]) / "depth.png", scene.path / "truth.png")
        sensor = resolve.load("d415", captures=str(copy))
        (scene,) = capture.open_set(copy).scenes
        scene_observation = observation.load(scene, sensor)
    lit = {
        "left": scene_observation.left - scene_observation.left_off,
        "right": scene_observation.right - scene_observation.right_off,
    }
    return [
        dataclasses.replace(view, level_dn=lit[view.side] + np.float32(_PEDESTAL_DN))
        for view in views.make_views(scene_observation, sensor)
    ], sensor


def _angle(emitter) -> float:
    """Return the direction of the lattice [deg], 0 to 90."""
    x, y = emitter.source.frequencies[0]
    return float(np.degrees(np.arctan2(y, x)) % 90)


def _description(emitter) -> str:
    first, second = emitter.source.frequencies
    lengths = np.hypot(*first), np.hypot(*second)
    skew = np.degrees(np.arcsin(first @ second / (lengths[0] * lengths[1])))
    return (
        f"position [mm] {(1e3 * emitter.position_m).round(2)}, cycles {np.round(lengths, 2)}, "
        f"angle {_angle(emitter):.2f} deg, skew {skew:+.2f} deg, "
        f"keystone [1e-3] {(1e3 * emitter.source.keystone).round(2)}, "
        f"dot sigma {1e3 * emitter.source.sigma:.2f} mrad"
    )


def _with_pose(emitter, target):
    """Rotate, scale and move one device's lattice to the other's angle, pitch and position."""
    angle = np.radians((_angle(target) - _angle(emitter) + 45) % 90 - 45)
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned = emitter.source.frequencies @ rotation
    scale = np.sqrt(abs(np.linalg.det(target.source.frequencies) / np.linalg.det(turned)))
    # Both bases span one lattice, but the order of their vectors may differ.
    basis = np.rint(target.source.frequencies @ np.linalg.inv(scale * turned))
    source = lattice.Lattice(
        frequencies=basis @ (scale * turned),
        phase=target.source.phase,
        sigma=emitter.source.sigma,
        keystone=target.source.keystone,
    )
    return dataclasses.replace(target, source=source)


def _ncc(view, sensor, model):
    emitter_lights = emitter_model.illuminate(
        pattern_fit.surface_points(view, sensor), model, model.scales[view.scene]
    )
    light = np.sum([emitter_light.light for emitter_light in emitter_lights], axis=0).reshape(
        view.level_dn.shape
    )
    return correlation.local_ncc(
        correlation.high_passed(view.level_dn), correlation.high_passed(light), view.usable
    )


if __name__ == "__main__":
    main()
