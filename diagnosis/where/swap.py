"""Stage ablation: the contributions of images and of matcher and filters to the gap.

Three depth maps are compared: our matcher on simulated infrared (A), our matcher on real infrared
(B), and the device's own depth (C). B - A is the contribution of the images, C - B
that of matcher and filters. If two captures are compared, A is our matcher on the other capture.
The base may have its own depth (D), because its matcher reads bits that stored images lack. Then
D - A is subtracted from C - B.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.observation import (
    DepthObservation,
    Maps,
    SceneObservation,
    StereoObservation,
)
from starling.diagnosis.scenes.rooms import FEWEST, mean_interval, resample_rooms
from starling.diagnosis.scenes.strata import Strata
from starling.sim import metrics

Difference = tuple[
    float, float | None, float | None
]  # Mean, low, high; no interval with too few rooms.

_DRAWS = 1000


@dataclass(frozen=True, kw_only=True, slots=True)
class StageFigures:
    """One figure at each stage, mean over scenes."""

    base: float | None  # A; None without captured infrared.
    base_device: float | None  # D, the base's own depth; None if it equals A.
    rematched: float | None  # B; None without captured infrared.
    device: float | None  # C; None without captured depth.
    image: Difference | None  # B - A: mean over scenes, interval over rooms.
    matcher: Difference | None  # C - B, minus D - A if the base has its own depth.

    @property
    def image_share(self) -> float | None:
        """Share of the images in the sum of both absolute contributions, 0 to 1."""
        if self.image is None or self.matcher is None:
            return None
        image, matcher = abs(self.image[0]), abs(self.matcher[0])
        return image / (image + matcher) if image + matcher else None


FIGURES = ("ndp_rate", "bias_px", "nmad_px", "bad1_pct")


def stage_figures(
    base: Sequence[SceneObservation],
    real: Sequence[SceneObservation],
    scene_strata: Sequence[Strata],
    rooms: Sequence[str],
) -> dict[str, StageFigures]:
    """Measure A, B and C on every scene.

    Args:
        base: simulated observations, or other captures of the scenes.
        real: captured observations.
        scene_strata: pixel strata of each scene.
        rooms: room of each scene.
    """
    columns = [
        [_figures(maps, strata) for maps, strata in zip(column, scene_strata, strict=True)]
        for column in (
            [_ours(observation) for observation in base],
            [_ours(observation) for observation in real],
            [_device(observation) for observation in real],
            [_device(observation) for observation in base],
        )
    ]
    stages = {}
    for name in FIGURES:
        a, b, c, d = (np.array([values[name] for values in column]) for column in columns)
        base_offset = d - a if np.isfinite(d).any() else np.zeros_like(a)
        stages[name] = StageFigures(
            base=_mean(a),
            base_device=_mean(d),
            rematched=_mean(b),
            device=_mean(c),
            image=_difference(b - a, rooms),
            matcher=_difference(c - b - base_offset, rooms),
        )
    return stages


def _ours(observation: SceneObservation) -> Maps | None:
    return observation.ours_px if isinstance(observation, StereoObservation) else None


def _device(observation: SceneObservation) -> Maps | None:
    return observation.device_px if isinstance(observation, DepthObservation) else None


def _figures(maps: NDArray | None, strata: Strata) -> dict[str, float]:
    """Return `FIGURES` of the first map; NaN without a map, or for errors without scored pixels."""
    figures: dict[str, float] = dict.fromkeys(FIGURES, float("nan"))
    if maps is None:
        return figures
    figures["ndp_rate"] = float(np.mean(~np.isfinite(maps[0][strata.counted])))
    scored = metrics.scored_pixels(strata.disparity_px)
    if scored.any():
        errors = metrics.disparity_figures(maps[0], strata.disparity_px, scored)
        figures |= {name: float(getattr(errors, name)) for name in FIGURES[1:]}
    return figures


def _mean(values: NDArray) -> float | None:
    return float(np.nanmean(values)) if np.isfinite(values).any() else None


def _difference(values: NDArray, rooms: Sequence[str]) -> Difference | None:
    """Return the mean over scenes and its bootstrap interval over rooms."""
    known = np.isfinite(values)
    if not known.any():
        return None
    values, rooms = (
        values[known],
        [room for room, is_known in zip(rooms, known, strict=True) if is_known],
    )
    mean = float(values.mean())
    if len(set(rooms)) < FEWEST:
        return mean, None, None
    times = resample_rooms(rooms, _DRAWS, np.random.default_rng(0))
    low, high = mean_interval(values, times, len(set(rooms)))
    return mean, float(low), float(high)
