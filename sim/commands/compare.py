"""Figures of `starling compare`: the difference between simulated and real captures."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import metrics
from starling.sim.captures.capture import CapturedScene, CaptureSet, Frame
from starling.sim.captures.png import GreyImage
from starling.sim.console import progress

# Side of a window for dot contrast [px]. Dots are 6 px apart on a D415, about 14 px on a D435.
_WINDOW_PX = 16

_DARKEST_DN = 2.0  # Below this mean signal, quantisation dominates a window [DN].


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Reading:
    """The first frame of a scene, with its reference depth."""

    scene: CapturedScene
    frame: Frame
    truth_m: NDArray[np.float32] | None

    @property
    def disparity_px(self) -> NDArray[np.float32] | None:
        return self._disparity(self.frame.depth_m)

    @property
    def truth_px(self) -> NDArray[np.float32] | None:
        return self._disparity(self.truth_m)

    def _disparity(self, depth_m: NDArray[np.float32] | None) -> NDArray[np.float32] | None:
        return None if depth_m is None else self.scene.info.disparity_px(depth_m)


def compare(
    real: CaptureSet, sim: CaptureSet, *, track: progress.Progress = progress.silent
) -> dict[str, Any]:
    """Compare the first frames of the scenes that both sets hold.

    The figures, if a set holds the necessary data:

    - `ndp_rate`: share of no-depth pixels (NDP) at columns >= 128. If the real set has reference
      depth, only pixels with known reference count.
    - `ndp_iou`: intersection over union of the simulated and the real NDP mask, on the same
      pixels. The real mask has 1 with itself.
    - `nmad_px`: 1.4826 x median absolute deviation of the disparity error, each set against its
      reference, at columns >= 128 and more than 2 px from depth edges.
    - `dot_contrast`: `starling.sim.commands.compare.dot_contrast` of the left image.
    - `mean_dn`: mean of the left image, black level included [DN].

    Args:
        real: captures of a device.
        sim: simulated captures of the same scenes, with the same image size.
        track: wraps the loop over scenes.

    Returns:
        `{"metrics": {NAME: {"real", "sim", "gap"}}, "scenes": {SCENE: {NAME: {...}}},
        "only_real": [...], "only_sim": [...]}`; gap = sim - real. `metrics` holds medians over
        the scenes and their difference. Figures without data are NaN.

    Raises:
        InputError: if no scene is in both sets, image sizes differ, or an image is refused.
    """
    pairs = pair_scenes(real, sim)
    scenes = {a.name: _compare_scene(a, b) for a, b in track(pairs, "compare")}
    names = {scene.name for scene, _ in pairs}
    return {
        "metrics": _medians(scenes),
        "scenes": scenes,
        "only_real": [scene.name for scene in real.scenes if scene.name not in names],
        "only_sim": [scene.name for scene in sim.scenes if scene.name not in names],
    }


def pair_scenes(
    real: CaptureSet, sim: CaptureSet
) -> tuple[tuple[CapturedScene, CapturedScene], ...]:
    """Pair scenes by name; two sets with a single scene each are paired regardless of names.

    Raises:
        InputError: if no scene is in both sets.
    """
    if len(real.scenes) == len(sim.scenes) == 1:
        return ((real.scenes[0], sim.scenes[0]),)
    second = {scene.name: scene for scene in sim.scenes}
    pairs = tuple((scene, second[scene.name]) for scene in real.scenes if scene.name in second)
    if not pairs:
        raise errors.refuse(
            "the two capture sets",
            "must have a scene in common",
            f"{', '.join(s.name for s in real.scenes)} and {', '.join(second)}",
            "Simulate the scenes of the first set.",
        )
    return pairs


def _compare_scene(real: CapturedScene, sim: CapturedScene) -> dict[str, dict[str, float]]:
    if real.info.shape != sim.info.shape:
        raise errors.refuse(
            f"{real.name}, real and simulated,",
            "must have one image size",
            f"{real.info.shape} and {sim.info.shape}",
            "Simulate with the geometry of the captures.",
        )
    if not real.info.are_of(sim.info):
        message = f"{real.name}: focal length, centre or baseline of real and simulated differ."
        warnings.warn(message, stacklevel=2)
    a, b = (
        _Reading(scene=scene, frame=scene.frame(scene.frames[0]), truth_m=scene.truth_m())
        for scene in (real, sim)
    )
    reached = _reached(a)
    values = {
        "ndp_rate": (_ndp_rate(a, reached), _ndp_rate(b, reached)),
        "ndp_iou": (1.0, _ndp_iou(a, b, reached)),
        "nmad_px": (_nmad_px(a), _nmad_px(b)),
        "dot_contrast": (_contrast(a), _contrast(b)),
        "mean_dn": (_mean_dn(a), _mean_dn(b)),
    }
    return {name: _side_by_side(*pair) for name, pair in values.items()}


def _medians(scenes: Mapping[str, Mapping[str, Mapping[str, float]]]) -> dict[str, Any]:
    names = next(iter(scenes.values()))
    return {
        name: _side_by_side(
            *(_median([scene[name][side] for scene in scenes.values()]) for side in ("real", "sim"))
        )
        for name in names
    }


def _median(values: list[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(np.median(known)) if known else math.nan


def _side_by_side(real: float, sim: float) -> dict[str, float]:
    return {"real": real, "sim": sim, "gap": sim - real}


def _reached(reading: _Reading) -> NDArray[np.bool_]:
    """Mask (h, w) of pixels within the search range and, if a reference exists, known there."""
    truth = reading.truth_px
    return metrics.reached_pixels(np.zeros(reading.scene.info.shape) if truth is None else truth)


def _ndp_rate(reading: _Reading, reached: NDArray[np.bool_]) -> float:
    if reading.frame.depth_m is None or not reached.any():
        return math.nan
    return float(np.isnan(reading.frame.depth_m[reached]).mean())


def _ndp_iou(a: _Reading, b: _Reading, reached: NDArray[np.bool_]) -> float:
    if a.frame.depth_m is None or b.frame.depth_m is None:
        return math.nan
    return metrics.hole_overlap(a.frame.depth_m, b.frame.depth_m, reached)


def _nmad_px(reading: _Reading) -> float:
    disparity_px, truth_px = reading.disparity_px, reading.truth_px
    if disparity_px is None or truth_px is None:
        return math.nan
    scored = metrics.scored_pixels(truth_px)
    return (
        metrics.disparity_figures(disparity_px, truth_px, scored).nmad_px
        if scored.any()
        else math.nan
    )


def _contrast(reading: _Reading) -> float:
    if reading.frame.ir_left is None:
        return math.nan
    return dot_contrast(reading.frame.ir_left, reading.scene.info.black_level_dn or 0.0)


def _mean_dn(reading: _Reading) -> float:
    return math.nan if reading.frame.ir_left is None else float(reading.frame.ir_left.mean())


def dot_contrast(infrared: GreyImage, black_level_dn: float = 0.0) -> float:
    """Median over windows of the Michelson contrast (max - min) / (max + min).

    The image is cut into windows of 16 x 16 px that do not overlap. In each window, min and max
    are the 5th and 95th percentile of the signal above the black level. True extremes would
    measure the noise of single pixels. Dark windows (mean below 2 DN) are left out. Texture and
    noise contribute too, so the dots' own contribution is the difference to an image with the
    projector off.

    Args:
        infrared: (h, w).
        black_level_dn: pedestal of the image [DN].

    Returns:
        Contrast in [0, 1]; NaN if every window is dark.
    """
    windows = _windows(infrared.astype(np.float32) - np.float32(black_level_dn))
    windows = np.maximum(windows[windows.mean(axis=1) >= _DARKEST_DN], 0.0)
    if len(windows) == 0:
        return float("nan")
    low, high = np.percentile(windows, (5, 95), axis=1)
    return float(np.median((high - low) / (high + low)))


def _windows(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Cut (h, w) into (n, window^2); incomplete windows at the right and bottom are dropped."""
    size = min(_WINDOW_PX, *image.shape)
    rows, columns = (length // size for length in image.shape)
    cut = image[: rows * size, : columns * size].reshape(rows, size, columns, size)
    return cut.swapaxes(1, 2).reshape(rows * columns, size * size)
