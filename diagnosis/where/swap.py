"""The stage swap: how much of the gap is the image's, how much the matcher's.

Three depth maps of one scene: simulated infrared by our matcher (A), real infrared by our matcher
(B), the device's own (C). B less A is what the simulated image lacks, C less B what our matcher and
post-processing do otherwise. No statistics are needed to part the two. Where two captures are
compared, A is the other capture's infrared by our matcher. Where the base has depth of its own, as
its matcher reads bits that its images are put out without, what that differs from A by is taken
from C less B.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.scenes.rooms import FEWEST, draws, mean_interval
from starling.diagnosis.scenes.strata import Ground
from starling.sim import metrics

Difference = tuple[float, float | None, float | None]  # No ends where rooms are too few.

_DRAWS = 1000


@dataclass(frozen=True, kw_only=True, slots=True)
class Part:
    """One figure along the chain, means over scenes."""

    base: float | None  # A; None where no infrared was captured that it would be made of.
    base_device: float | None  # D: the base's own depth; None where it has none but A.
    rematched: float | None  # B; None where no infrared was captured.
    device: float | None  # C; None where no depth was captured.
    image: Difference | None  # B - A: mean over scenes, low and high over rooms.
    matcher: Difference | None  # C - B, less D - A where the base has depth of its own.

    @property
    def image_share(self) -> float | None:
        """Share of the image among both parts, by size, 0 to 1."""
        if self.image is None or self.matcher is None:
            return None
        one, other = abs(self.image[0]), abs(self.matcher[0])
        return one / (one + other) if one + other else None


FIGURES = ("ndp_rate", "bias_px", "nmad_px", "bad1_pct")


def swap(
    base: Sequence[Reading],
    real: Sequence[Reading],
    grounds: Sequence[Ground],
    rooms: Sequence[str],
) -> dict[str, Part]:
    """Measure A, B and C on every scene.

    Args:
        base: simulated readings, or other captures of the scenes.
        real: what was captured.
        grounds: of the scenes.
        rooms: likewise.
    """
    columns = [
        [_figures(maps, ground) for maps, ground in zip(column, grounds, strict=True)]
        for column in (
            [one.ours_px for one in base],
            [one.ours_px for one in real],
            [one.device_px for one in real],
            [one.device_px for one in base],
        )
    ]
    found = {}
    for name in FIGURES:
        a, b, c, d = (np.array([one[name] for one in column]) for column in columns)
        own = d - a if np.isfinite(d).any() else np.zeros_like(a)
        found[name] = Part(
            base=_mean(a),
            base_device=_mean(d),
            rematched=_mean(b),
            device=_mean(c),
            image=_difference(b - a, rooms),
            matcher=_difference(c - b - own, rooms),
        )
    return found


def _figures(maps: NDArray | None, ground: Ground) -> dict[str, float]:
    """`FIGURES` of the first map; NaN of none, and of errors where no pixel is scored."""
    told: dict[str, float] = dict.fromkeys(FIGURES, float("nan"))
    if maps is None:
        return told
    told["ndp_rate"] = float(np.mean(~np.isfinite(maps[0][ground.counted])))
    scored = metrics.scored_pixels(ground.disparity_px)
    if scored.any():
        errors = metrics.disparity_figures(maps[0], ground.disparity_px, scored)
        told |= {name: float(getattr(errors, name)) for name in FIGURES[1:]}
    return told


def _mean(values: NDArray) -> float | None:
    return float(np.nanmean(values)) if np.isfinite(values).any() else None


def _difference(values: NDArray, rooms: Sequence[str]) -> Difference | None:
    """Mean over scenes and its bootstrap interval over rooms."""
    known = np.isfinite(values)
    if not known.any():
        return None
    values, rooms = values[known], [room for room, one in zip(rooms, known, strict=True) if one]
    mean = float(values.mean())
    if len(set(rooms)) < FEWEST:
        return mean, None, None
    times = draws(rooms, _DRAWS, np.random.default_rng(0))
    low, high = mean_interval(values, times, len(set(rooms)))
    return mean, float(low), float(high)
