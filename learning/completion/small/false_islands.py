"""Islands of false depth in holes, as cameras leave them and our simulated ones seldom do.

A real stereo camera now and then takes a stretch of a hole for something else, evenly and with
confidence, most often in the band that its other imager does not see: the true match is not in the
image there, and what is left to choose from lies farther away. In five rooms of d415-faro such
islands have 10 to 1,000 pixels and stand 3 to 25 times too far off. What learns to complete depth
has to have seen that an island may be wrong.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.frame import Image, Mask
from starling.sim.datasets.draw import Range

_SHARE = 0.8  # Of crops that get any.
_MOST = 6  # A crop.
_WIDE_PX = 8  # Narrowest stretch of a hole that gets one.
_AREA_PX = Range(low=40.0, high=2500.0, log=True)  # Of an ellipse, before it is cut by the hole.
_ELONGATION = 3.0  # Largest ratio of its axes.
_FARTHER = 0.75  # Share of islands that are too far, not too near.
_OFF = (0.1, 3.3)  # Of a far one's logarithm; a near one's goes to _NEARER.
_NEARER = 1.2
_SLOPE = 0.05  # Standard deviation of the relative rise across an island.
_NOISE = 0.005  # Relative, pixel by pixel.
_RARE = 0.1  # Largest area of one, over that of the camera's own depth, which is mostly true.


def with_false_islands(depth_m: Image, truth_m: Image, rng: np.random.Generator) -> Image:
    """Put false depth into holes.

    Args:
        depth_m: (h, w) the camera's own [m], NaN = none.
        truth_m: (h, w) [m], NaN where unknown; islands lie about pixels where it is known.
        rng: draws whether there are any, and where, how large and how wrong.
    """
    hole = np.isnan(depth_m)
    own = hole.size - np.count_nonzero(hole)
    runs = _runs(hole & np.isfinite(truth_m))
    if rng.random() >= _SHARE or not len(runs):
        return depth_m
    out = depth_m.copy()
    for _ in range(int(rng.integers(1, _MOST + 1))):
        row, begin, end = runs[rng.integers(len(runs))]
        column = rng.integers(begin, end)
        area, ratio = _AREA_PX.drawn(rng), rng.uniform(1, _ELONGATION)
        axes = np.sqrt(area / np.pi * np.array([ratio, 1 / ratio]))
        island = np.zeros(depth_m.shape, np.uint8)
        size = (float(2 * axes[0]), float(2 * axes[1]))
        centre = (float(column), float(row))
        cv2.ellipse(island, (centre, size, float(rng.uniform(0, 180))), 1, cv2.FILLED)
        island[row, column] = 1  # An ellipse thinner than a pixel may miss its own centre.
        rows, columns = np.nonzero((island > 0) & hole)
        if len(rows) > _RARE * own:
            continue
        across = (columns - column) * rng.normal(0, _SLOPE) + (rows - row) * rng.normal(0, _SLOPE)
        off = rng.uniform(*_OFF) if rng.random() < _FARTHER else -rng.uniform(_OFF[0], _NEARER)
        log = off + across / axes.max() + rng.normal(0, _NOISE, len(rows))
        out[rows, columns] = truth_m[row, column] * np.exp(log)
    return out


def _runs(mask: Mask) -> NDArray[np.intp]:
    """Wide stretches (row, first column, column after the last) of each row that are True.

    An island's place is drawn among them: narrow bands get as many as wide holes.
    """
    steps = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (rows, first), (_, after) = np.nonzero(steps > 0), np.nonzero(steps < 0)
    return np.column_stack([rows, first, after])[after - first >= _WIDE_PX]
