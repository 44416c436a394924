"""Compare our depth map with the device's own, of the same real infrared pairs of a D415.

    python benchmarks/matcher/device_map.py d415
    python benchmarks/matcher/device_map.py d415 "d415 matcher.engine.second_peak=0"

An argument is a sensor preset or a matcher setting, with changes as `starling --set` takes them.
Captures: `d415-faro` in the folder $STARLING_CAPTURES. Settings were chosen on the choice rooms
only; the report rooms are held out.

Figures are means over scenes, right of column 128 and after rounding to the device's depth unit:

- `small`, `pins`: holes of less than 30 px, of at most 3 px. `isles`: pieces of depth below 30 px.
- `ragged`: pixels that a median of 5x5 px of the holes changes, per pixel of their outline.
- `holes`: pixels without depth [%]. `away`: the same, at least 2 px from the scanner's edges.
  `away_t`: the same where 8-bit codes hold texture.
- `band`: pieces of depth in the first 128 columns that do not reach column 128.
- `steps`, `jumps`: pairs of neighbours that differ by 0.5 to 2 px, by more.
- `bad1`: pixels off by more than 1 px from the scanner, away from its edges [%]. `textured`: the
  same where the 15x15 window's deviation is at least 0.5 DN, so that 8-bit codes hold texture.
- `nmad`, `agree`: spread of the error against the scanner, and against the device [px].
- `iou`: overlap with the device's holes. `near`: share of both's holes within 2 px of the other's.
- `rows 1` to `rows 6`: gaps of this width along rows, with a nearer surface on the left. `columns`:
  along columns, with a nearer surface below. The surfaces differ by more than 1.5 px.
- `noise`: deviation on walls over the device's. `x8`, `y8`: power over the device's on walls at
  periods of 8 to 20 px along rows, columns. `fine`: below 7 px along columns.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence

import cv2
import numpy as np
from match_faro import Scene, folder, scenes, setting_of
from numpy.typing import NDArray
from scipy import ndimage
from wall_noise import flat, off_plane, power

from starling.sim.metrics import LEFT_BAND_PX, MAD_TO_SIGMA, reached_pixels, scored_pixels
from starling.sim.sensor import edits, presets
from starling.sim.sensor.matcher import Matcher
from starling.sim.stereo.checks import moments
from starling.sim.stereo.matching import match

SMALL_PX = 30  # Smaller holes and islands are counted.
PIN_PX = 3
TEXTURED_DN = 0.5
FOCAL_BASELINE_PX_UNIT = 49470.45  # f b of the captures [px mm]; depth has a unit of 1 mm.
GAP_STEP_PX, WIDEST_GAP_PX = 1.5, 6
LONG, SHORT = slice(3, 7), slice(7, None)  # Waves in 48 px: periods of 7 to 20 px, and below.
_TOUCHING = np.ones((3, 3))


def matcher_of(text: str) -> Matcher:
    """Return the matcher of a preset or setting, with changes `key=value` of the sensor."""
    name, *changes = text.split()
    if not changes:
        return setting_of(name)
    return edits.apply(presets.load(name), changes).matcher


def rounded(disparity_px: NDArray) -> NDArray:
    """Round the depth of disparities (h, w) [px] to whole units, as the device's."""
    with np.errstate(invalid="ignore", divide="ignore"):
        code = np.rint(FOCAL_BASELINE_PX_UNIT / disparity_px)
        return (FOCAL_BASELINE_PX_UNIT / code).astype(np.float32)


