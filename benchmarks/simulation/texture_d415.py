"""Measure contrast and spectral slope of the surfaces' texture in a real D415's rooms.

Reflectance is estimated in full detail from both infrared images. Windows of 64 px lie on one
surface. The power density at periods of 4 to 32 px gives a slope. The contrast is that of the
effect `texture` (`starling.sim.imaging.texture`) of this slope and power. Captures: `d415-faro` in
the folder $STARLING_CAPTURES.

Usage:
    python benchmarks/simulation/texture_d415.py --sensor SENSOR.toml --rooms 0742 3049 e
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np
from infrared_d415 import SIDE_PX, at_fitted_scale
from numpy.typing import NDArray

from starling.sim import metrics
from starling.sim.captures import capture
from starling.sim.captures.capture import CapturedScene
from starling.sim.scene.captured import captured_scene
from starling.sim.sensor import resolve

PERIODS_PX = (4.0, 32.0)
LIMITS_M = (0.001, 0.128)  # Wavelengths of the effect.
QUARTILES = (0.25, 0.5, 0.75)
Values = NDArray[np.float64]


def main() -> None:
    """Print quartiles over the windows of each scene, and of all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sensor", required=True)
    parser.add_argument("--rooms", nargs="*", default=[], help="all rooms if none")
    options = parser.parse_args()
    path = Path(os.environ["STARLING_CAPTURES"]) / "d415-faro"
    base = resolve.load(options.sensor, captures=str(path))
    print("| scene | windows | contrast: quartiles | slope: quartiles |\n|---|---|---|---|")
    tables = []
    for scene in capture.open_set(path).scenes:
        if not options.rooms or scene.room in options.rooms:
            light = captured_scene.estimate_light(scene, at_fitted_scale(scene, base))
            tables.append(textures(light.reflectance, scene))
            print_row(f"{scene.name} ({scene.room})", tables[-1])
    print_row("all", np.concatenate(tables))


def textures(reflectance: NDArray[np.float32], scene: CapturedScene) -> Values:
    """Contrast and slope of each window on one surface, (n, 2)."""
    truth_m = scene.truth_m()
    assert truth_m is not None
    edges = metrics.depth_edges(scene.info.disparity_px(truth_m))
    window = np.hanning(SIDE_PX + 1)[:-1]
    window = np.outer(window, window)
    across = np.fft.fftfreq(SIDE_PX)
    frequency = np.hypot(across, across[:, None])
    used = (frequency >= 1 / PERIODS_PX[1]) & (frequency <= 1 / PERIODS_PX[0])
    logs = np.log(frequency[used])
    rows = []
    height, width = reflectance.shape
    for top in range(0, height - SIDE_PX + 1, SIDE_PX):
        for column in range(metrics.LEFT_BAND_PX, width - SIDE_PX + 1, SIDE_PX):
            part = (slice(top, top + SIDE_PX), slice(column, column + SIDE_PX))
            depth_m = float(np.median(truth_m[part]))
            if edges[part].any() or not np.isfinite(depth_m):
                continue
            relative = reflectance[part] / reflectance[part].mean() - 1.0
            spectrum = np.abs(np.fft.fft2(relative * window)) ** 2
            spectrum /= (window**2).sum() * SIDE_PX**2  # Sums to the variance.
            slope = -np.polyfit(logs, np.log(spectrum[used] + 1e-15), 1)[0]
            share = share_within([p * depth_m / scene.info.fx_px for p in PERIODS_PX], slope)
            rows.append((np.sqrt(spectrum[used].sum() / share), slope))
    return np.array(rows)


def share_within(wavelengths_m: list[float], slope: float) -> float:
    """Share of a texture's variance at wavelengths, if an octave's falls as lambda^(slope - 2)."""

    def integral(low: float, high: float) -> float:
        steps = np.linspace(np.log(low), np.log(high), 200)
        return float(np.trapezoid(np.exp(steps * (slope - 2)), steps))

    return integral(*wavelengths_m) / integral(*LIMITS_M)


def print_row(name: str, values: Values) -> None:
    """Print quartiles of contrast and slope."""
    contrast, slope = (
        ", ".join(f"{value:.3g}" for value in np.quantile(column, QUARTILES)) for column in values.T
    )
    print(f"| {name} | {len(values)} | {contrast} | {slope} |", flush=True)


if __name__ == "__main__":
    main()
