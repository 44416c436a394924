"""Pictures of an evaluation: the frames whose holes the last method fills worst."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from starling.learning.completion.data.pairs import Pair
from starling.learning.completion.frame import Image
from starling.sim.plotting import panels, sheet
from starling.sim.plotting.sheet import Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHOWN = 3  # Frames.
_ERROR_M = 0.5  # That is black.


@dataclass(slots=True)
class Worst:
    """Keeps the frames that are worst by the last method's mean error in holes."""

    kept: list[tuple[float, Pair, Mapping[str, Image]]] = field(default_factory=list)

    def see(self, one: Pair, told: Mapping[str, Image]) -> None:
        """Look at a frame and what methods made of it; all of one shape."""
        asked = ~one.valid & np.isfinite(one.truth())
        off = np.abs(list(told.values())[-1] - one.truth())[asked]
        known = off[np.isfinite(off)]
        missed = np.inf if off.size else 0.0  # No depth where it is asked for is worse than any.
        self.kept.append((float(known.mean()) if known.size else missed, one, told))
        self.kept.sort(key=lambda row: -row[0])
        del self.kept[_SHOWN:]

    def drawn(self) -> bytes:
        """A row a frame: truth, then each method's depth and, below, its error; as PNG bytes."""
        rows = [row for _, one, told in self.kept for row in _rows(one, told)]
        return sheet.draw(rows, self.kept[0][1].depth_m.shape, panel_in=3.4)


def _rows(one: Pair, told: Mapping[str, Image]) -> list[list[Panel]]:
    truth = one.truth()
    limits = panels.depth_limits(truth)
    title = f"{one.scene}: truth"
    depths = [Panel(draw=partial(panels.depth, depth_m=truth, limits=limits, title=title))]
    errors = [Panel(draw=_blank)]
    for word, depth_m in told.items():
        depths.append(Panel(draw=partial(panels.depth, depth_m=depth_m, limits=limits, title=word)))
        errors.append(Panel(draw=partial(_error, image=np.abs(depth_m - truth), title=word)))
    return [depths, errors]


def _error(axes: Axes, image: Image, title: str) -> None:
    axes.imshow(image, cmap="magma_r", vmin=0, vmax=_ERROR_M, interpolation="nearest")
    panels.finish(axes, title, f"off by 0 white to {_ERROR_M} m black")


def _blank(axes: Axes) -> None:
    axes.axis("off")
