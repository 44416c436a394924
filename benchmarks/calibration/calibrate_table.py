"""Two units of one camera model: is one's pattern the other's?

The pattern of one D415 is recovered from its rooms (d415-faro), another's from its emitter's light
alone, on minus off (d415-table), on the surface that the device itself measured. Then the first
unit's pattern is laid on the second's table: as it is; with each emitter turned and shifted to its
place; and the second unit's own, as an upper bound.

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
    """Print both units' lattices and the correlations."""
    captures = Path(os.environ["STARLING_CAPTURES"])
    first = _first_unit(captures / "d415-faro")
    seen, sensor = _second_unit(captures / "d415-table")
    second = recovery.recover(seen, sensor).fitted.model
    for name, model in (("first unit", first), ("second unit", second)):
        print(name)
        for number, one in enumerate(model.emitters):
            print(f"  emitter {number}: {_told(one)}")
    # The nearer angle tells which emitter is which.
    order = [
        min(range(2), key=lambda k: abs(_angle(second.emitters[k]) - _angle(one)))
        for one in first.emitters
    ]
    own = [second.emitters[k] for k in order]
    posed = [_posed(a, b) for a, b in zip(first.emitters, own, strict=True)]
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


def _first_unit(path: Path) -> emitter_model.Model:
    sensor = resolve.load("d415", captures=str(path))
    scenes = [scene for scene in capture.open_set(path).scenes if scene.room in _ROOMS]
    seen = [v for s in scenes for v in views.of(observation.load(s, sensor), sensor)]
    return recovery.recover(seen, sensor).fitted.model


def _second_unit(path: Path):
    """Views of the emitter's light alone, on the surface as the device's own depth has it."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "table"
        shutil.copytree(path, copy, copy_function=shutil.copyfile)
        (scene,) = capture.open_set(copy).scenes
        shutil.copyfile(scene.path / str(scene.frames[0]) / "depth.png", scene.path / "truth.png")
        sensor = resolve.load("d415", captures=str(copy))
        (scene,) = capture.open_set(copy).scenes
        one = observation.load(scene, sensor)
    lit = {"left": one.left - one.left_off, "right": one.right - one.right_off}
    return [
        dataclasses.replace(view, level_dn=lit[view.side] + np.float32(_PEDESTAL_DN))
        for view in views.of(one, sensor)
    ], sensor


def _angle(emitter) -> float:
    """Direction of the lattice [deg], 0 to 90."""
    x, y = emitter.source.frequencies[0]
    return float(np.degrees(np.arctan2(y, x)) % 90)


def _told(emitter) -> str:
    first, second = emitter.source.frequencies
    lengths = np.hypot(*first), np.hypot(*second)
    skew = np.degrees(np.arcsin(first @ second / (lengths[0] * lengths[1])))
    return (
        f"position [mm] {(1e3 * emitter.position_m).round(2)}, cycles {np.round(lengths, 2)}, "
        f"angle {_angle(emitter):.2f} deg, skew {skew:+.2f} deg, "
        f"keystone [1e-3] {(1e3 * emitter.source.keystone).round(2)}, "
        f"dot sigma {1e3 * emitter.source.sigma:.2f} mrad"
    )


def _posed(one, other):
    """One unit's lattice, turned and scaled to the other's angle and pitch, in its place."""
    turn = np.radians((_angle(other) - _angle(one) + 45) % 90 - 45)
    rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    turned = one.source.frequencies @ rotation
    scale = np.sqrt(abs(np.linalg.det(other.source.frequencies) / np.linalg.det(turned)))
    # Both bases span one lattice; the other's may name its vectors in another order.
    whole = np.rint(other.source.frequencies @ np.linalg.inv(scale * turned))
    source = lattice.Lattice(
        frequencies=whole @ (scale * turned),
        phase=other.source.phase,
        sigma=one.source.sigma,
        keystone=other.source.keystone,
    )
    return dataclasses.replace(other, source=source)


def _ncc(view, sensor, model):
    laid = emitter_model.lay(pattern_fit.seen_of(view, sensor), model, model.scales[view.scene])
    light = np.sum([one.light for one in laid], axis=0).reshape(view.level_dn.shape)
    return correlation.local_ncc(
        correlation.high_passed(view.level_dn), correlation.high_passed(light), view.usable
    )


if __name__ == "__main__":
    main()
