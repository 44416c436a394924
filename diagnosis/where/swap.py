"""The stage swap: how much of the gap is the image's, how much the matcher's.

Three depth maps of one scene: simulated infrared by our matcher (A), real infrared by our matcher
(B), the device's own (C). B less A is what the simulated image lacks, C less B what our matcher and
post-processing do otherwise. No statistics are needed to part the two. Where two captures are
compared, A is the other capture's infrared by our matcher, and from C less B is taken what the
other device's own depth differs from A by.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.ground import Ground
from diagnosis.reading import Reading
from sim import metrics

_DRAWS = 1000
_LEVEL = 0.95


@dataclass(frozen=True, kw_only=True, slots=True)
class Part:
    """One figure along the chain, means over scenes."""

    base: float | None  # A; None where no infrared was captured that it would be made of.
    base_device: float | None  # The other device's own depth; None where A is simulated.
    rematched: float | None  # B; None where no infrared was captured.
    device: float | None  # C; None where no depth was captured.
    image: tuple[float, float, float] | None  # B - A: mean, low, high over scenes.
    matcher: tuple[float, float, float] | None  # C - B.

    @property
    def image_share(self) -> float | None:
        """Share of the image among both parts, by size, 0 to 1."""
        if self.image is None or self.matcher is None:
            return None
        one, other = abs(self.image[0]), abs(self.matcher[0])
        return one / (one + other) if one + other else None


FIGURES: dict[str, Callable[[NDArray, Ground], float]] = {
    "ndp_rate": lambda found, ground: float(np.mean(~np.isfinite(found[ground.counted]))),
    "bias_px": lambda found, ground: _figures(found, ground).bias_px,
    "nmad_px": lambda found, ground: _figures(found, ground).nmad_px,
    "bad1_pct": lambda found, ground: _figures(found, ground).bad1_pct,
}


def swap(
    base: Sequence[Reading], real: Sequence[Reading], grounds: Sequence[Ground]
) -> dict[str, Part]:
    """Measure A, B and C on every scene.

    Args:
        base: simulated readings, or other captures of the scenes.
        real: what was captured.
        grounds: of the scenes.
    """
    found = {}
    for name, figure in FIGURES.items():
        columns = [
            [_of(figure, maps, ground) for maps, ground in zip(column, grounds, strict=True)]
            for column in (
                [one.ours_px for one in base],
                [one.ours_px for one in real],
                [one.device_px for one in real],
                [one.device_px for one in base],
            )
        ]
        a, b, c, d = (np.array(column, float) for column in columns)
        own = d - a if np.isfinite(d).any() else np.zeros_like(a)
        found[name] = Part(
            base=_mean(a),
            base_device=_mean(d),
            rematched=_mean(b),
            device=_mean(c),
            image=_difference(b - a),
            matcher=_difference(c - b - own),
        )
    return found


def _figures(found: NDArray, ground: Ground) -> metrics.DisparityFigures:
    return metrics.disparity_figures(
        found, ground.disparity_px, metrics.scored_pixels(ground.disparity_px)
    )


def _of(figure: Callable[[NDArray, Ground], float], maps: NDArray | None, ground: Ground) -> float:
    return float("nan") if maps is None else figure(maps[0], ground)


def _mean(values: NDArray) -> float | None:
    return float(np.nanmean(values)) if np.isfinite(values).any() else None


def _difference(values: NDArray) -> tuple[float, float, float] | None:
    """Mean and its bootstrap interval over scenes."""
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    rng = np.random.default_rng(0)
    drawn = values[rng.integers(values.size, size=(_DRAWS, values.size))].mean(axis=1)
    low, high = np.quantile(drawn, ((1 - _LEVEL) / 2, (1 + _LEVEL) / 2))
    return float(values.mean()), float(low), float(high)
