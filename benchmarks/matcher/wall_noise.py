"""Noise of disparity on walls: the D415's own depth, and our matcher's by windows of its mean.

    python benchmarks/matcher/wall_noise.py 15x15 15x9 15x5 21x7 d415

Windows are columns and rows of `d4xx`'s mean; a sensor preset has its own matcher.
Captures: `d415-faro` in the folder $STARLING_CAPTURES. Walls are squares of 48 px that the laser
scanner has plane within 0.03 px of disparity, and where all that are asked for have depth all over,
so other walls where others are asked for; what is off the plane of each is noise. Told are its
deviation, that over the device's on the same wall (median over walls; like all figures then the
mean over scenes), how far it is alike 4 and 8 px along rows and columns, and how many pixels are as
deep as their neighbours. The window was chosen on the tuned rooms alone.
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
FLAT_PX = 0.03
LAGS_PX = (4, 8)
HEAD = (
    "depth",
    "rooms",
    "noise [px]",
    "over the device's",
    "alike along rows, 4; 8 px",
    "along columns",
    "equal, rows; columns",
)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("windows", nargs="+", help="as 15x5, or a sensor preset")
    matchers = {window: matcher_of(window) for window in parser.parse_args().windows}
    found: dict[tuple[str, bool], list[NDArray]] = {}
    for scene in scenes(folder()):
        maps = {"the device": scene.device_px}
        maps.update({window: matched(scene, setting) for window, setting in matchers.items()})
        walls = flat(scene.truth_px, list(maps.values()))
        told = {name: [noise(of[wall]) for wall in walls] for name, of in maps.items()}
        for name, each in told.items() if walls else ():
            beside = zip(each, told["the device"], strict=True)
            rows = [[*one, one[0] / device[0]] for one, device in beside]
            found.setdefault((name, scene.tuned), []).append(np.median(rows, axis=0))
        print(f"{scene.name}: {len(walls)} walls", file=sys.stderr)
    print(f"| {' | '.join(HEAD)} |\n{'| --- ' * len(HEAD)}|")
    for (name, tuned), told in sorted(found.items(), key=lambda each: not each[0][1]):
        deviation, *rest, over = np.mean(told, axis=0)
        pairs = [f"{one:.2f}; {two:.2f}" for one, two in zip(rest[::2], rest[1::2], strict=True)]
        cells = (name, "tuned" if tuned else "others", f"{deviation:.3f}", f"{over:.2f}", *pairs)
        print(f"| {' | '.join(cells)} |")


def matched(scene: Scene, setting: Matcher) -> NDArray:
    """Disparity (h, w) [px] by a matcher of ours, NaN where there is none.

    By way of depth in whole units, as the device's is.
    """
    found = match(scene.left, scene.right, setting).disparity_px
    info = tomllib.loads((folder() / "capture.toml").read_text())
    units = info["fx_px"] * info["baseline_m"] / info["depth_unit_m"]
    with np.errstate(divide="ignore"):
        return units / np.rint(units / found)


def matcher_of(window: str) -> Matcher:
    """`d4xx` with a window of its mean, or what else has that name."""
    if not window[0].isdigit():
        return setting_of(window)
    columns, rows = map(int, window.split("x"))
    refinement = replace(D4XX.refinement, smooth_px=columns, smooth_rows_px=rows)
    return replace(D4XX, refinement=refinement)


def flat(truth_px: NDArray, maps: list[NDArray]) -> list[tuple[slice, slice]]:
    """Squares where the reference is a plane, and all maps have depth."""
    height, width = truth_px.shape
    corners = [
        (slice(y, y + SIDE_PX), slice(x, x + SIDE_PX))
        for y in range(0, height - SIDE_PX + 1, SIDE_PX)
        for x in range(0, width - SIDE_PX + 1, SIDE_PX)
    ]
    known = [one for one in corners if all(np.isfinite(each[one]).all() for each in maps)]
    return [
        one
        for one in known
        if np.isfinite(truth_px[one]).all() and off_plane(truth_px[one]).std() < FLAT_PX
    ]


def noise(disparity: NDArray) -> list[float]:
    """Deviation, likeness along rows and columns by lag, and shares of equal neighbours."""
    off = off_plane(disparity)
    rows = [(off[:, lag:] * off[:, :-lag]).mean() / off.var() for lag in LAGS_PX]
    columns = [(off[lag:] * off[:-lag]).mean() / off.var() for lag in LAGS_PX]
    equal = [(np.diff(disparity, axis=axis) == 0).mean() for axis in (1, 0)]
    return [float(one) for one in (off.std(), *rows, *columns, *equal)]


def off_plane(disparity: NDArray) -> NDArray:
    """What of a square is off its plane of least squares."""
    down, across = np.indices(disparity.shape).reshape(2, -1)
    sides = np.stack([down, across, np.ones_like(down)], axis=1)
    level = disparity.ravel().astype(float)
    return (level - sides @ np.linalg.lstsq(sides, level, rcond=None)[0]).reshape(disparity.shape)


if __name__ == "__main__":
    main()
