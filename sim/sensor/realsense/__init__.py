"""RealSense device controls: named presets and the viewer's JSON files."""

from __future__ import annotations

from starling.sim.sensor.realsense import controls
from starling.sim.sensor.realsense.mapping import Report as Report
from starling.sim.sensor.realsense.mapping import apply as apply
from starling.sim.sensor.realsense.mapping import with_emitter as with_emitter
from starling.sim.sensor.sensor import Sensor


def with_preset(sensor: Sensor, preset: str) -> tuple[Sensor, Report]:
    """Apply a device preset to a sensor.

    Args:
        sensor: Sensor whose settings represent the device's default preset.
        preset: Name of a preset (`controls.preset_names`) or an exported file (`*.json`).

    Returns:
        The sensor, and a report of the mapped and unmapped controls.

    Raises:
        InputError: for an unknown preset, a file that `controls.read_file` refuses, or a sensor
            that `apply` refuses.
    """
    if preset.lower().endswith(".json"):
        return apply(sensor, controls.read_file(preset, sensor.name))
    return apply(sensor, controls.named_preset(preset))
