"""Resolve a command's sensor: preset, geometry of the captures, device controls, edits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from starling.patterns import errors
from starling.sim.captures import capture
from starling.sim.captures.info import CaptureInfo
from starling.sim.console.progress import Note, ignore_note
from starling.sim.sensor import modes, omissions, overlaps, presets
from starling.sim.sensor.edits import apply, path_of
from starling.sim.sensor.sensor import Sensor


def load(
    name: str,
    *,
    mode: str = "",
    camera_matrix: Path | None = None,
    captures: str = "",
    device_preset: str | None = None,
    emitter: Literal["on", "off"] | None = None,
    edits: Sequence[str] = (),
    note: Note = ignore_note,
) -> Sensor:
    """Load a sensor; apply the geometry of its captures, then device controls, then edits.

    A sensor file that was calibrated on the captures' camera keeps its own geometry. It is more
    accurate than the geometry stored with the captures. Without `mode`, the mode of the captures'
    image size is used, if the camera has it.

    Image files of patterns get absolute paths, so that the sensor works in any directory. A path
    in a sensor file starts at the file's folder, a path in an edit at the working directory.

    Args:
        name: Preset or sensor file.
        mode: Mode of the camera, such as `640x480@60`; by default the file's own.
        camera_matrix: File of a device's calibration (`starling.sim.sensor.intrinsics`).
        captures: Captures to use the sensor on. Only a capture set or a scene in it has a geometry.
        device_preset: Name of a RealSense preset, or a file of controls
            (`starling.sim.sensor.realsense`).
        emitter: Switches the projector.
        edits: See `starling.sim.sensor.edits.apply`.
        note: Callback that receives a line for each changed or unsupported device control, and a
            line with the parts that a sensor file leaves out.

    Raises:
        InputError: if a step refuses its input.
    """
    file = presets.load_file(name, mode=mode, camera_matrix=camera_matrix)
    sensor = file.sensor
    left_out = omissions.line(file)
    if name.endswith(".toml") and left_out:
        note(f"{name}: {left_out}")
    if capture.is_capture(captures):
        if camera_matrix is not None:
            rule, advice = "must not be given with captures", "They have a camera of their own."
            raise errors.refuse("camera_matrix", rule, camera_matrix, advice)
        captured = capture.open_set(captures)
        captured.refuse_mixed()
        info = captured.info
        if mode:
            refuse_other_size(sensor, info)
        elif modes.name_of(info) in file.modes and modes.name_of(sensor) != modes.name_of(info):
            sensor = presets.load_file(name, mode=modes.name_of(info)).sensor
        if not (name.endswith(".toml") and info.are_of(sensor)):
            sensor = info.geometry_into(sensor)
    if device_preset is not None or emitter is not None:
        controlled = _with_controls(sensor, device_preset, emitter, note)
        overlaps.warn_of_controls(sensor, controlled, [path_of(edit) for edit in edits])
        sensor = controlled
    return presets.with_absolute_patterns(apply(sensor, edits), Path.cwd())


def refuse_other_size(sensor: Sensor, info: CaptureInfo) -> None:
    """Refuse a sensor in a mode of another image size than its captures.

    Raises:
        InputError: if the sizes differ.
    """
    if (sensor.width, sensor.height) != (info.width, info.height):
        rule = f"must have the captures' image size {info.width}x{info.height}"
        got = f"{sensor.width}x{sensor.height}"
        raise errors.refuse("mode", rule, got, "Leave the mode out, or choose the captures' one.")


def _with_controls(
    sensor: Sensor, preset: str | None, emitter: Literal["on", "off"] | None, note: Note
) -> Sensor:
    from starling.sim.sensor import realsense

    if preset is not None:
        sensor, report = realsense.with_preset(sensor, preset)
        for line in report.lines():
            note(line)
    return sensor if emitter is None else realsense.with_emitter(sensor, emitter)
