"""Pictures of the judge: scores by place, and the windows that convict most."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import cv2
import numpy as np

from starling.learning.judge.cells import CELL_PX
from starling.learning.judge.judge import JudgedScene
from starling.learning.judge.network import WINDOW_PX
from starling.sim.arrays import Image
from starling.sim.captures.capture import CapturedScene
from starling.sim.metrics import LEFT_BAND_PX
from starling.sim.plotting import panels, sheet
from starling.sim.plotting.sheet import Panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIDES = ("real", "simulated")
_CROPS = 8  # Windows shown of each side.
_SCORE_LIMIT = 4.0  # Score of the colour scale's ends.
_SMOOTHING_PX = 8.0  # Deviation of the local mean that disparity is shown without.
_SHOWN_PX = 0.5  # Disparity of the grey scale's ends.
_HOLE_BLUE = (0.15, 0.35, 0.95)


def view(kind: str, scene: CapturedScene) -> Image:
    """Return what the judge sees of a scene's first frame as colours (h, w, 3), 0 to 1."""
    frame = scene.frame(scene.frames[0])
    if kind == "infrared":
        assert frame.ir_left is not None  # The judge has read it.
        level = frame.ir_left.astype(np.float32)
        limit = float(np.percentile(level, 99.5))
        return np.repeat(np.sqrt(np.clip(level / max(limit, 1), 0, 1))[..., None], 3, axis=2)
    assert frame.depth_m is not None  # The judge has read it.
    disparity_px = scene.info.disparity_px(frame.depth_m)
    known = np.isfinite(disparity_px)
    grey = np.full(known.shape, 0.9, np.float32)
    if kind == "depth":
        values, weight = np.nan_to_num(disparity_px), known.astype(np.float32)
        mean = cv2.GaussianBlur(values, (0, 0), _SMOOTHING_PX)
        mean /= np.maximum(cv2.GaussianBlur(weight, (0, 0), _SMOOTHING_PX), 1e-6)
        grey = np.clip(0.5 + (values - mean) / (2 * _SHOWN_PX), 0, 1)
    colours = np.repeat(grey[..., None], 3, axis=2)
    colours[~known] = _HOLE_BLUE
    return colours.astype(np.float32)


def maps(judged: JudgedScene, views: Sequence[Image]) -> bytes:
    """Draw both sides of a scene under the scores of their windows, as PNG bytes."""
    row = [
        Panel(
            draw=partial(_map, image=image, scores=judged.scores[side].numpy(), title=name),
        )
        for side, (name, image) in enumerate(zip(SIDES, views, strict=True))
    ]
    return sheet.draw([row], views[0].shape[:2])


def _map(axes: Axes, image: Image, scores: Image, title: str) -> None:
    axes.imshow(image.mean(-1), cmap="gray", vmin=0, vmax=1.4)
    rows, columns = scores.shape
    extent = (LEFT_BAND_PX, LEFT_BAND_PX + columns * WINDOW_PX, rows * WINDOW_PX, 0)
    # Red: taken for a simulation.
    axes.imshow(
        scores, cmap="RdBu", vmin=-_SCORE_LIMIT, vmax=_SCORE_LIMIT, alpha=0.45, extent=extent
    )
    axes.set(xlim=(0, image.shape[1]), ylim=(image.shape[0], 0))
    real = float((scores > 0).sum() / max(np.isfinite(scores).sum(), 1))
    panels.finish(axes, title, f"{real:.0%} of windows taken for real")


def crops(judged: Sequence[JudgedScene], views: Sequence[Sequence[Image]]) -> bytes:
    """Draw the real windows of highest, and the simulated ones of lowest score, as PNG bytes.

    Below each is the other side's window at the same place.

    Args:
        judged: scores of all scenes.
        views: both sides of each scene, as `view` returns them.
    """
    rows = []
    for side, sign in ((0, -1), (1, 1)):
        scores = np.stack([sign * each.scores[side].numpy() for each in judged])
        order = np.argsort(np.where(np.isfinite(scores), scores, np.inf), axis=None)[:_CROPS]
        places = [np.unravel_index(number, scores.shape) for number in order]
        for shown in (side, 1 - side):
            row = []
            for scene, top, left in places:
                score = float(judged[scene].scores[shown, top, left])
                image = _window(views[scene][shown], int(top), int(left))
                title = f"{judged[scene].pair.scene} {SIDES[shown]} {score:+.1f}"
                row.append(Panel(draw=partial(_crop, image=image, title=title)))
            rows.append(row)
    return sheet.draw(rows, (1, 1), panel_in=2.0)


def _window(image: Image, row: int, column: int) -> Image:
    top, left = row * WINDOW_PX, LEFT_BAND_PX // CELL_PX * CELL_PX + column * WINDOW_PX
    return image[top : top + WINDOW_PX, left : left + WINDOW_PX]


def _crop(axes: Axes, image: Image, title: str) -> None:
    axes.imshow(image, interpolation="nearest")
    panels.finish(axes, "", "")
    axes.set_title(title, fontsize=8, color=panels.INK, pad=4)
