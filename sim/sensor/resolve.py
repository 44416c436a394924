"""The sensor that a command asks for: a preset, the captures' geometry, device controls, edits."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from starling.sim.captures import capture
from starling.sim.console.progress import Note, unsaid
from starling.sim.sensor import edits as sensor_edits
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor


def load(
    name: str,
    *,
    captures: str = "",
    device_preset: str | None = None,
    emitter: Literal["on", "off"] | None = None,
    edits: Iterable[str] = (),
    note: Note = unsaid,
) -> Sensor:
    """Load a sensor, give it the geometry of its captures, then controls, then edits.

    A sensor file of the captures' very camera, as calibration writes it, keeps its own geometry: it
    knows better than what the captures say of themselves.

    A pattern's image file gets its full path, so that the sensor can be used from elsewhere: one
    in a sensor file from that file's folder, one in an edit from the working directory.

    Args:
        name: preset or sensor file.
        captures: what it is used on; only a capture set or a scene in it has a geometry.
        device_preset: a RealSense preset's name or a file of its controls (`starling.sim.sensor.realsense`).
        emitter: switches the projector.
        edits: see `starling.sim.sensor.edits.apply`.
        note: is told what the device's controls changed, and what they could not.

    Raises:
        InputError: whatever is refused on the way.
    """
    sensor = presets.load(name)
    if capture.is_capture(captures):
        asked = capture.open_set(captures)
        asked.refuse_mixed()
        info = asked.info
        if not (name.endswith(".toml") and info.are_of(sensor)):
            sensor = info.geometry_into(sensor)
    if device_preset is not None or emitter is not None:
        sensor = _controlled(sensor, device_preset, emitter, note)
    return presets.anchored(sensor_edits.apply(sensor, edits), Path.cwd())


def _controlled(
    sensor: Sensor, preset: str | None, emitter: Literal["on", "off"] | None, note: Note
) -> Sensor:
    from starling.sim.sensor import realsense

    if preset is not None:
        sensor, report = realsense.controlled(sensor, preset)
        for line in report.lines():
            note(line)
    return sensor if emitter is None else realsense.with_emitter(sensor, emitter)
