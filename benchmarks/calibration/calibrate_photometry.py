"""Fit levels and noise of a real D415: black level, projector over ambient light, noise.

    python benchmarks/calibration/calibrate_photometry.py [SET/SCENE ...]

Captures come from the folder $STARLING_CAPTURES. By default, these are all scenes of d415-table and
one scene of each room of d415-faro. The preset's pattern differs from the device's. Without a
calibrated pattern (--sensor), only mean levels of tiles are fitted. Images with the emitter on and
off are assumed to have the same exposure, which the captures do not record.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.calibration import observation
from starling.calibration.photometry import levels
from starling.calibration.photometry.noise import fit_noise
from starling.calibration.photometry.photometry_fit import fit_photometry
from starling.sim.captures.capture import open_set
from starling.sim.imaging.imager.exposure import Exposure
from starling.sim.sensor import presets


def dot_contrast(image: NDArray, black_dn: float) -> float:
    """Return the median over the image of the dots' deviation over the local mean above black."""
    signal = image.astype(np.float32) - np.float32(black_dn)
    mean = cv2.GaussianBlur(signal, (0, 0), 10.0)
    dots = cv2.GaussianBlur(signal, (0, 0), 0.7) - cv2.GaussianBlur(signal, (0, 0), 6.0)
    deviation = np.sqrt(cv2.GaussianBlur(dots**2, (0, 0), 10.0))
    return float(np.median(deviation / np.maximum(mean, 1.0)))


def report(folder: Path, sensor_name: str) -> None:
    """Fit one scene and print the results."""
    captures = open_set(folder)
    sensor = captures.info.geometry_into(presets.load(sensor_name))
    start_s = time.perf_counter()
    one_exposure = Exposure(exposure_s=sensor.left.exposure_s, gain=sensor.left.gain)
    seen = [
        dataclasses.replace(observation.load(scene, sensor), exposure=one_exposure)
        for scene in captures.scenes
    ]
    fit = fit_photometry(seen, sensor)
    noise = fit_noise(seen, fit.predictions, fit.solution.sensor)
    print(f"{folder.parent.name}/{folder.name}: {time.perf_counter() - start_s:.0f} s")
    for scene_observation in seen:
        for side in ("left", "right"):
            image, off = getattr(scene_observation, side), getattr(scene_observation, f"{side}_off")
            if image is None:
                continue
            black = fit.solution.sensor.left.black_level_dn
            line = f"  {side}: darkest {levels.lower_envelope_dn(image):.1f} DN, mean "
            line += f"{image.mean():.1f} DN, dots {dot_contrast(image, black):.3f} of the mean"
            if off is not None:
                added = float(np.median(image.astype(np.float64) - off))
                line += f"; emitter off: darkest {levels.lower_envelope_dn(off):.1f} DN, mean "
                line += f"{off.mean():.1f} DN, emitter adds {added:.1f} DN (median)"
            print(line)
    for estimate in (*fit.solution.estimates, *noise.estimates):
        print(f"  {estimate.name:52}{estimate.value:10.4g} +- {estimate.sd:.2g} {estimate.unit}")
    for sentence in (*fit.solution.undetermined, *noise.undetermined):
        print(f"  open: {sentence}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scenes", nargs="*", help="SET/SCENE of the captures")
    parser.add_argument("--sensor", default="d415", help="preset or TOML file")
    arguments = parser.parse_args()
    captures = Path(os.environ.get("STARLING_CAPTURES", ""))
    scenes = [captures / scene for scene in arguments.scenes]
    if not scenes:
        rooms = {scene.room: scene.path for scene in open_set(captures / "d415-faro").scenes}
        scenes = [*(s.path for s in open_set(captures / "d415-table").scenes), *rooms.values()]
    for scene in scenes:
        report(scene, arguments.sensor)


if __name__ == "__main__":
    main()
