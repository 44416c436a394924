"""Share of a gap that no known effect explains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.diagnosis.howfar.evaluation import Evaluation
from starling.diagnosis.which.segment import SegmentResult

_NOTABLE = 0.05  # Share from which a remainder is located.


@dataclass(frozen=True, kw_only=True, slots=True)
class Remainder:
    """What no known effect explains of the gap in one segment."""

    share: float | None  # Share of the gap beyond noise, 0 to 1; None without an evident gap.
    interval: tuple[float, float] | None  # 95 %, over held-out rooms.

    @property
    def notable(self) -> bool:
        """Whether the remainder is large enough to be located."""
        return self.share is not None and self.share >= _NOTABLE


def remainder(segment: SegmentResult, reported: bool, evaluation: Evaluation | None) -> Remainder:
    """Measure the remainder on held-out scenes, or on the training scenes without any.

    Args:
        segment: segment with its accepted effects.
        reported: whether any of them is reported as an effect.
        evaluation: figures of the reported effects on held-out scenes.
    """
    before, _ = segment.sizes
    if before <= segment.explained_below:
        return Remainder(share=None, interval=None)
    if not reported:
        return Remainder(share=1.0, interval=None)
    name = f"features of the {segment.table.segment.value}"
    figure = None if evaluation is None else evaluation.figures.get(name)
    if figure is None or figure.closed_pct is None:
        noise = segment.screening.noise
        share = (segment.unexplained_size - noise) / max(before - noise, 1e-9)
        return Remainder(share=float(np.clip(share, 0, 1)), interval=None)
    left = [1 - percent / 100 for percent in (figure.closed_pct, *(figure.interval or ())[::-1])]
    share, *ends = np.clip(left, 0, 1).tolist()
    return Remainder(share=share, interval=(ends[0], ends[1]) if ends else None)
