"""Islands of false depth in holes, which are frequent in real captures and rare in simulated ones.

A real stereo camera at times matches a stretch of a hole to a wrong place, smoothly and with
confidence. This is most frequent in the band that the other imager does not see. There, the true
match is not in the image and the remaining candidates are farther away. In five rooms of d415-faro
such islands have 10 to 1,000 pixels and are 3 to 25 times too far away. Training must include them
so that the network learns to reject islands.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.completion.frame import Image, Mask
from starling.sim.datasets.draw import Range

_SHARE = 0.8  # Share of crops with islands.
_MOST = 6  # Most islands a crop.
_WIDE_PX = 8  # Least width of a stretch of a hole with an island [px].
# Area of an ellipse before it is cut by the hole [px].
_AREA_PX = Range(low=40.0, high=2500.0, log=True)
_ELONGATION = 3.0  # Greatest ratio of the axes.
_FARTHER = 0.75  # Share of islands that are too far away; the others are too near.
_OFF = (0.1, 3.3)  # Range of the error of a far island, as natural logarithm of depth.
_NEARER = 1.2  # Greatest error of a near island, as natural logarithm of depth.
_SLOPE = 0.05  # Standard deviation of the relative change of depth across an island.
_NOISE = 0.005  # Relative noise of each pixel.
_RARE = 0.1  # Greatest area of an island over that of the camera's own depth.


def with_false_islands(depth_m: Image, truth_m: Image, rng: np.random.Generator) -> Image:
    """Add islands of false depth to holes.

    Args:
        depth_m: (h, w) the camera's own depth [m], NaN where missing.
        truth_m: (h, w) [m], NaN where unknown; islands are centred where it is known.
        rng: random generator of number, place, size and error of the islands.
    """
    hole = np.isnan(depth_m)
    known_count = hole.size - np.count_nonzero(hole)
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
        island[row, column] = 1  # An ellipse thinner than a pixel may miss its centre.
        rows, columns = np.nonzero((island > 0) & hole)
        if len(rows) > _RARE * known_count:
            continue
        across = (columns - column) * rng.normal(0, _SLOPE) + (rows - row) * rng.normal(0, _SLOPE)
        off = rng.uniform(*_OFF) if rng.random() < _FARTHER else -rng.uniform(_OFF[0], _NEARER)
        log = off + across / axes.max() + rng.normal(0, _NOISE, len(rows))
        out[rows, columns] = truth_m[row, column] * np.exp(log)
    return out


def _runs(mask: Mask) -> NDArray[np.intp]:
    """Return wide stretches (row, first column, column after the last) of each row that are True.

    Islands are centred on them, so that narrow bands get as many islands as wide holes.
    """
    steps = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (rows, first), (_, after) = np.nonzero(steps > 0), np.nonzero(steps < 0)
    return np.column_stack([rows, first, after])[after - first >= _WIDE_PX]
