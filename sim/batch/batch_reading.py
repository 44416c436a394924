"""Results of a batch; this module needs no Warp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class BatchReading:
    """Readings of n environments, as torch tensors or Warp arrays on the device of the depth."""

    depth_m: Any  # (n, h, w) float32, NaN where missing.
    reason: Any  # (n, h, w) uint8, codes of `starling.Reason`; 0 if and only if there is depth.
    ir_left: Any  # (n, h, w) uint8; int32 of imagers with more than 8 bits.
    ir_right: Any  # Same.
    exposure_s: Any  # (n,) float32
    gain: Any  # (n,) float32
