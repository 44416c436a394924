"""Device controls as RealSense users know them: named presets and the viewer's JSON files."""

from __future__ import annotations

from starling.sim.sensor.realsense import advanced_mode, presets
from starling.sim.sensor.realsense.mapping import Report as Report
from starling.sim.sensor.realsense.mapping import apply as apply
from starling.sim.sensor.realsense.mapping import with_emitter as with_emitter
from starling.sim.sensor.sensor import Sensor


def controlled(sensor: Sensor, asked: str) -> tuple[Sensor, Report]:
    """Put a sensor under a device preset.

    Args:
        sensor: taken to stand at the device's default preset.
        asked: a preset's name (`starling.sim.sensor.realsense.presets.names`) or an exported file (`*.json`).

    Returns:
        The sensor, and what was mapped how and what was not.

    Raises:
        InputError: unknown preset, a file that `advanced_mode.read` refuses, or a sensor that
            `apply` refuses.
    """
    if asked.lower().endswith(".json"):
        return apply(sensor, advanced_mode.read(asked))
    return apply(sensor, presets.named(asked))
