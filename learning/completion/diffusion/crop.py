"""Parts of frames that training sees, as large as the paper's."""

from __future__ import annotations

import numpy as np

from starling.learning.completion.data.window import around
from starling.learning.completion.diffusion.samples import Sample
from starling.learning.completion.frame import Frame

_LEAST = 0.2  # Share of a crop that must have depth, which its scale is told by; else another is
_TRIES = 10  # drawn, so often.


def cropped(sample: Sample, size_px: tuple[int, int], rng: np.random.Generator) -> Sample:
    """Cut a part out of a frame; a side that is shorter stays whole.

    Args:
        sample: with sensor depth somewhere, and so the part has.
        size_px: height and width.
        rng: draws where.
    """
    frame = sample.frame
    rows, columns = (min(pair) for pair in zip(frame.shape, size_px, strict=True))
    if (rows, columns) == frame.shape:
        return sample
    for _ in range(_TRIES):
        top, left = (
            int(rng.integers(whole - part + 1))
            for whole, part in zip(frame.shape, (rows, columns), strict=True)
        )
        if frame.valid[top : top + rows, left : left + columns].mean() > _LEAST:
            return _cut(sample, top, left, rows, columns)
    # Hardly any depth: around a pixel that has some.
    there = np.argwhere(frame.valid)
    row, column = there[int(rng.integers(len(there)))].tolist()
    top, left = around(row, rows, frame.shape[0]), around(column, columns, frame.shape[1])
    return _cut(sample, top, left, rows, columns)


def _cut(sample: Sample, top: int, left: int, rows: int, columns: int) -> Sample:
    window = slice(top, top + rows), slice(left, left + columns)
    frame = sample.frame
    part = Frame(rgb=frame.rgb[window], depth_m=frame.depth_m[window], valid=frame.valid[window])
    return Sample(part, sample.truth_m[window])
