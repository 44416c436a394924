"""Pictures of an evaluation: the frames with the greatest errors of the last method in holes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from starling.learning.completion.data.pairs import Pair
from starling.learning.completion.method import Image
from starling.sim.plotting import panels, sheet
from starling.sim.plotting.sheet import Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHOWN = 3  # Number of frames.
_ERROR_M = 0.5  # Error that is drawn black [m].


@dataclass(slots=True)
class WorstFrames:
    """Keeps the frames with the greatest mean error of the last method in holes."""

    frames: list[tuple[float, Pair, Mapping[str, Image]]] = field(default_factory=list)

    def add(self, pair: Pair, completed: Mapping[str, Image]) -> None:
        """Add a frame and its completed depth by method; all frames have one shape."""
        counted = ~pair.valid & np.isfinite(pair.truth())
        error = np.abs(list(completed.values())[-1] - pair.truth())[counted]
        known = error[np.isfinite(error)]
        missed = np.inf if error.size else 0.0  # Missing depth is worse than any error.
        self.frames.append((float(known.mean()) if known.size else missed, pair, completed))
        self.frames.sort(key=lambda row: -row[0])
        del self.frames[_SHOWN:]

    def draw(self) -> bytes:
        """Draw truth, depth and errors of each method for all frames, as PNG bytes."""
        rows = [row for _, pair, completed in self.frames for row in _rows(pair, completed)]
        return sheet.draw(rows, self.frames[0][1].depth_m.shape, panel_in=3.4)


def _rows(pair: Pair, completed: Mapping[str, Image]) -> list[list[Panel]]:
    truth = pair.truth()
    limits = panels.depth_limits(truth)
    title = f"{pair.scene}: truth"
    depths = [Panel(draw=partial(panels.depth, depth_m=truth, limits=limits, title=title))]
    errors = [Panel(draw=_blank)]
    for name, depth_m in completed.items():
        depths.append(Panel(draw=partial(panels.depth, depth_m=depth_m, limits=limits, title=name)))
        errors.append(Panel(draw=partial(_error, image=np.abs(depth_m - truth), title=name)))
    return [depths, errors]


def _error(axes: Axes, image: Image, title: str) -> None:
    axes.imshow(image, cmap="magma_r", vmin=0, vmax=_ERROR_M, interpolation="nearest")
    panels.finish(axes, title, f"error: 0 white to {_ERROR_M} m black")


def _blank(axes: Axes) -> None:
    axes.axis("off")
