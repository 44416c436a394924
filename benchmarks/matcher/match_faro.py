"""Compare the matcher with the device's depth on the infrared pairs of 15 real D415 scenes.

    python benchmarks/matcher/match_faro.py d4xx fast d415
    python benchmarks/matcher/match_faro.py d4xx --border 0 3 5 7 9

Arguments are names of matcher settings or sensor presets.
Captures: `d415-faro` in the folder $STARLING_CAPTURES. Errors refer to the laser scanner; agreement
compares our depth with the device's. Settings were chosen on the tuned rooms only.

With --border, the script prints the share of our matches that have device depth, by the column of
the match in the right image. It also prints the overlap of both depths' holes, by excluded border.
"""

from __future__ import annotations

import argparse
import os
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim.metrics import DisparityFigures, disparity_figures, reached_pixels, scored_pixels
from starling.sim.sensor import presets
from starling.sim.sensor.matcher import FAST, Matcher, SemiGlobalBlock, named
from starling.sim.stereo.matching import DisparityMap, match

TUNED_ROOMS = frozenset({"0060", "1982", "4426", "6422", "g"})  # Every second room in sorted order.
NEAR_PX = 30  # Number of columns of the right image with separate counts.
COLUMNS = ("bias_px", "nmad_px", "bad1_pct", "fill", "ndp_iou")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scene:
    """One scene: the pair (h, w) uint8, and disparities (h, w) [px], NaN where unknown."""

    name: str
    tuned: bool
    left: NDArray
    right: NDArray
    device_px: NDArray
    truth_px: NDArray


def folder() -> Path:
    """Return the folder of the scenes; it may not exist."""
    return Path(os.environ.get("STARLING_CAPTURES", "")) / "d415-faro"


def scenes(where: Path) -> Iterator[Scene]:
    """Yield the scenes in the order of their names."""
    info = tomllib.loads((where / "capture.toml").read_text())
    focal_baseline = info["fx_px"] * info["baseline_m"]
    for path in sorted(entry for entry in where.iterdir() if entry.is_dir()):
        disparity = {}
        for key, file in (("device_px", "0/depth.png"), ("truth_px", "truth.png")):
            depth = cv2.imread(str(path / file), cv2.IMREAD_UNCHANGED) * info["depth_unit_m"]
            disparity[key] = np.full(depth.shape, np.nan, np.float32)
            disparity[key][depth > 0] = focal_baseline / depth[depth > 0]
        yield Scene(
            name=path.name,
            tuned=(path / "room").read_text().strip() in TUNED_ROOMS,
            left=cv2.imread(str(path / "0/ir_left.png"), cv2.IMREAD_UNCHANGED),
            right=cv2.imread(str(path / "0/ir_right.png"), cv2.IMREAD_UNCHANGED),
            **disparity,
        )


def measure(scene: Scene, setting: Matcher) -> dict[str, DisparityFigures]:
    """Score device and matcher against the reference, and the matcher against the device."""
    ours = match(scene.left, scene.right, setting).disparity_px
    scored, reached = scored_pixels(scene.truth_px), reached_pixels(scene.truth_px)
    return {
        "device": disparity_figures(scene.device_px, scene.truth_px, scored),
        "ours": disparity_figures(ours, scene.truth_px, scored),
        "agreement": disparity_figures(
            ours, scene.device_px, scored, holes_of_px=scene.device_px, holes_where=reached
        ),
    }


def medians(rows: list[dict[str, DisparityFigures]]) -> dict[str, dict[str, float]]:
    """Return the median over scenes of each figure."""
    return {
        kind: {
            column: float(np.median([getattr(row[kind], column) for row in rows]))
            for column in COLUMNS
            if getattr(rows[0][kind], column) is not None
        }
        for kind in rows[0]
    }


def _line(label: str, figures: dict[str, dict[str, float]]) -> str:
    cells = [
        f"{kind[:6]:>7} " + " ".join(f"{value:7.3f}" for value in figures[kind].values())
        for kind in figures
    ]
    return f"{label:12}" + " |".join(cells)


