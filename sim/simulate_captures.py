"""The work of `starling simulate`: scenes and a sensor in, a capture set on disk out."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from patterns import errors
from sim import capture, capture_writer, progress
from sim.output import OutputFolder
from sim.sensor import Sensor


@dataclass(frozen=True, kw_only=True, slots=True)
class _Task:
    """One scene to simulate."""

    text: str  # What `sim.scenes.load` takes.
    name: str
    room: str


def simulate_captures(
    scene: str,
    sensor: Sensor,
    out: Path,
    *,
    frames: int = 1,
    seed: int = 0,
    samples: int = 0,
    force: bool = False,
    tell: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Simulate one scene or every scene of a capture set and write a capture set.

    A sensor with the geometry of captured scenes (see `sim.sensor_edits.asked_for`) makes
    images that can be compared with the real ones pixel by pixel.

    Args:
        scene: a capture set, one scene in it, a builtin name, a mesh or a Mitsuba XML.
        sensor: what sees it.
        out: folder to make.
        frames: readings of each scene, with noise of their own.
        seed: of the whole set.
        samples: paths a pixel of indirect light; 0 leaves it out.
        force: replace a set made before.
        tell: wraps the loop over scenes.

    Returns:
        `{"out", "files", "seconds", "scenes": {NAME: {"ndp_rate", "mean_dn", ...}}}`.

    Raises:
        InputError: whatever is wrong with the scene, the sensor or the folder; nothing is left.
    """
    from sim import scenes

    errors.in_interval("frames", frames, 1, 100_000, "Take at least one.")
    started = time.perf_counter()
    tasks, licence, notes = _tasks(scene)
    info = capture_writer.info_of(
        sensor, source=f"starling simulate {scene}", licence=licence, notes=notes
    )
    figures: dict[str, Any] = {}
    with OutputFolder(out, force=force) as folder:
        for task in tell(tasks, "simulate"):
            figures[task.name] = _write_scene(
                folder, task, scenes.load(task.text, sensor), sensor, frames, seed, samples
            )
        capture_writer.write_set(
            folder,
            info,
            sensor,
            verb="simulate",
            arguments={"scene": scene, "frames": frames, "seed": seed, "samples": samples},
            figures=figures,
        )
    return {
        "out": str(folder.path),
        "files": sum(path.is_file() for path in folder.path.rglob("*")),
        "seconds": round(time.perf_counter() - started, 3),
        "scenes": figures,
    }


def _tasks(scene: str) -> tuple[list[_Task], str, str]:
    """List the scenes to simulate, and the licence and notes of what comes out."""
    if capture.is_capture(scene):
        real = capture.open_set(scene)
        tasks = [_Task(text=str(s.path), name=s.name, room=s.room) for s in real.scenes]
        notes = "simulated; geometry and reflectance come from the captures named in source"
        return tasks, f"derived from captures under: {real.info.licence}", notes
    path = Path(scene)
    name = path.stem if path.exists() else scene.replace(":", "-")  # A file, or a builtin name.
    return [_Task(text=scene, name=name, room=name)], "as the scene's", "simulated"


def _write_scene(
    folder: OutputFolder,
    task: _Task,
    scene: Any,
    sensor: Sensor,
    frames: int,
    seed: int,
    samples: int,
) -> dict[str, Any]:
    """Render a scene once, read it out `frames` times, write all; return the scene's figures."""
    from sim.simulate import expose, simulate

    unit = sensor.post.depth_unit_m
    shot = simulate(scene, sensor, seed=seed, frame=0, samples=samples)
    capture_writer.write_scene(
        folder,
        task.name,
        room=task.room,
        truth_m=shot.layers.truth.depth_m,
        depth_unit_m=unit,
    )
    rates, levels = [], []
    for number in range(frames):
        if number > 0:
            shot = expose(shot.layers, sensor, seed=seed, frame=number)
        capture_writer.write_frame(
            folder,
            task.name,
            number,
            depth=shot.depth,
            depth_unit_m=unit,
            infrared=(shot.ir_left, shot.ir_right),
            layers=shot.layers,
            facts={
                "exposure_s": shot.exposure_s,
                "gain": shot.gain,
                "laser_power": sensor.projector.power_w,
                "counts": "repeats",
                "seed": seed,
                "frame": number,
                "samples": samples,
            },
        )
        rates.append(1 - shot.depth.valid.mean())
        levels.append(shot.ir_left.mean())
    return {
        "ndp_rate": float(np.mean(rates)),
        "mean_dn": float(np.mean(levels)),
        "exposure_s": shot.exposure_s,
        "reasons": capture_writer.reason_counts(shot.depth),
    }
