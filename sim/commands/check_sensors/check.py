"""`starling sensors check`: simulate what vendors state of their cameras."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from starling.patterns import errors
from starling.sim.commands.check_sensors import table
from starling.sim.commands.check_sensors.measurement import CameraMeasurement
from starling.sim.console import progress, record
from starling.sim.console.output import RECORD, OutputFolder
from starling.sim.render import backend
from starling.sim.sensor import datasheets, edits, modes, presets, sensor_file
from starling.sim.sensor.datasheets import StatedFigure
from starling.sim.sensor.datasheets.figures import reached

Outcome = Literal["reached", "missed", "mode not available"]
_Conditions = tuple[str, tuple[tuple[str, float], ...]]  # Mode and settings.
NOISE_M = (0.3, 0.5, 0.8, 1.2, 2.0, 3.0, 4.5, 6.0)  # Distances of the picture [m].


@dataclass(frozen=True, kw_only=True, slots=True)
class FigureComparison:
    """A stated figure and its simulated value."""

    stated: StatedFigure
    simulated: float | None  # In the figure's unit; None if the mode is not available.
    outcome: Outcome
    our_value: float | None = None  # By our definition; None if the stated one is ours.


@dataclass(frozen=True, kw_only=True, slots=True)
class CheckedCamera:
    """A camera's stated and simulated figures."""

    preset: str
    camera: str  # The vendor's name of it.
    mode: str  # Image size of the preset.
    comparisons: tuple[FigureComparison, ...]
    noise_mm: Mapping[float, float]  # Plane-fit RMS by distance [m]; empty if not requested.


def check(
    preset: str,
    *,
    seed: int = 0,
    noise_m: Sequence[float] = (),
    track: progress.Progress = progress.silent,
) -> CheckedCamera:
    """Compare the data sheet of a preset with its simulation.

    Args:
        preset: preset with a data sheet.
        seed: seed of the noise.
        noise_m: distances [m] at which the plane-fit RMS is simulated too.
        track: wraps the loops over figures and distances.

    Raises:
        InputError: if no such preset has a data sheet, or the sheet is damaged.
    """
    sheet = datasheets.load(preset)
    camera = CameraMeasurement(presets.load(preset), seed=seed)
    mode = modes.name_of(camera.sensor)
    cameras: dict[_Conditions, CameraMeasurement | None] = {(mode, ()): camera}
    comparisons = []
    for stated in track(sheet.figures, preset):
        conditions = stated.mode or mode, stated.settings
        if conditions not in cameras:
            cameras[conditions] = _under(preset, *conditions, seed)
        comparisons.append(compare(stated, cameras[conditions]))
    return CheckedCamera(
        preset=preset,
        camera=sheet.camera,
        mode=mode,
        comparisons=tuple(comparisons),
        noise_mm={z: camera.noise_mm(z) for z in track(noise_m, f"{preset}, noise")},
    )


def _under(
    preset: str, mode: str, settings: Sequence[tuple[str, float]], seed: int
) -> CameraMeasurement | None:
    """Return a preset in one of its modes, with settings; None if it has no such mode."""
    file = presets.load_file(preset)
    if mode in file.modes:
        file = sensor_file.in_mode(file, mode)
    elif mode != modes.name_of(file.sensor):
        return None
    return CameraMeasurement(edits.with_values(file.sensor, settings), seed=seed)


def compare(stated: StatedFigure, camera: CameraMeasurement | None) -> FigureComparison:
    """Simulate a stated figure and judge it.

    Args:
        stated: the figure.
        camera: the camera in the figure's mode; None if the preset has no such mode.
    """
    if camera is None:
        return FigureComparison(stated=stated, simulated=None, outcome="mode not available")
    simulated = camera.simulated(stated)
    outcome = "reached" if reached(stated.kind, stated.value, simulated) else "missed"
    comparison = FigureComparison(stated=stated, simulated=simulated, outcome=outcome)
    if not stated.kind.our_figure:
        return comparison
    ours = dataclasses.replace(stated, figure=stated.kind.our_figure)
    return dataclasses.replace(comparison, our_value=camera.simulated(ours))


def run(
    names: Sequence[str],
    out: Path | None = None,
    *,
    seed: int = 0,
    force: bool = False,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Check cameras, and write tables and a picture if `out` is given.

    Args:
        names: presets with data sheets; empty checks all of them.
        out: folder to create for `sensors.md`, `sensors.json` and `noise.png`.
        seed: seed of the noise.
        force: replace an earlier folder.
        track: wraps the loops over figures and distances.

    Returns:
        `{PRESET: {"camera", "mode", "figures": [{"figure", "stated", "simulated", "our_value",
        "result", "source"}]}}`. `result` is `reached`, `missed` or `mode not available`.
        `our_value` is that by our definition, where the vendor's is another.

    Raises:
        InputError: as `check`, or if the folder cannot be written; no partial output remains.
    """
    errors.in_interval("seed", seed, 0, 2**63 - 1, "Give a whole number from 0.")
    chosen = list(dict.fromkeys(names)) or datasheets.names()
    for name in chosen:
        datasheets.load(name)  # Refuses unknown names and damaged sheets before any rendering.
    if out is None:
        return table.listed([check(name, seed=seed, track=track) for name in chosen])
    with OutputFolder(out, force=force) as folder:
        cameras = [check(name, seed=seed, noise_m=NOISE_M, track=track) for name in chosen]
        from starling.sim.commands.check_sensors import picture

        result = table.listed(cameras)
        arguments = {"names": chosen, "seed": seed}
        noise = {camera.preset: camera.noise_mm for camera in cameras}
        files: dict[str, bytes | str] = {
            "sensors.md": table.markdown(cameras),
            "sensors.json": record.dumps({"cameras": result, "noise_mm": noise}),
            "noise.png": picture.draw(cameras),
            RECORD: record.of_run("sensors check", arguments, result, backend.renderer()),
        }
        for name, content in files.items():
            folder.write(name, content)
    return result