def setting_of(name: str) -> Matcher:
    """Return the matcher of a sensor preset, or a named matcher setting."""
    return presets.load(name).matcher if name in presets.names() else named(name)


def _table(name: str, where: Path) -> None:
    print(f"\n{name}: bias px, NMAD px, off > 1 px %, fill (, no-depth IoU)")
    setting = setting_of(name)
    rows = [(scene, measure(scene, setting)) for scene in scenes(where)]
    for scene, row in rows:
        print(_line(scene.name + (" tuned" if scene.tuned else ""), medians([row])))
    groups = {
        "tuned": [row for scene, row in rows if scene.tuned],
        "held out": [row for scene, row in rows if not scene.tuned],
        "all": [row for _, row in rows],
    }
    for label, group in groups.items():
        print(_line(label, medians(group)))


def _borders(name: str, where: Path, widths: list[float]) -> None:
    setting = setting_of(name)
    settings = {
        width: replace(setting, checks=replace(setting.checks, border_px=width)) for width in widths
    }
    counts = {True: np.zeros((2, NEAR_PX)), False: np.zeros((2, NEAR_PX))}
    overlaps: dict[bool, list[list[float]]] = {True: [], False: []}
    for scene in scenes(where):
        counts[scene.tuned] += _kept_by_column(scene, match(scene.left, scene.right, setting))
        known, device = np.isfinite(scene.truth_px), np.isfinite(scene.device_px)
        valid = [
            match(scene.left, scene.right, valid_mask).valid for valid_mask in settings.values()
        ]
        overlaps[scene.tuned].append(
            [
                np.sum(known & ~(valid_mask | device)) / np.sum(known & ~(valid_mask & device))
                for valid_mask in valid
            ]
        )
    for tuned, label in ((True, "tuned"), (False, "held out")):
        shared, total = counts[tuned]
        print(f"\n{name}, {label}: share of ours that the device has, by column x - d")
        print(" ".join(f"{share:.2f}" for share in shared / total))
        print("no-depth IoU in all columns, mean over scenes, by border [px]")
        means = np.mean(overlaps[tuned], axis=0)
        print(
            ", ".join(f"{width:g}: {value:.3f}" for width, value in zip(widths, means, strict=True))
        )


def _kept_by_column(scene: Scene, ours: DisparityMap) -> NDArray:
    """Count our matches with device depth, and all our matches (2, NEAR_PX), by column."""
    column = np.arange(ours.valid.shape[1]) - np.where(ours.valid, ours.disparity_px, -NEAR_PX)
    columns = np.arange(NEAR_PX + 1) - 0.5
    both = ours.valid & np.isfinite(scene.device_px)
    return np.stack([np.histogram(column[these], columns)[0] for these in (both, ours.valid)])


def _seconds(call, repeats: int = 5) -> float:
    """Return the minimum time of several calls after a warm-up call [s]."""
    call()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def _timings(names: list[str], scene: Scene) -> None:
    plain = FAST.engine
    assert isinstance(plain, SemiGlobalBlock)
    bare = cv2.StereoSGBM.create(
        0, 128, plain.block_px, plain.small_penalty, plain.large_penalty, 1, 0, 10, 100, 2,
        cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    baseline_s = _seconds(lambda: bare.compute(scene.left, scene.right))
    print(f"\nbare StereoSGBM 3WAY {baseline_s:.3f} s")
    for name in names:
        setting = setting_of(name)
        seconds = _seconds(lambda setting=setting: match(scene.left, scene.right, setting))
        print(f"{name:6} {seconds:.3f} s = {seconds / baseline_s:.2f} x")


def main() -> None:
    """Print the table of each setting, then the times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("settings", nargs="*", default=["d4xx"])
    parser.add_argument("--border", nargs="+", type=float, metavar="PX")
    options = parser.parse_args()
    where = folder()
    if not where.is_dir():
        raise SystemExit(f"no captures at {where}; set STARLING_CAPTURES to their folder")
    for name in options.settings:
        if options.border:
            _borders(name, where, options.border)
        else:
            _table(name, where)
    if not options.border:
        _timings(options.settings, next(scenes(where)))


if __name__ == "__main__":
    main()
