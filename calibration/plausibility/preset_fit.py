"""Check the camera model of captures by field of view, baseline and density of dots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.calibration.plausibility.dots_seen import expected_per_deg2
from starling.patterns.errors import refuse
from starling.sim.captures.info import CaptureInfo
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor

# Maximum ratios to a matching preset.
_FIELD = 1.2  # Modes cropped to 4:3 differ by 1.18 from the full imager.
_BASELINE = 1.15  # D415 and D435 differ by 1.09, devices of one model by a few percent.
_DOTS = 1.6  # D415 and D435 differ by 4 or more; captured rooms differ by 1.2 from the preset.


@dataclass(frozen=True, kw_only=True, slots=True)
class _PresetRatios:
    """Ratios of the captures' figures to a sensor's; 1 = equal."""

    field: float
    baseline: float
    dots: float
    expected_per_deg2: float  # Expected from the sensor's pattern; NaN if no dots were counted.

    @property
    def geometry_fits(self) -> bool:
        return _within(self.field, _FIELD) and _within(self.baseline, _BASELINE)

    @property
    def dots_fit(self) -> bool:
        return _within(self.dots, _DOTS)

    @property
    def distance(self) -> float:
        """Sum of the ratios' absolute logarithms, each over its limit."""
        pairs = ((self.field, _FIELD), (self.baseline, _BASELINE), (self.dots, _DOTS))
        return float(sum(abs(np.log(ratio)) / np.log(allowed) for ratio, allowed in pairs))


def check(info: CaptureInfo, sensor: Sensor, dots_per_deg2: float | None) -> tuple[str, ...]:
    """Refuse a sensor of another camera model if a preset fits the captures better.

    The check compares the tangent of half the horizontal field (maximum ratio 1.2), the baseline
    (1.15) and the spots per square degree (1.6). Geometry is compared with the preset of the
    sensor's name, because the sensor's geometry may come from the captures. A sensor is refused
    if a preset fits and the dots do not match. It is also refused if the geometry does not match
    and the captures name that preset. Other mismatches give a warning.

    Args:
        info: camera metadata of the captures.
        sensor: sensor to be fitted.
        dots_per_deg2: spots counted in the captures; None without infrared images.

    Returns:
        Warnings.

    Raises:
        InputError: if a preset fits better; the message names it.
    """
    nominal = presets.load(sensor.name) if sensor.name in presets.names() else None
    sensor_ratios = _ratios(info, nominal, sensor, dots_per_deg2)
    if sensor_ratios.geometry_fits and sensor_ratios.dots_fit:
        return ()
    complaint = "; ".join(_complaints(info, nominal, sensor_ratios, dots_per_deg2))
    better = _better(info, sensor, dots_per_deg2)
    if better is not None and (not sensor_ratios.dots_fit or info.sensor == better):
        raise refuse(
            f"sensor {sensor.name}",
            "must fit the captures",
            complaint,
            f"Preset {better} fits better.",
        )
    hint = "no preset fits better" if better is None else f"preset {better} fits better"
    return (f"sensor {sensor.name} may differ from the captures' model: {complaint}; {hint}.",)


def _ratios(
    info: CaptureInfo, nominal: Sensor | None, lit: Sensor, dots: float | None
) -> _PresetRatios:
    expected_dots = float("nan") if dots is None else expected_per_deg2(lit.projector, info.fx_px)
    field, baseline = 1.0, 1.0
    if nominal is not None:
        field = (info.width / info.fx_px) / (nominal.width / nominal.fx_px)
        baseline = info.baseline_m / nominal.baseline_m
    ratio = 1.0 if dots is None else dots / max(expected_dots, 1e-6)
    return _PresetRatios(
        field=field, baseline=baseline, dots=ratio, expected_per_deg2=expected_dots
    )


def _better(info: CaptureInfo, sensor: Sensor, dots: float | None) -> str | None:
    """Return the name of the best preset; None if no preset fits."""
    candidates = (presets.load(name) for name in presets.names() if name != sensor.name)
    fits = {
        preset.name: _ratios(info, preset, preset, dots)
        for preset in candidates
        if preset.kind == sensor.kind
    }
    fitting = {name: fit for name, fit in fits.items() if fit.geometry_fits and fit.dots_fit}
    return min(fitting, key=lambda name: fitting[name].distance) if fitting else None


def _complaints(
    info: CaptureInfo, nominal: Sensor | None, fit: _PresetRatios, dots: float | None
) -> list[str]:
    texts = []
    if dots is not None and not fit.dots_fit:
        texts.append(
            f"{dots:.2g} dots per square degree; its pattern has {fit.expected_per_deg2:.2g}"
        )
    if nominal is not None and not _within(fit.field, _FIELD):
        captured_deg, nominal_deg = (
            np.rad2deg(2 * np.arctan(c.width / 2 / c.fx_px)) for c in (info, nominal)
        )
        texts.append(f"a field {captured_deg:.0f} deg wide; the preset has {nominal_deg:.0f}")
    if nominal is not None and not _within(fit.baseline, _BASELINE):
        baselines = (1e3 * info.baseline_m, 1e3 * nominal.baseline_m)
        texts.append("a baseline of {:.1f} mm; the preset has {:.1f}".format(*baselines))
    return texts


def _within(ratio: float, allowed: float) -> bool:
    return 1 / allowed <= ratio <= allowed
