"""Expected error of completed depth, calibrated in rooms that the network was not trained on.

In quadrature: the network's own sigma times a factor, and the change of depth over a lateral
shift. The second term widens sigma on grazing surfaces and at depth edges, where an error of
position becomes an error of depth. Both numbers depend on the group of the pixel.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path

import cv2
import numpy as np

from starling.learning.completion.method import LEVELS, Image, Mask
from starling.patterns.errors import in_interval, naming, refuse
from starling.sim import files
from starling.sim.console import output
from starling.sim.sensor import structure

FILE = "sigma.json"  # Next to the weights. Without it, sigma is the network's own.
_WINDOW_PX = 31  # Side of the square over which the slope of estimated depth is averaged [px].
_WIDEST = 1e3  # Largest factor, shift [px] and half-width [sigma].


@dataclass(frozen=True, kw_only=True, slots=True)
class GroupError:
    """Expected error of one group of pixels."""

    scale: float = 1.0  # Factor of the network's sigma.
    shift_px: float = 0.0  # Lateral shift that causes the change of depth [px].
    # Half-widths of the conformal intervals that hold 68 and 95 % of a room's errors [sigma].
    half_68: float | None = None
    half_95: float | None = None

    def __post_init__(self) -> None:
        in_interval("scale", self.scale, 1 / _WIDEST, _WIDEST)
        in_interval("shift_px", self.shift_px, 0, _WIDEST)
        for name in ("half_68", "half_95"):
            if getattr(self, name) is not None:
                in_interval(name, getattr(self, name), 0, _WIDEST)
        if (self.half_68 is None) != (self.half_95 is None):
            got = f"{self.half_68} and {self.half_95}"
            raise refuse("half_68 and half_95", "must come together", got, "Give both or none.")
        if self.half_68 is not None and self.half_95 is not None and self.half_68 > self.half_95:
            got = f"{self.half_68:g} and {self.half_95:g}"
            raise refuse("half_68", "must be at most half_95", got, "Swap them.")


@dataclass(frozen=True, kw_only=True, slots=True)
class ExpectedError:
    """Expected error by group."""

    hole: GroupError = field(default_factory=GroupError)  # Holes with depth on both sides.
    border: GroupError = field(default_factory=GroupError)  # Holes that end at the image border.
    measured: GroupError = field(default_factory=GroupError)  # The camera's own depth.
    replaced: GroupError = field(default_factory=GroupError)  # Depth that replaces the camera's.


GROUPS = tuple(item.name for item in fields(ExpectedError))


def group_masks(valid: Mask, measured: Mask) -> dict[str, Mask]:
    """Return the pixels (h, w) of each of `GROUPS`.

    Args:
        valid: (h, w) True where the camera has depth.
        measured: (h, w) True where the result is the camera's own depth.
    """
    left = np.logical_or.accumulate(valid, axis=1)
    right = np.logical_or.accumulate(valid[:, ::-1], axis=1)[:, ::-1]
    between = left & right
    return {
        "hole": ~valid & between,
        "border": ~between,
        "measured": valid & measured,
        "replaced": valid & ~measured,
    }


def change_m(depth_m: Image, group: str) -> Image:
    """Change of depth over a shift by one pixel (h, w) [m].

    The camera's own depth is resolved to a few pixels, so that the slope at the pixel counts.
    Estimated depth is smooth; the mean slope around the pixel counts.
    """
    logarithm = np.log(depth_m)
    across, down = (
        cv2.Sobel(logarithm, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1))
    )
    slope = np.hypot(across, down)
    if group != "measured":
        slope = np.asarray(cv2.blur(slope, (_WINDOW_PX, _WINDOW_PX)))
    return (slope * depth_m).astype(np.float32)


def calibrated(
    error: ExpectedError, depth_m: Image, own_sigma_m: Image, masks: Mapping[str, Mask]
) -> tuple[Image, dict[int, Image]]:
    """Return sigma (h, w) [m] and the half-widths of the intervals by level, see `Completed`.

    Args:
        error: the calibration.
        depth_m: (h, w) completed depth [m].
        own_sigma_m: (h, w) sigma of the network [m].
        masks: see `group_masks`.
    """
    sigma_m = np.full(depth_m.shape, np.nan, np.float32)
    halves = {level: sigma_m.copy() for level in LEVELS}
    for name, where in masks.items():
        group: GroupError = getattr(error, name)
        change = change_m(depth_m, name)[where] if group.shift_px else np.float32(0)
        sigma = np.hypot(group.scale * own_sigma_m[where], group.shift_px * change)
        sigma_m[where] = sigma
        for level in LEVELS:
            half = getattr(group, f"half_{level}")
            halves[level][where] = np.nan if half is None else half * sigma
    known = {level: half for level, half in halves.items() if np.isfinite(half).any()}
    return sigma_m, known


def save(error: ExpectedError, path: Path) -> None:
    """Write the calibration to a file; an existing one is replaced.

    Raises:
        InputError: if it cannot be written.
    """
    text = json.dumps(structure.to_table(error), indent=2) + "\n"
    output.write_file(path, text.encode(), force=True)


def load(folder: Path) -> ExpectedError:
    """Read the calibration next to the weights; without a file, sigma is the network's own.

    Raises:
        InputError: if the file is damaged or has values out of range.
    """
    path = folder / FILE
    if not path.is_file():
        return ExpectedError()
    table = files.parse_json(files.read_bytes(path), path)
    with naming(path):
        return structure.from_table(ExpectedError, table)
