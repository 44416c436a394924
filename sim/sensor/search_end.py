"""Warning of a nearest depth that the matcher's search does not reach."""

from __future__ import annotations

import warnings

from starling.sim.sensor.sensor import Sensor

_SLACK = 1.05  # A data sheet's nearest depth is rounded.
_MOST_PX = 256  # Largest search.
_STEP_PX = 16  # Searches are multiples of it.


def end_m(sensor: Sensor) -> float:
    """Return the nearest depth of the search [m]; matches at its last disparity are refused."""
    return sensor.focal_baseline_px_m / max(sensor.matcher.largest_px - 1, 1)


def warn(sensor: Sensor, name: object) -> None:
    """Warn of surfaces that are in the range of a sensor, and outside its search.

    Args:
        sensor: sensor of a file.
        name: its file.
    """
    near_m, matcher = sensor.post.near_m, sensor.matcher
    if not 0 < near_m * _SLACK < end_m(sensor):
        return
    needed = sensor.focal_baseline_px_m / near_m + 2 - matcher.min_disparity_px
    search_px = _STEP_PX * -int(-needed // _STEP_PX)
    advice = f"Set post.near_m to {end_m(sensor):.3g}"
    if search_px <= _MOST_PX and not matcher.extended:
        advice += f", or matcher.search_px to {search_px}"
    warnings.warn(
        f"{name}: post.near_m is {near_m:g} m, and the search of {matcher.search_px} disparities "
        f"ends at {end_m(sensor):.3g} m. Depth of nearer surfaces is missing or wrong. {advice}.",
        stacklevel=3,
    )
