"""`starling simulate`: simulate scenes with a sensor and write a capture set."""

from __future__ import annotations

import dataclasses
import os
import time
import zlib
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures import capture, writer
from starling.sim.console import progress
from starling.sim.console.output import OutputFolder, refuse_own_input
from starling.sim.effects import Value, setting
from starling.sim.render import backend
from starling.sim.sensor.sensor import Sensor

_SAMPLES = 16  # Default number of paths per coarse pixel for indirect light.

if TYPE_CHECKING:  # Loads the renderer, which takes seconds.
    from starling.sim.geometry.frames import Pose
    from starling.sim.scene.scene import Scene
    from starling.sim.scene.scene_file import SceneFile
    from starling.sim.simulate import Shot


@dataclass(frozen=True, kw_only=True, slots=True)
class _Plan:
    """Settings of the simulation that all scenes share."""

    sensor: Sensor
    frames: int
    seed: int
    samples: int
    effects: Mapping[str, Value]


@dataclass(frozen=True, kw_only=True, slots=True)
class _Task:
    """One scene to simulate."""

    text: str  # Specifier for `starling.sim.scene.sources.load`.
    name: str
    room: str
    captured: bool  # Whether its geometry comes from captures.


class _Reading(NamedTuple):
    """One frame of one scene."""

    task: _Task
    number: int
    shot: Shot
    rgb: NDArray[np.uint8] | None  # Colour picture, the same for all frames of a scene.
    samples: int  # Paths per coarse pixel for indirect light; 0 without indirect light.
    world_from_left: Pose


