"""Calibrate a real D415 on some of its rooms, and score simulations of held-out rooms.

For each room, a sensor is calibrated on the next N of the other rooms. The room's scenes are then
simulated with the calibrated sensor. The script prints the estimates and the correlation of
simulated and real infrared images. The upper bound of the correlation comes from the camera's
right image. With `--gap` it prints the figures of `starling compare` before and after.

Usage:

    export STARLING_CAPTURES=...
    python benchmarks/calibration/calibrate_faro.py                  # all other rooms
    python benchmarks/calibration/calibrate_faro.py --rooms 1 2 3 5  # few rooms
    python benchmarks/calibration/calibrate_faro.py --gap            # with levels and noise
    python benchmarks/calibration/calibrate_faro.py --gap --out DIR  # write the sensor files
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

_BETWEEN = -0.45  # Simulated light of a pixel between dots, at most [local deviations].
_EVEN = 0.15  # Maximum share of a uniform window's variance between dots.


def main() -> None:
    """Print a table for each number of rooms."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, nargs="*", default=[9])
    parser.add_argument("--held", nargs="*", default=[], help="rooms to hold out; all if none")
    parser.add_argument("--gap", action="store_true", help="compare before and after as well")
    parser.add_argument("--out", type=Path, help="folder for each room's sensor.toml")
    options = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    nominal = resolve.load("d415", captures=str(path))
    scenes = capture.open_set(path).scenes
    rooms = list(dict.fromkeys(scene.room for scene in scenes))
    free = ("pattern", "photometry", "noise") if options.gap else ("pattern",)
    held = [room for room in rooms if room in options.held or not options.held]
    before = {s.name: _gap(s, nominal) for s in scenes if options.gap and s.room in held}
    if before:
        print("before:")
        _gap_summary(before)
    for count in options.rooms:
        print(f"\nfrom {count} rooms")
        rows, after = [], {}
        for room in held:
            number = rooms.index(room)
            others = (rooms[number + 1 :] + rooms[:number])[:count]
            used = [scene for scene in scenes if scene.room in (room, *others)]
            with tempfile.TemporaryDirectory() as temporary:
                folder = Path(temporary) if options.out is None else options.out / f"{room}-{count}"
                folder.mkdir(parents=True, exist_ok=True)
                result = _calibrated(used, nominal, free, room, folder)
                (folder / "sensor.toml").write_text(presets.dumps(result.sensor))
                for score in result.heldout:
                    rows.append(_scored(score))
                    if options.gap:
                        scene = next(s for s in scenes if s.name == score.scene)
                        light = dataclasses.replace(
                            result.sensor.projector, pattern_scale=score.scale
                        )
                        after[score.scene] = _gap(
                            scene, dataclasses.replace(result.sensor, projector=light)
                        )
        _summary(np.array(rows))
        if after:
            _gap_summary(after)


def _calibrated(scenes, nominal, free, room, folder):
    start_s = time.process_time()
    result = calibration.fit(scenes, nominal, free=free, heldout=(room,), folder=folder)
    print(f"  {room} held out, {time.process_time() - start_s:.0f} s of processor time")
    for solution in result.solutions.values():
        for estimate in (*solution.estimates, *solution.derived):
            if "[" not in estimate.name:
                print(
                    f"    {estimate.name:36}{estimate.value:14.6g} +- {estimate.sd:.2g} "
                    f"{estimate.unit}"
                )
    return result


def _scored(score):
    row = [score.scale]
    for windows in (score.ncc["left"], score.ncc["right"], score.ceiling):
        row += [float(np.median(windows)), float(np.percentile(windows, 25))]
    row.append(float(np.abs([np.median(w) for w in score.mirrored.values()]).max()))
    row += _uniform_windows(score)
    print(
        f"  {score.scene} ({score.room}) scale {1e3 * (score.scale - 1):+.2f}e-3  "
        f"left {row[1]:.3f} {row[2]:.3f}  "
        f"right {row[3]:.3f} {row[4]:.3f}  ceiling {row[5]:.3f} {row[6]:.3f}  "
        f"share {row[1] / row[5]:.3f} {row[2] / row[6]:.3f} {row[3] / row[5]:.3f} "
        f"{row[4] / row[6]:.3f}  mirrored {row[7]:.3f}  even places {row[8]:.3f} {row[9]:.3f} "
        f"({row[10]:.0%} of the image)",
        flush=True,
    )
    return row


def _uniform_windows(score):
    """Return the correlation in windows with little variance between dots (uniform surfaces)."""
    real, simulated = (
        correlation.high_passed(images["left"]) for images in (score.real, score.simulated)
    )
    everywhere = np.ones(real.shape, bool)
    ncc = correlation.local_ncc(real, simulated, everywhere)
    dark = (simulated < _BETWEEN).astype(np.float64)
    side = (correlation.WINDOW_PX,) * 2
    margin = correlation.WINDOW_PX // 2
    inner = (slice(margin, -margin, correlation.STRIDE_PX),) * 2

    def mean(image):
        return cv2.boxFilter(image, cv2.CV_64F, side)[inner].ravel()

    share = np.maximum(mean(dark), 1e-6)
    texture = mean(dark * real**2) / share - (mean(dark * real) / share) ** 2
    uniform = texture < _EVEN * (mean(real.astype(np.float64) ** 2) - mean(real.astype(float)) ** 2)
    if not uniform.any():
        return [float("nan"), float("nan"), 0.0]
    return [
        float(np.median(ncc[uniform])),
        float(np.percentile(ncc[uniform], 25)),
        float(uniform.mean()),
    ]


def _gap(scene, sensor):
    """Print and return the figures of `starling compare` for one scene, real and simulated."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "simulated")
        simulate_captures.simulate_captures(str(scene.path), sensor, out)
        figures = compare.compare(capture.open_set(scene.path), capture.open_set(out))["metrics"]
    text = "  ".join(f"{key} {v['real']:.3f} {v['sim']:.3f}" for key, v in figures.items())
    print(f"    {scene.name}: {text}", flush=True)
    return figures


def _gap_summary(scenes):
    """Print medians over scenes: real, simulated, and the absolute gap by scene."""
    print("  medians over scenes: real, simulated, size of the gap")
    for key in next(iter(scenes.values())):
        real, sim, gap = (
            [figures[key][kind] for figures in scenes.values()] for kind in ("real", "sim", "gap")
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
