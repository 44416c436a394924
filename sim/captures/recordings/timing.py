"""Times of recorded images: streams that belong together, jumps of the clock, dropped frames."""

from __future__ import annotations

import bisect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from starling.patterns import errors

_APART = 0.4  # Largest distance of two images of one time, in periods of the stream.
_LONGEST_S = 0.02  # Largest such distance [s].
_PERIOD_S = 1 / 30  # Period of a single image.
_DROPPED = 1.5  # An interval above this multiple of the period has dropped frames.
_JUMP_S = 60.0  # A longer interval is a jump of the clock, not dropped frames [s].
_FEWEST = 0.3  # Least share of left images with a partner; every other one may be unlit.


@dataclass(frozen=True, slots=True)
class ClockFigures:
    """How regular the times of a stream are."""

    rate_hz: float | None
    dropped: int  # Frames that are missing between others.
    jumps: int  # Intervals that are negative, or longer than a minute.


def clock(times_s: Sequence[float]) -> ClockFigures:
    """Measure the times of a stream, in the order of recording."""
    if len(times_s) < 2:
        return ClockFigures(None, 0, 0)
    steps = np.diff(np.array(times_s))
    period = _period(times_s)
    jumps = (steps < 0) | (steps > _JUMP_S)
    late = steps[~jumps & (steps > _DROPPED * period)]
    dropped = int(np.sum(np.rint(late / period) - 1)) if period > 0 else 0
    return ClockFigures(round(1 / period, 3) if period > 0 else None, dropped, int(jumps.sum()))


def _period(times_s: Sequence[float]) -> float:
    """Median interval of a stream [s]."""
    steps = np.diff(np.array(times_s))
    steps = steps[(steps > 0) & (steps <= _JUMP_S)]
    return float(np.median(steps)) if steps.size else _PERIOD_S


def partners(times_s: Mapping[str, Sequence[float]]) -> list[dict[str, int] | None]:
    """Find the images of each stream that belong to each left image.

    Args:
        times_s: times of each stream's images, in the order of recording; `left` is the base.

    Returns:
        For each left image: the numbers of the images by stream, or None if the right stream has
        none at its time. Another stream may lack an image.

    Raises:
        InputError: if most left images have no partner in a stream.
    """
    base = times_s["left"]
    limit_s = min(_LONGEST_S, _APART * _period(base))
    nearest: dict[str, list[int | None]] = {}
    for name, stream in times_s.items():
        if _agree(stream, base, limit_s):  # Also where the clock repeats times.
            nearest[name] = list(range(len(base)))
            continue
        ordered = sorted((time_s, number) for number, time_s in enumerate(stream))
        nearest[name] = [_nearest(ordered, time_s, limit_s) for time_s in base]
        share = sum(number is not None for number in nearest[name]) / max(len(base), 1)
        if base and stream and share < _FEWEST:
            apart_s = min(abs(time_s - base[0]) for time_s in stream)
            rule = f"must have the times of the left images, within {limit_s:.3g} s"
            got = f"{share:.0%} of them; the first is {apart_s:.3g} s off the nearest"
            advice = "Record the streams together; are their clocks different?"
            raise errors.refuse(f"{name} images", rule, got, advice)
    rows: list[dict[str, int] | None] = []
    for place in range(len(base)):
        numbers = {name: column[place] for name, column in nearest.items()}
        known = {name: number for name, number in numbers.items() if number is not None}
        rows.append(known if "right" in known or "right" not in times_s else None)
    return rows


def _agree(stream: Sequence[float], base: Sequence[float], limit_s: float) -> bool:
    """Whether two streams have the same times, one by one."""
    return len(stream) == len(base) and all(
        abs(time_s - other_s) <= limit_s for time_s, other_s in zip(stream, base, strict=True)
    )


def _nearest(ordered: Sequence[tuple[float, int]], time_s: float, limit_s: float) -> int | None:
    place = bisect.bisect_left(ordered, (time_s, -1))
    around = ordered[max(place - 1, 0) : place + 1]
    if not around:
        return None
    nearest_s, number = min(around, key=lambda pair: abs(pair[0] - time_s))
    return number if abs(nearest_s - time_s) <= limit_s else None


def nearest_numbers(times_s: Sequence[float], base_s: Sequence[float]) -> list[int | None]:
    """Return the number of the nearest image for each time of the base, within half a period."""
    ordered = sorted((time_s, number) for number, time_s in enumerate(times_s))
    return [_nearest(ordered, time_s, _PERIOD_S / 2) for time_s in base_s]
