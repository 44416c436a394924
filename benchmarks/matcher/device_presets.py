"""Compare the holes of our matcher under each device preset with those of a real D415.

    python benchmarks/matcher/device_presets.py [default high_accuracy ...] [--pictures FOLDER]

Captures: `d415-faro` in the folder $STARLING_CAPTURES. No-depth pixels are compared on pixels with
a reference, right of column 128. Agreement compares our depth with the device's, away from depth
edges. These figures were not used for tuning; rooms are split as in docs/results/matcher.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import match_faro
import numpy as np
from numpy.typing import NDArray

from starling.sim.metrics import disparity_figures, reached_pixels, scored_pixels
from starling.sim.sensor import realsense
from starling.sim.sensor.presets import load
from starling.sim.sensor.realsense import controls
from starling.sim.stereo.matching import match

HEAD = "NDP rate, IoU with the device's, ours only, device's only; NMAD px, off > 1 px %"


@dataclass(frozen=True, kw_only=True, slots=True)
class Row:
    """One preset on one scene."""

    room: str
    tuned: bool
    rate: float  # Share of no-depth pixels.
    overlap: float
    ours_only: float  # Share of pixels without depth in our map only.
    device_only: float
    nmad_px: float
    off_pct: float


def measure(scene: match_faro.Scene, ours_px: NDArray, room: str) -> Row:
    """Compare our map with the device's."""
    reached = reached_pixels(scene.truth_px)
    ours, theirs = ~np.isfinite(ours_px[reached]), ~np.isfinite(scene.device_px[reached])
    figures = disparity_figures(
        ours_px,
        scene.device_px,
        scored_pixels(scene.truth_px),
        holes_of_px=scene.device_px,
        holes_where=reached,
    )
    assert figures.ndp_iou is not None
    return Row(
        room=room,
        tuned=scene.tuned,
        rate=float(ours.mean()),
        overlap=figures.ndp_iou,
        ours_only=float((ours & ~theirs).mean()),
        device_only=float((theirs & ~ours).mean()),
        nmad_px=figures.nmad_px,
        off_pct=figures.bad1_pct,
    )


def line(label: str, rows: list[Row]) -> str:
    """Format medians over scenes as one line."""

    def median(key: Callable[[Row], float]) -> float:
        return float(np.median([key(row) for row in rows]))

    return (
        f"{label:28}{median(lambda r: r.rate):8.4f}{median(lambda r: r.overlap):7.3f}"
        f"{median(lambda r: r.ours_only):8.4f}{median(lambda r: r.device_only):8.4f}"
        f"{median(lambda r: r.nmad_px):7.3f}{median(lambda r: r.off_pct):7.2f}"
    )


def _table(results: dict[str, list[Row]]) -> None:
    splits: dict[str, Callable[[Row], bool]] = {
        "tuned rooms": lambda row: row.tuned,
        "held-out rooms": lambda row: not row.tuned,
        "all rooms": lambda row: True,
    }
    rooms = sorted({row.room for rows in results.values() for row in rows})
    splits |= {f"room {room}": (lambda row, room=room: row.room == room) for room in rooms}
    print(HEAD)
    for title, inside in splits.items():
        print(f"\n{title}")
        for name, rows in results.items():
            print(line(name, [row for row in rows if inside(row)]))


def _picture(scene: match_faro.Scene, maps: dict[str, NDArray], folder: Path) -> None:
    """Write the left image and, for each map, its holes in white over that image."""
    tiles = [cv2.cvtColor(cv2.convertScaleAbs(scene.left, alpha=3), cv2.COLOR_GRAY2BGR)]
    for name, disparity in maps.items():
        tile = tiles[0].copy() // 2
        tile[~np.isfinite(disparity)] = (255, 255, 255)
        cv2.putText(tile, name, (20, 60), cv2.FONT_HERSHEY_SIMPLEX, 2, (0, 0, 255), 4)
        tiles.append(tile)
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % 3)
    rows = [cv2.hconcat(tiles[i : i + 3]) for i in range(0, len(tiles), 3)]
    folder.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(
        str(folder / f"{scene.name}.png"), cv2.resize(cv2.vconcat(rows), None, fx=0.4, fy=0.4)
    )


def main() -> None:
    """Print the tables; with --pictures, write one picture of the holes per scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("presets", nargs="*", default=controls.preset_names())
    parser.add_argument("--pictures", type=Path)
    options = parser.parse_args()
    where = match_faro.folder()
    if not where.is_dir():
        raise SystemExit(f"no captures at {where}; set STARLING_CAPTURES to their folder")
    base = load("d415")
    settings = {name: realsense.with_preset(base, name)[0].matcher for name in options.presets}
    results: dict[str, list[Row]] = {"device": [], **{name: [] for name in settings}}
    for scene in match_faro.scenes(where):
        maps = {"device": scene.device_px} | {
            name: match(scene.left, scene.right, setting).disparity_px
            for name, setting in settings.items()
        }
        room = (where / scene.name / "room").read_text().strip()
        for name, disparity in maps.items():
            results[name].append(measure(scene, disparity, room))
        if options.pictures:
            _picture(scene, maps, options.pictures)
    _table(results)


if __name__ == "__main__":
    main()
