"""Where a part of a frame lies."""

from __future__ import annotations


def around(middle: int, part: int, whole: int) -> int:
    """Where a part begins along one side, a pixel in its middle or near it.

    Args:
        middle: the pixel.
        part: length of the part; a longer one than the whole begins with it.
        whole: length of the frame's side.
    """
    return max(min(middle - part // 2, whole - part), 0)
