"""Position of a crop in a frame."""

from __future__ import annotations


def window_start(middle: int, part: int, whole: int) -> int:
    """Return the start of a crop along one side, with a given pixel at or near its centre.

    Args:
        middle: the pixel.
        part: length of the crop; a crop longer than the side starts at 0.
        whole: length of the frame's side.
    """
    return max(min(middle - part // 2, whole - part), 0)
