"""Recover a real D415's pattern from its own rooms, and re-simulate rooms that the fit never saw.

For every room, the pattern is recovered from N of the other rooms (the next ones in order, all of
them for N = 9), and the room's scenes are simulated by the sensor that comes out. Prints the
correlation of simulated with real infrared beside the ceiling that the camera's own right image
sets, places and widths of the fit, and the figures of `starling compare` before and after.

Usage:
    STARLING_CAPTURES=... python benchmarks/calibrate_faro.py                  # all other rooms
    STARLING_CAPTURES=... python benchmarks/calibrate_faro.py --rooms 1 2 3 5  # from few
    STARLING_CAPTURES=... python benchmarks/calibrate_faro.py --gap            # with compare
"""

import argparse
import dataclasses
import os
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from calibration import correlation, heldout, observation
from calibration.pattern import pattern_sensor, pattern_solution, recovery, views
from sim import asked_sensor, capture, compare, simulate_captures

_BETWEEN = -0.45  # Simulated light, in local deviations, below which a pixel lies between dots.
_EVEN = 0.15  # Share of a window's variance that pixels between dots have, of an even surface.


def main() -> None:
    """Print one table a number of rooms."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, nargs="*", default=[9])
    parser.add_argument("--held", nargs="*", default=[], help="rooms to hold out; all if none")
    parser.add_argument("--gap", action="store_true", help="compare before and after as well")
    asked = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    nominal = asked_sensor.load("d415", captures=str(path))
    scenes = capture.open_set(path).scenes
    seen = {scene.name: views.of(observation.load(scene, nominal), nominal) for scene in scenes}
    rooms = list(dict.fromkeys(scene.room for scene in scenes))
    for count in asked.rooms:
        print(f"\nfrom {count} rooms")
        rows = []
        for number, room in enumerate(rooms):
            if asked.held and room not in asked.held:
                continue
            others = (rooms[number + 1 :] + rooms[:number])[:count]
            with tempfile.TemporaryDirectory() as folder:
                used = [view for s in scenes if s.room in others for view in seen[s.name]]
                found, sensor = _recovered(used, nominal, Path(folder))
                for scene in (s for s in scenes if s.room == room):
                    rows.append(_scored(scene, seen[scene.name], nominal, sensor, found, folder))
                    if asked.gap:
                        _gap(scene, nominal, sensor, rows[-1][0], Path(folder))
        _summary(np.array(rows))


def _recovered(used, nominal, folder):
    begun = time.process_time()
    found = recovery.recover(used, nominal)
    solution = pattern_solution.solution(found, nominal, metric=False)
    print(f"  fit: {len(used)} views, {time.process_time() - begun:.0f} s of processor time")
    for one in (*solution.estimates, *solution.derived):
        if "[" not in one.name:
            print(f"    {one.name:36}{one.value:14.6g} +- {one.sd:.2g} {one.unit}")
    return found, pattern_sensor.with_pattern(nominal, found, folder)


def _scored(scene, seen, nominal, sensor, found, folder):
    begun = observation.load(scene, nominal, smoothing_px=heldout.SMOOTHING_PX)
    scale = recovery.scene_scale(seen, nominal, found.fitted.model)
    control = pattern_sensor.mirrored(sensor, Path(folder))
    one = heldout.score(begun, sensor, scale=scale, mirrored=control)
    row = [scale]
    for windows in (one.ncc["left"], one.ncc["right"], one.ceiling):
        row += [float(np.median(windows)), float(np.percentile(windows, 25))]
    row.append(float(np.abs([np.median(w) for w in one.mirrored.values()]).max()))
    row += _even(one)
    print(
        f"  {scene.name} ({scene.room}) scale {1e3 * (scale - 1):+.2f}e-3  left {row[1]:.3f} "
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


def _gap(scene, nominal, sensor, scale, folder):
    """Print the figures of compare by the preset and by the calibrated sensor."""
    light = dataclasses.replace(sensor.projector, pattern_scale=scale)
    for name, camera in (
        ("before", nominal),
        ("after", dataclasses.replace(sensor, projector=light)),
    ):
        out = folder / name
        simulate_captures.simulate_captures(str(scene.path), camera, out, force=True)
        figures = compare.compare(capture.open_set(scene.path), capture.open_set(out))["metrics"]
        text = "  ".join(f"{key} {v['real']:.3f} {v['sim']:.3f}" for key, v in figures.items())
        print(f"    {name}: {text}", flush=True)


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
