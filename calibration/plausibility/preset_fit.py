"""Which preset captures are of: by their field of view, their baseline and their dots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.calibration.plausibility.dots_seen import stated_per_deg2
from starling.patterns.errors import refuse
from starling.sim.captures.info import CaptureInfo
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

# Ratios up to which a preset fits.
_FIELD = 1.2  # Modes cropped to 4:3 differ by 1.18 from the whole imager's.
_BASELINE = 1.15  # D415 and D435 differ by 1.09, units of one model by a few percent.
_DOTS = 1.6  # D415 and D435 differ by 4 or more; captured rooms by 1.2 from the preset.


@dataclass(frozen=True, kw_only=True, slots=True)
class _Fit:
    """Ratios of the captures' figures to a sensor's; 1 = equal."""

    field: float
    baseline: float
    dots: float
    stated_per_deg2: float  # What the sensor's pattern would show; NaN where none was counted.

    @property
    def geometry_fits(self) -> bool:
        return _within(self.field, _FIELD) and _within(self.baseline, _BASELINE)

    @property
    def dots_fit(self) -> bool:
        return _within(self.dots, _DOTS)

    @property
    def distance(self) -> float:
        """Sum of the ratios' logarithms, each over what is allowed."""
        pairs = ((self.field, _FIELD), (self.baseline, _BASELINE), (self.dots, _DOTS))
        return float(sum(abs(np.log(ratio)) / np.log(allowed) for ratio, allowed in pairs))


def check(info: CaptureInfo, sensor: Sensor, dots_per_deg2: float | None) -> tuple[str, ...]:
    """Refuse a sensor of another model than the captures', if a preset fits them better.

    Three figures are compared: the tangent of half the horizontal field (fits within a ratio of
    1.2), the baseline (1.15) and the spots per square degree (1.6). Geometry is compared with
    the preset that the sensor is called after, since its own may come from the captures. Refused
    is a sensor whose dots do not fit, or whose geometry does not and the captures name the other
    preset; anything else is said.

    Args:
        info: of the captures.
        sensor: that is to be fitted.
        dots_per_deg2: spots counted in the captures; None where there is no infrared to count in.

    Returns:
        Warnings.

    Raises:
        InputError: as above; the message names the preset that fits better.
    """
    nominal = presets.load(sensor.name) if sensor.name in presets.names() else None
    own = _fit(info, nominal, sensor, dots_per_deg2)
    if own.geometry_fits and own.dots_fit:
        return ()
    complaint = "; ".join(_complaints(info, nominal, own, dots_per_deg2))
    better = _better(info, sensor, dots_per_deg2)
    if better is not None and (not own.dots_fit or info.sensor == better):
        raise refuse(
            f"sensor {sensor.name}",
            "must fit the captures",
            complaint,
            f"Preset {better} fits better.",
        )
    hint = "no preset fits better" if better is None else f"preset {better} fits better"
    return (f"sensor {sensor.name} may not be of the captures' model: {complaint}; {hint}.",)


def _fit(info: CaptureInfo, nominal: Sensor | None, lit: Sensor, dots: float | None) -> _Fit:
    stated = float("nan") if dots is None else stated_per_deg2(lit.projector, info.fx_px)
    wide, long = 1.0, 1.0
    if nominal is not None:
        wide = (info.width / info.fx_px) / (nominal.width / nominal.fx_px)
        long = info.baseline_m / nominal.baseline_m
    ratio = 1.0 if dots is None else dots / max(stated, 1e-6)
    return _Fit(field=wide, baseline=long, dots=ratio, stated_per_deg2=stated)


def _better(info: CaptureInfo, sensor: Sensor, dots: float | None) -> str | None:
    """Name of the preset that fits best, None if none fits."""
    others = (presets.load(name) for name in presets.names() if name != sensor.name)
    fits = {
        other.name: _fit(info, other, other, dots) for other in others if other.kind == sensor.kind
    }
    fitting = {name: fit for name, fit in fits.items() if fit.geometry_fits and fit.dots_fit}
    return min(fitting, key=lambda name: fitting[name].distance) if fitting else None


def _complaints(
    info: CaptureInfo, nominal: Sensor | None, fit: _Fit, dots: float | None
) -> list[str]:
    said = []
    if dots is not None and not fit.dots_fit:
        said.append(
            f"{dots:.2g} dots per square degree where its pattern shows {fit.stated_per_deg2:.2g}"
        )
    if nominal is not None and not _within(fit.field, _FIELD):
        seen, stated = (np.rad2deg(2 * np.arctan(c.width / 2 / c.fx_px)) for c in (info, nominal))
        said.append(f"a field {seen:.0f} deg wide where the preset has {stated:.0f}")
    if nominal is not None and not _within(fit.baseline, _BASELINE):
        baselines = (1e3 * info.baseline_m, 1e3 * nominal.baseline_m)
        said.append("a baseline of {:.1f} mm where the preset has {:.1f}".format(*baselines))
    return said


def _within(ratio: float, allowed: float) -> bool:
    return 1 / allowed <= ratio <= allowed