def sizes(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the size of every piece of a mask; pieces touch at corners too [px]."""
    pieces, _ = ndimage.label(mask, _TOUCHING)  # pyright: ignore[reportGeneralTypeIssues]
    return np.bincount(pieces.ravel())[1:]


def stray_pieces(valid: NDArray[np.bool_]) -> int:
    """Count the pieces of valid pixels that do not reach the last column."""
    pieces, count = ndimage.label(valid, _TOUCHING)  # pyright: ignore[reportGeneralTypeIssues]
    return count - len(np.setdiff1d(pieces[:, -1], [0]))


def gap_counts(lines: NDArray) -> NDArray[np.intp]:
    """Count gaps of each width (widest,) along rows, where the disparity rises behind the gap."""
    counts = np.zeros(WIDEST_GAP_PX + 1, np.intp)
    for line in lines:
        place = np.flatnonzero(np.isfinite(line))
        widths = np.diff(place) - 1
        counted = (np.diff(line[place]) > GAP_STEP_PX) & (widths <= WIDEST_GAP_PX)
        counts += np.bincount(widths[counted], minlength=len(counts))
    return counts[1:]


def shape_figures(disparity_px: NDArray) -> dict[str, float]:
    """Return the figures of a map (h, w) alone."""
    right = disparity_px[:, LEFT_BAND_PX:]
    holes = np.isnan(right)
    hole_px = sizes(holes)
    outline = holes & (cv2.erode(holes.astype(np.uint8), _TOUCHING) == 0)
    changed = cv2.medianBlur(holes.astype(np.uint8), 5).astype(bool) != holes
    gaps = {"rows": gap_counts(right[:, ::-1]), "columns": gap_counts(right.T)}
    steps = np.concatenate([np.abs(np.diff(right, axis=axis)).ravel() for axis in (0, 1)])
    return {
        "small": float((hole_px < SMALL_PX).sum()),
        "pins": float((hole_px <= PIN_PX).sum()),
        "isles": float((sizes(~holes) < SMALL_PX).sum()),
        "ragged": changed.sum() / max(outline.sum(), 1),
        "holes": 100 * holes.mean(),
        "band": float(stray_pieces(np.isfinite(disparity_px[:, : LEFT_BAND_PX + 1]))),
        "steps": float(((steps > 0.5) & (steps <= 2)).sum()),
        "jumps": float((steps > 2).sum()),
        **{
            f"{name} {width + 1}": float(count)
            for name, counts in gaps.items()
            for width, count in enumerate(counts)
        },
    }


def error_figures(scene: Scene, disparity_px: NDArray) -> dict[str, float]:
    """Return the figures against scanner and device."""
    scored, reached = scored_pixels(scene.truth_px), reached_pixels(scene.truth_px)
    textured = moments(scene.left)[1] >= TEXTURED_DN**2
    error = disparity_px - scene.truth_px
    valid = scored & np.isfinite(error)
    ours, theirs = (np.isnan(each) & reached for each in (disparity_px, scene.device_px))
    wide = [cv2.dilate(each.astype(np.uint8), np.ones((5, 5))) > 0 for each in (ours, theirs)]
    shared = (ours & wide[1]).sum() + (theirs & wide[0]).sum()
    return {
        "away": 100 * np.isnan(disparity_px[scored]).mean(),
        "away_t": 100 * np.isnan(disparity_px[scored & textured]).mean(),
        "bad1": 100 * (np.abs(error[valid]) > 1).mean(),
        "textured": 100 * (np.abs(error[valid & textured]) > 1).mean(),
        "nmad": spread(error[valid]),
        "agree": spread((disparity_px - scene.device_px)[valid]),
        "iou": (ours & theirs).sum() / (ours | theirs).sum(),
        "near": shared / (ours.sum() + theirs.sum()),
    }


def spread(error: NDArray) -> float:
    """Return 1.4826 times the median absolute deviation of the finite values."""
    known = error[np.isfinite(error)]
    return MAD_TO_SIGMA * float(np.median(np.abs(known - np.median(known))))


def wall_figures(scene: Scene, disparity_px: NDArray) -> dict[str, float]:
    """Return noise and spectra over the device's, medians over walls; NaN without walls."""
    walls = flat(scene.truth_px, [scene.device_px, disparity_px])
    ratios = [wall_ratios(disparity_px[wall], scene.device_px[wall]) for wall in walls]
    medians = np.median(ratios, axis=0) if ratios else np.full(4, np.nan)
    return dict(zip(("noise", "x8", "y8", "fine"), medians, strict=True))


def wall_ratios(ours: NDArray, device: NDArray) -> list[float]:
    """Return the ratios of deviations, and of powers along rows and columns of a square."""
    first, second = off_plane(ours), off_plane(device)
    rows, columns = power(first), power(first.T)
    device_rows, device_columns = power(second), power(second.T)
    return [
        first.std() / second.std(),
        rows[LONG].sum() / device_rows[LONG].sum(),
        columns[LONG].sum() / device_columns[LONG].sum(),
        columns[SHORT].sum() / device_columns[SHORT].sum(),
    ]


def figures(scene: Scene, disparity_px: NDArray) -> dict[str, float]:
    """Return all figures of a map of a scene."""
    return (
        shape_figures(disparity_px)
        | error_figures(scene, disparity_px)
        | wall_figures(scene, disparity_px)
    )


def print_table(
    group: Sequence[Scene], maps: dict[str, Callable[[Scene], NDArray]], title: str
) -> None:
    """Print a row for each figure and a column for each map."""
    columns = [[figures(scene, depth(scene)) for scene in group] for depth in maps.values()]
    print(f"\n| {title} | {' | '.join(maps)} |\n{'| --- ' * (len(maps) + 1)}|")
    for name in columns[0][0]:
        means = [np.nanmean([row[name] for row in rows]) for rows in columns]
        cells = [f"{mean:.0f}" if mean >= 100 else f"{mean:.3g}" for mean in means]
        print(f"| {name} | {' | '.join(cells)} |")


def main() -> None:
    """Print a table of the choice rooms, then of the report rooms."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("settings", nargs="*", default=["d415"])
    parser.add_argument("--choice", action="store_true", help="leave the report rooms out")
    options = parser.parse_args()
    maps: dict[str, Callable[[Scene], NDArray]] = {"device": lambda scene: scene.device_px}
    for text in options.settings:
        setting = matcher_of(text)
        maps[text] = lambda scene, setting=setting: rounded(
            match(scene.left, scene.right, setting).disparity_px
        )
    captured = list(scenes(folder()))
    print_table([scene for scene in captured if scene.tuned], maps, "choice rooms")
    if not options.choice:
        print_table([scene for scene in captured if not scene.tuned], maps, "report rooms")


if __name__ == "__main__":
    main()
