"""Measure disparity noise on walls: the D415's depth, and our matcher by window of its mean.

    python benchmarks/matcher/wall_noise.py 15x15 15x9 15x5 21x7 d415

Windows are columns and rows of `d4xx`'s mean; a sensor preset has its own matcher.
Captures: `d415-faro` in the folder $STARLING_CAPTURES. A wall is a square of 48 px whose
laser-scanner disparity is plane within 0.03 px. All compared depths must fill it, so the set of
walls depends on the arguments. Noise is the deviation from each depth's own plane.

The table lists the standard deviation of the noise, and its ratio to the device's on the same wall.
Along rows and columns, it lists the autocorrelation at lags of 4 and 8 px and the share of equal
neighbours. The powers are those at periods of 5 to 7 px and below 3 px. All figures are medians
over walls, then means over scenes. The window was chosen on the tuned rooms only.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from dataclasses import replace

import numpy as np
from match_faro import Scene, folder, scenes, setting_of
from numpy.typing import NDArray

from starling.sim.sensor.matcher import D4XX, Matcher
from starling.sim.stereo.matching import match

SIDE_PX = 48
PERIODS_PX = ((5, 7), (2, 3))  # Bands of the fine noise.
FLAT_PX = 0.03
LAGS_PX = (4, 8)
HEAD = (
    "depth",
    "rooms",
    "noise [px]",
    "over the device's",
    "autocorrelation along rows, 4; 8 px",
    "along columns",
    "equal, rows; columns",
    "power at 5 to 7 px [1e-4 px^2], rows; columns",
    "below 3 px",
)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("windows", nargs="+", help="as 15x5, or a sensor preset")
    matchers = {window: matcher_of(window) for window in parser.parse_args().windows}
    rows_by_group: dict[tuple[str, bool], list[NDArray]] = {}
    for scene in scenes(folder()):
        maps = {"the device": scene.device_px}
        maps.update({window: matched(scene, setting) for window, setting in matchers.items()})
        walls = flat(scene.truth_px, list(maps.values()))
        noise_by_map = {
            name: [noise(disparity[wall]) for wall in walls] for name, disparity in maps.items()
        }
        for name, wall_noise in noise_by_map.items() if walls else ():
            pairs_with_device = zip(wall_noise, noise_by_map["the device"], strict=True)
            rows = [[*row, row[0] / device[0]] for row, device in pairs_with_device]
            rows_by_group.setdefault((name, scene.tuned), []).append(np.median(rows, axis=0))
        print(f"{scene.name}: {len(walls)} walls", file=sys.stderr)
    print(f"| {' | '.join(HEAD)} |\n{'| --- ' * len(HEAD)}|")
    for (name, tuned), noise_by_map in sorted(
        rows_by_group.items(), key=lambda wall_noise: not wall_noise[0][1]
    ):
        deviation, *rest, ratio = np.mean(noise_by_map, axis=0)
        pairs = [
            f"{row:.2f}; {second:.2f}" for row, second in zip(rest[::2], rest[1::2], strict=True)
        ]
        cells = (name, "tuned" if tuned else "others", f"{deviation:.3f}", f"{ratio:.2f}", *pairs)
        print(f"| {' | '.join(cells)} |")


def matched(scene: Scene, setting: Matcher) -> NDArray:
    """Return the matcher's disparity (h, w) [px], NaN where missing.

    Depth is rounded to whole units, as the device's depth is.
    """
    disparity = match(scene.left, scene.right, setting).disparity_px
    info = tomllib.loads((folder() / "capture.toml").read_text())
    units = info["fx_px"] * info["baseline_m"] / info["depth_unit_m"]
    with np.errstate(divide="ignore"):
        return units / np.rint(units / disparity)


def matcher_of(window: str) -> Matcher:
    """Return `d4xx` with a window of its mean, or the matcher of that name."""
    if not window[0].isdigit():
        return setting_of(window)
    columns, rows = map(int, window.split("x"))
    refinement = replace(D4XX.refinement, smooth_px=columns, smooth_rows_px=rows)
    return replace(D4XX, refinement=refinement)


def flat(truth_px: NDArray, maps: list[NDArray]) -> list[tuple[slice, slice]]:
    """Return the squares with a plane reference and depth in all maps."""
    height, width = truth_px.shape
    corners = [
        (slice(y, y + SIDE_PX), slice(x, x + SIDE_PX))
        for y in range(0, height - SIDE_PX + 1, SIDE_PX)
        for x in range(0, width - SIDE_PX + 1, SIDE_PX)
    ]
    known = [
        corner
        for corner in corners
        if all(np.isfinite(disparity[corner]).all() for disparity in maps)
    ]
    return [
        corner
        for corner in known
        if np.isfinite(truth_px[corner]).all() and off_plane(truth_px[corner]).std() < FLAT_PX
    ]


def noise(disparity: NDArray) -> list[float]:
    """Return deviation, autocorrelation by lag, shares of equal neighbours, powers by band."""
    off = off_plane(disparity)
    rows = [(off[:, lag:] * off[:, :-lag]).mean() / off.var() for lag in LAGS_PX]
    columns = [(off[lag:] * off[:-lag]).mean() / off.var() for lag in LAGS_PX]
    equal = [(np.diff(disparity, axis=axis) == 0).mean() for axis in (1, 0)]
    spectra = [power(off)[1:], power(off.T)[1:]]
    period_px = SIDE_PX / np.arange(1, SIDE_PX // 2 + 1)
    bands = [(low <= period_px) & (period_px <= high) for low, high in PERIODS_PX]
    fine = [1e4 * spectrum[band].mean() for band in bands for spectrum in spectra]
    return [float(value) for value in (off.std(), *rows, *columns, *equal, *fine)]


def power(off: NDArray) -> NDArray:
    """Return the mean power of a square along its rows, by waves in it [px^2]."""
    window = np.hanning(SIDE_PX)
    spectrum = np.fft.rfft(off * window / np.sqrt((window**2).mean()), axis=1)
    return (np.abs(spectrum) ** 2).mean(axis=0) / SIDE_PX


def off_plane(disparity: NDArray) -> NDArray:
    """Return the deviation of a square from its least-squares plane."""
    down, across = np.indices(disparity.shape).reshape(2, -1)
    sides = np.stack([down, across, np.ones_like(down)], axis=1)
    level = disparity.ravel().astype(float)
    return (level - sides @ np.linalg.lstsq(sides, level, rcond=None)[0]).reshape(disparity.shape)


if __name__ == "__main__":
    main()
