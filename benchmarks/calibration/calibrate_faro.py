"""Calibrate to a real D415 on some of its rooms, and re-simulate rooms that the fit never saw.

For every room, a sensor is calibrated on N of the other rooms (the next ones in order, all of
them for N = 9), and the room's scenes are simulated by the sensor that comes out. Prints the
correlation of simulated with real infrared beside the ceiling that the camera's own right image
sets, what was fitted, and the figures of `starling compare` before and after.

Usage:
    STARLING_CAPTURES=... python benchmarks/calibration/calibrate_faro.py                  # all other rooms
    STARLING_CAPTURES=... python benchmarks/calibration/calibrate_faro.py --rooms 1 2 3 5  # from few
    STARLING_CAPTURES=... python benchmarks/calibration/calibrate_faro.py --gap            # levels and noise
                                                                # too, and compare
    STARLING_CAPTURES=... python benchmarks/calibration/calibrate_faro.py --gap --out DIR  # keep the sensors
"""

import argparse
import dataclasses
import os
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from starling import calibration
from starling.calibration import correlation
from starling.sim.captures import capture
from starling.sim.commands import compare, simulate_captures
from starling.sim.sensor import presets, resolve

_BETWEEN = -0.45  # Simulated light, in local deviations, below which a pixel lies between dots.
_EVEN = 0.15  # Share of a window's variance that pixels between dots have, of an even surface.


def main() -> None:
    """Print one table a number of rooms."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, nargs="*", default=[9])
    parser.add_argument("--held", nargs="*", default=[], help="rooms to hold out; all if none")
    parser.add_argument("--gap", action="store_true", help="compare before and after as well")
    parser.add_argument("--out", type=Path, help="folder for each room's sensor.toml")
    asked = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    nominal = resolve.load("d415", captures=str(path))
    scenes = capture.open_set(path).scenes
    rooms = list(dict.fromkeys(scene.room for scene in scenes))
    free = ("pattern", "photometry", "noise") if asked.gap else ("pattern",)
    held = [room for room in rooms if room in asked.held or not asked.held]
    before = {s.name: _gap(s, nominal) for s in scenes if asked.gap and s.room in held}
    if before:
        print("before:")
        _gap_summary(before)
    for count in asked.rooms:
        print(f"\nfrom {count} rooms")
        rows, after = [], {}
        for room in held:
            number = rooms.index(room)
            others = (rooms[number + 1 :] + rooms[:number])[:count]
            used = [scene for scene in scenes if scene.room in (room, *others)]
            with tempfile.TemporaryDirectory() as temporary:
                folder = Path(temporary) if asked.out is None else asked.out / f"{room}-{count}"
                folder.mkdir(parents=True, exist_ok=True)
                found = _calibrated(used, nominal, free, room, folder)
                (folder / "sensor.toml").write_text(presets.dumps(found.sensor))
                for one in found.heldout:
                    rows.append(_scored(one))
                    if asked.gap:
                        scene = next(s for s in scenes if s.name == one.scene)
                        light = dataclasses.replace(found.sensor.projector, pattern_scale=one.scale)
                        after[one.scene] = _gap(
                            scene, dataclasses.replace(found.sensor, projector=light)
                        )
        _summary(np.array(rows))
        if after:
            _gap_summary(after)


def _calibrated(scenes, nominal, free, room, folder):
    begun = time.process_time()
    found = calibration.fit(scenes, nominal, free=free, heldout=(room,), folder=folder)
    print(f"  {room} held out, {time.process_time() - begun:.0f} s of processor time")
    for solution in found.solutions.values():
        for one in (*solution.estimates, *solution.derived):
            if "[" not in one.name:
                print(f"    {one.name:36}{one.value:14.6g} +- {one.sd:.2g} {one.unit}")
    return found


def _scored(one):
    row = [one.scale]
    for windows in (one.ncc["left"], one.ncc["right"], one.ceiling):
        row += [float(np.median(windows)), float(np.percentile(windows, 25))]
    row.append(float(np.abs([np.median(w) for w in one.mirrored.values()]).max()))
    row += _even(one)
    print(
        f"  {one.scene} ({one.room}) scale {1e3 * (one.scale - 1):+.2f}e-3  left {row[1]:.3f} "
        f"{row[2]:.3f}  right {row[3]:.3f} {row[4]:.3f}  ceiling {row[5]:.3f} {row[6]:.3f}  "
        f"share {row[1] / row[5]:.3f} {row[2] / row[6]:.3f} {row[3] / row[5]:.3f} "
        f"{row[4] / row[6]:.3f}  mirrored {row[7]:.3f}  even places {row[8]:.3f} {row[9]:.3f} "
        f"({row[10]:.0%} of the image)",
        flush=True,
    )
    return row


def _even(one):
    """Correlation in windows whose surface is even: between its dots little varies."""
    real, simulated = (
        correlation.high_passed(images["left"]) for images in (one.real, one.simulated)
    )
    everywhere = np.ones(real.shape, bool)
    found = correlation.local_ncc(real, simulated, everywhere)
    between = (simulated < _BETWEEN).astype(np.float64)
    side = (correlation.WINDOW_PX,) * 2
    margin = correlation.WINDOW_PX // 2
    inner = (slice(margin, -margin, correlation.STRIDE_PX),) * 2

    def mean(image):
        return cv2.boxFilter(image, cv2.CV_64F, side)[inner].ravel()

    share = np.maximum(mean(between), 1e-6)
    texture = mean(between * real**2) / share - (mean(between * real) / share) ** 2
    even = texture < _EVEN * (mean(real.astype(np.float64) ** 2) - mean(real.astype(float)) ** 2)
    if not even.any():
        return [float("nan"), float("nan"), 0.0]
    return [
        float(np.median(found[even])),
        float(np.percentile(found[even], 25)),
        float(even.mean()),
    ]


def _gap(scene, sensor):
    """Print and return the figures of compare, real and simulated, of one scene."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "simulated")
        simulate_captures.simulate_captures(str(scene.path), sensor, out)
        figures = compare.compare(capture.open_set(scene.path), capture.open_set(out))["metrics"]
    text = "  ".join(f"{key} {v['real']:.3f} {v['sim']:.3f}" for key, v in figures.items())
    print(f"    {scene.name}: {text}", flush=True)
    return figures


def _gap_summary(scenes):
    """Medians over scenes: of both, and of how far apart they are scene by scene."""
    print("  medians over scenes: real, simulated, size of the gap")
    for key in next(iter(scenes.values())):
        real, sim, gap = (
            [figures[key][part] for figures in scenes.values()] for part in ("real", "sim", "gap")
        )
        print(
            f"    {key:14}{np.median(real):8.3f}{np.median(sim):8.3f}{np.median(np.abs(gap)):8.3f}"
        )


def _summary(rows):
    shares = rows[:, [1, 2, 3, 4]] / rows[:, [5, 6, 5, 6]]
    print("  medians over scenes: left, right, ceiling (median, lower quartile)")
    print("   ", np.median(rows[:, 1:7], axis=0).round(3))
    print("  share of the ceiling: left, right (median, lower quartile); mean, worst scene")
    print("   ", shares.mean(axis=0).round(3), shares.min(axis=0).round(3))
    print("  mirrored, largest", rows[:, 7].max().round(3))
    print("  even places: median, lower quartile, share of the image; medians over scenes")
    print("   ", np.nanmedian(rows[:, 8:11], axis=0).round(3), flush=True)


if __name__ == "__main__":
    main()