def simulate_captures(
    scene: str,
    sensor: Sensor,
    out: Path,
    *,
    frames: int = 1,
    seed: int = 0,
    samples: int = 0,
    effects: Mapping[str, Value] | None = None,
    force: bool = False,
    options: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Simulate one scene or every scene of a capture set, and write a capture set.

    If the sensor has the geometry of captured scenes (see `starling.sim.sensor.resolve`), the
    simulated and the real images can be compared pixel by pixel.

    `scene.toml` holds the nominal geometry: the builtin name, or the path to the mesh or Mitsuba
    XML, and the left imager's pose (see `starling.sim.scene.captured.known_geometry.describe`).
    Effects on the scene (model errors, motion, other surfaces) change `truth.png` and the images,
    not `scene.toml`. Scenes from captures have no `scene.toml`.

    Args:
        scene: a capture set, one scene in it, a builtin name, a mesh or a Mitsuba XML.
        sensor: camera to simulate.
        out: folder to create.
        frames: frames per scene, each with independent noise.
        seed: seed of the whole set; each scene's seed is derived from it (see `scene_seed`).
        samples: paths per coarse pixel for indirect light; a value above 0 switches interreflection
            on. 0 uses 16 for scenes that have interreflection.
        effects: effects to set on the sensor and on every scene (see
            `starling.sim.effects.setting.apply`).
        force: replace an earlier set.
        options: further command-line options to record, as typed.
        track: wraps the loop over frames.

    Returns:
        `{"out", "files", "seconds", "scenes": {NAME: {"ndp_rate", "mean_dn", ...}}}`.

    Raises:
        InputError: if the scene, the sensor or the folder is invalid; no partial output remains.
    """
    from starling.sim.simulate import refuse_impossible

    errors.in_interval("frames", frames, 1, 100_000, "Take at least one.")
    errors.in_interval("samples", samples, 0, 4096, "16 are enough for most scenes.")
    errors.in_interval("seed", seed, 0, 2**63 - 1, "Give a whole number from 0.")
    started = time.perf_counter()
    plan = _Plan(
        sensor=setting.on_sensor(sensor, effects or {}),
        frames=frames,
        seed=seed,
        samples=samples,
        effects=effects or {},
    )
    _refuse_samples_of_nothing(plan)
    refuse_impossible(plan.sensor, frames)
    tasks, licence, notes = _tasks(scene)
    _refuse_own_input(out, scene)
    info = writer.info_of(
        plan.sensor, source=f"starling simulate {scene}", licence=licence, notes=notes
    )
    with OutputFolder(out, force=force) as folder:
        figures = _write_scenes(folder, _shots(tasks, plan, track), plan)
        arguments = {
            "scene": scene,
            "frames": frames,
            "seed": seed,
            "samples": samples,
            "effect": dict(plan.effects),
        }
        writer.write_set(
            folder,
            info,
            plan.sensor,
            verb="simulate",
            arguments={**arguments, **(options or {})},
            figures=figures,
            renderer=backend.renderer(),
        )
    return {
        "out": str(folder.path),
        "files": sum(path.is_file() for path in folder.path.rglob("*")),
        "seconds": round(time.perf_counter() - started, 3),
        "scenes": figures,
    }


def scene_seed(seed: int, name: str) -> int:
    """Return the seed of one scene of a set, so that noise is independent between scenes.

    It is below 2^53, so that every JSON reader represents it exactly.
    """
    words = np.random.SeedSequence([seed, zlib.crc32(name.encode())])
    return int(words.generate_state(1, np.uint64)[0] >> np.uint64(11))


def _refuse_samples_of_nothing(plan: _Plan) -> None:
    """Refuse `samples` above 0 if an effect switches interreflection off."""
    for name, value in plan.effects.items():
        effect, _ = setting.parameter_of(name)
        if plan.samples and effect.name == "interreflection" and value == 0:
            raise errors.refuse(
                "samples",
                f"must be 0 where effect {name} is 0",
                plan.samples,
                "Drop one of them.",
            )


def _refuse_own_input(out: Path, scene: str) -> None:
    if capture.is_capture(scene):
        refuse_own_input(out, capture.open_set(scene).path)
    elif os.path.isfile(scene):
        refuse_own_input(out, scene)


def _tasks(scene: str) -> tuple[list[_Task], str, str]:
    """List the scenes to simulate; return them with the licence and notes of the output."""
    if capture.is_capture(scene):
        real = capture.open_set(scene)
        tasks = [
            _Task(text=str(s.path), name=s.name, room=s.room, captured=True) for s in real.scenes
        ]
        notes = "simulated; geometry and reflectance come from the captures named in source"
        return tasks, f"derived from captures under: {real.info.licence}", notes
    path = Path(scene)
    # A builtin name such as wall:2 becomes the folder name wall-2.
    name = path.stem if path.exists() else scene.replace(":", "-")
    task = _Task(text=scene, name=name, room=name, captured=False)
    return [task], "as the scene's", "simulated"


def _write_scenes(
    folder: OutputFolder,
    shots: Iterator[_Reading],
    plan: _Plan,
) -> dict[str, Any]:
    """Write every shot, and the reference depth with a scene's first; return figures by scene."""
    rates: dict[str, list[float]] = defaultdict(list)
    levels: dict[str, list[float]] = defaultdict(list)
    figures: dict[str, Any] = {}
    for task, number, shot, picture, samples, world_from_left in shots:
        if number == 0:
            writer.write_scene(
                folder,
                task.name,
                room=task.room,
                truth_m=shot.layers.truth.depth_m,
                depth_unit_m=plan.sensor.post.depth_unit_m,
                known=_known(task, world_from_left, folder.path / task.name),
            )
        more = {
            "seed": scene_seed(plan.seed, task.name),
            "frame": number,
            "samples": samples,
        }
        _write_shot(folder, task.name, number, shot, plan.sensor, picture, more)
        rates[task.name].append(1 - shot.depth.valid.mean())
        levels[task.name].append(shot.ir_left.mean())
        figures[task.name] = {
            "ndp_rate": float(np.mean(rates[task.name])),
            "mean_dn": float(np.mean(levels[task.name])),
            "exposure_s": shot.exposure_s,
            "reasons": writer.reason_counts(shot.depth),
        }
    return figures


def _known(task: _Task, world_from_left: Pose, folder: Path) -> SceneFile | None:
    if task.captured:
        return None
    from starling.sim.scene.captured import known_geometry

    return known_geometry.describe(task.text, world_from_left, folder)


def _shots(tasks: list[_Task], plan: _Plan, track: progress.Progress) -> Iterator[_Reading]:
    """Yield every frame of every scene; each scene is rendered once, read out `frames` times."""
    from starling.sim.simulate import sequence

    shots: Iterator[Shot] = iter(())
    picture, samples, world_from_left = None, 0, np.eye(4)
    for task, number in track(list(product(tasks, range(plan.frames))), "simulate"):
        if number == 0:
            scene = _scene(task.text, plan)
            picture, world_from_left = rgb(scene, plan.sensor), scene.world_from_left
            samples = (plan.samples or _SAMPLES) if scene.interreflection else 0
            shots = sequence(
                scene,
                plan.sensor,
                frames=plan.frames,
                seed=scene_seed(plan.seed, task.name),
                samples=samples or _SAMPLES,
            )
        yield _Reading(task, number, next(shots), picture, samples, world_from_left)


def _scene(text: str, plan: _Plan) -> Scene:
    from starling.sim.scene import sources

    scene = setting.on_scene(sources.load(text, plan.sensor), plan.effects)
    return indirectly_lit(scene, plan.samples)


def indirectly_lit(scene: Scene, samples: int) -> Scene:
    """Switch interreflection on if `samples` is above 0 and the scene has none."""
    if not samples or scene.interreflection:
        return scene
    return dataclasses.replace(scene, interreflection=1.0)


def facts(shot: Shot, sensor: Sensor) -> dict[str, Any]:
    """Return the exposure entries of `frame.json`."""
    return {
        "exposure_s": shot.exposure_s,
        "gain": shot.gain,
        "laser_power": sensor.projector.power_w,
        "counts": "repeats",
    }


def rgb(scene: Scene, sensor: Sensor) -> NDArray[np.uint8] | None:
    """Render the picture of the sensor's colour camera; None without a colour camera."""
    if sensor.colour is None:
        return None
    from starling.sim.imaging import colour_picture

    return colour_picture.picture(scene, sensor)


def _write_shot(
    folder: OutputFolder,
    scene: str,
    number: int,
    shot: Shot,
    sensor: Sensor,
    picture: NDArray[np.uint8] | None,
    more: Mapping[str, Any],
) -> None:
    writer.write_frame(
        folder,
        scene,
        number,
        depth=shot.depth,
        depth_unit_m=sensor.post.depth_unit_m,
        infrared=(shot.ir_left, shot.ir_right),
        registered_m=shot.registered_m,
        colour=picture,
        layers=shot.layers,
        facts={**facts(shot, sensor), **more},
    )
