"""Simulated value of every figure that a data sheet can state."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

from starling.sim.commands.check_sensors import planes
from starling.sim.commands.check_sensors.planes import FlatTarget, TargetFigures
from starling.sim.sensor.datasheets import StatedFigure, Target
from starling.sim.sensor.sensor import Sensor

_STEP = 1.25  # Ratio of the distances that bracket an end of the range.
_STEPS = 8  # Most of these steps from the stated distance: a factor of six.
_HALVINGS = 6  # Bisections of the bracket; the end is known to 0.35 %.
_LEAST_FILL_PCT = 50.0  # Of the reachable area, within the range.


class CameraMeasurement:
    """A camera whose figures are simulated on demand; equal targets are simulated once."""

    def __init__(self, sensor: Sensor, *, seed: int = 0) -> None:
        self.sensor = sensor
        self._seed = seed
        self._strip = planes.strip(sensor)
        self._figures = functools.cache(functools.partial(planes.measure, sensor, seed=seed))
        self._strip_figures = functools.cache(
            functools.partial(planes.measure, self._strip, seed=seed)
        )

    def simulated(self, stated: StatedFigure) -> float:
        """Return the simulated value of a figure in its unit; NaN if the camera has no depth."""
        return _VALUES[stated.figure](self, stated)

    def whole_image(self, stated: StatedFigure) -> TargetFigures:
        """Return the figures of a target over the whole image."""
        return self._figures(_view(stated))

    def without_projector_pct(self, stated: StatedFigure) -> float:
        """Return the fill rate with the projector off [percent]."""
        return self._strip_figures(_view(stated, projector=False)).fill_pct

    def sunlight_change_pct(self, stated: StatedFigure) -> float:
        """Return the fill rate in sunlight minus that in room light [percent]."""
        bright = self._strip_figures(_view(stated, sunlight=True))
        return bright.fill_pct - self._strip_figures(_view(stated)).fill_pct

    def temporal_noise_pct(self, stated: StatedFigure) -> float:
        """Return the noise of a pixel over frames [percent of the distance]."""
        return planes.temporal_noise_pct(self._strip, _view(stated), seed=self._seed)

    def nearest_m(self, stated: StatedFigure) -> float:
        """Return the least distance with depth on half of the reachable area [m]."""
        return range_end_m(self._has_depth(stated.target), stated.value[0], outward=1 / _STEP)

    def farthest_m(self, stated: StatedFigure) -> float:
        """Return the largest distance with depth on half of the reachable area [m]."""
        return range_end_m(self._has_depth(stated.target), stated.value[0], outward=_STEP)

    def noise_mm(self, distance_m: float) -> float:
        """Return the plane-fit RMS at a distance [mm]; passive cameras see a textured target."""
        target: Target = "plain" if self.sensor.projector.power_w else "textured"
        figures = self._strip_figures(FlatTarget(distance_m=distance_m, target=target))
        return 10 * figures.plane_rms_pct * distance_m

    def _has_depth(self, target: Target) -> Callable[[float], bool]:
        def has_depth(distance_m: float) -> bool:
            view = FlatTarget(distance_m=distance_m, target=target)
            fill = planes.fill_of_reachable(self._strip, view, seed=self._seed)
            return fill >= _LEAST_FILL_PCT

        return has_depth


def range_end_m(has_depth: Callable[[float], bool], start_m: float, *, outward: float) -> float:
    """Search an end of the range [m] from a stated one; known to 0.35 %.

    Args:
        has_depth: whether the camera has depth at a distance [m].
        start_m: stated end of the range [m].
        outward: ratio of a step out of the range: below 1 at the near end.

    Returns:
        The outermost distance with depth. The search ends at a factor of six from `start_m`: the
        result is this end if the camera has depth there. It is NaN if the camera has no depth.
    """
    inside = has_depth(start_m)
    step = outward if inside else 1 / outward
    last_m = start_m
    for _ in range(_STEPS):
        next_m = last_m * step
        if has_depth(next_m) != inside:
            good_m, bad_m = (last_m, next_m) if inside else (next_m, last_m)
            break
        last_m = next_m
    else:
        return last_m if inside else math.nan
    for _ in range(_HALVINGS):
        middle_m = math.sqrt(good_m * bad_m)
        good_m, bad_m = (middle_m, bad_m) if has_depth(middle_m) else (good_m, middle_m)
    return good_m


def field_deg(focal_px: float, centre_px: float, size_px: float) -> float:
    """Return the field of view between the outer edges of an image [deg]."""
    before, after = centre_px + 0.5, size_px - 0.5 - centre_px
    return math.degrees(math.atan(before / focal_px) + math.atan(after / focal_px))


def depth_field_deg(sensor: Sensor, distance_m: float) -> float:
    """Return the field of view that both imagers see at a distance [deg].

    Source: D400 datasheet 337029, section 4.4.
    """
    band_px = sensor.focal_baseline_px_m / distance_m
    return field_deg(sensor.fx_px, sensor.cx_px - band_px, sensor.width - band_px)


def _view(stated: StatedFigure, *, sunlight: bool = False, projector: bool = True) -> FlatTarget:
    assert stated.distance_m is not None  # A stated figure of this kind has a distance.
    return FlatTarget(
        distance_m=stated.distance_m,
        target=stated.target,
        sunlight=sunlight,
        projector=projector,
    )


_VALUES: dict[str, Callable[[CameraMeasurement, StatedFigure], float]] = {
    "horizontal_field_deg": lambda camera, _: field_deg(
        camera.sensor.fx_px, camera.sensor.cx_px, camera.sensor.width
    ),
    "horizontal_depth_field_deg": lambda camera, stated: depth_field_deg(
        camera.sensor, _view(stated).distance_m
    ),
    "vertical_field_deg": lambda camera, _: field_deg(
        camera.sensor.fy_px, camera.sensor.cy_px, camera.sensor.height
    ),
    "baseline_mm": lambda camera, _: 1e3 * camera.sensor.baseline_m,
    "minimum_distance_m": CameraMeasurement.nearest_m,
    "maximum_distance_m": CameraMeasurement.farthest_m,
    "accuracy_pct": lambda camera, stated: camera.whole_image(stated).accuracy_pct,
    "median_error_pct": lambda camera, stated: camera.whole_image(stated).median_error_pct,
    "plane_rms_pct": lambda camera, stated: camera.whole_image(stated).plane_rms_pct,
    "temporal_noise_pct": CameraMeasurement.temporal_noise_pct,
    "fill_pct": lambda camera, stated: camera.whole_image(stated).fill_pct,
    "left_band_pct": lambda camera, stated: camera.whole_image(stated).left_band_pct,
    "fill_without_projector_pct": CameraMeasurement.without_projector_pct,
    "sunlight_change_pct": CameraMeasurement.sunlight_change_pct,
}
