"""The nearest pixel that has depth."""

from __future__ import annotations

from dataclasses import dataclass

from starling.learning.completion.classical.outcome import completed, trusted
from starling.learning.completion.frame import CompletionFrame
from starling.learning.completion.method import Completed
from starling.sim.arrays import filled


@dataclass(frozen=True, kw_only=True, slots=True)
class Nearest:
    """Fills each hole pixel with the depth of the nearest valid pixel in the image."""

    @property
    def name(self) -> str:
        """`nearest`."""
        return "nearest"

    def fill(self, frame: CompletionFrame) -> Completed:
        """Complete a frame; valid pixels stay as they are."""
        return completed(frame, filled(frame.depth_m, trusted(frame)))
