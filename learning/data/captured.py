"""Scenes of a capture set as examples: reference depth, the device's holes, what is simulated."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from starling.learning.data import physics_file
from starling.learning.data.example import Example, Image, Mask, Physics
from starling.learning.data.learnable import known_holes
from starling.patterns.errors import InputError, one_of, refuse
from starling.sim.captures.capture import CapturedScene, CaptureSet
from starling.sim.commands.simulate_captures import scene_seed
from starling.sim.console import progress, record
from starling.sim.scene.captured import captured_scene, depth_surface, known_geometry
from starling.sim.scene.scene import Material, Scene
from starling.sim.sensor.sensor import Sensor

SMOOTHING_PX = 12.0  # Of the infrared image that is reflectance: no dot is left in it.
LEFT_BAND = 100 / 1280  # Share of the columns that have no match in the right image, or few.
DRAWS = 8  # Of noise and speckle.
_EVEN = 0.5  # Reflectance where none may be known.
_MADE = 4  # How physics is made; raised when the same sensor and scene would give another.


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class Simulation:
    """How examples get their physics."""

    sensor: Sensor
    draws: int = DRAWS
    seed: int = 0
    even: bool = False  # Reflectance is one number, as if no image of the scene were known.
    cache: Path | None = None  # Folder that keeps what was simulated.


def examples(
    captures: CaptureSet,
    *,
    rooms: Sequence[str] | None = None,
    simulation: Simulation | None = None,
    track: progress.Progress = progress.silent,
) -> list[Example]:
    """Read scenes whose holes are known.

    Args:
        captures: with reference depth and the device's own.
        rooms: those that are read; None reads all.
        simulation: gives the examples physics; None leaves it out.
        track: wraps the loop over scenes.

    Raises:
        InputError: if a room is unknown, or whatever is wrong with a scene.
    """
    check_rooms(captures, rooms or ())
    wanted = [scene for scene in captures.scenes if rooms is None or scene.room in rooms]
    return [example(scene, simulation=simulation) for scene in track(wanted, "scenes")]


def check_rooms(captures: CaptureSet, rooms: Sequence[str]) -> None:
    """Refuse rooms that the captures do not have.

    Raises:
        InputError: if there is one.
    """
    there = sorted({scene.room for scene in captures.scenes})
    for room in rooms:
        one_of("room", room, there)


def example(scene: CapturedScene, *, simulation: Simulation | None = None) -> Example:
    """Read one scene of a capture set.

    Of its infrared only the left image is used, smoothed by a Gaussian of 12 px, as reflectance.

    Raises:
        InputError: if it has no reference depth or none of the device's own.
    """
    truth_m, frame = _reference(scene), scene.frame(scene.frames[0])
    if frame.depth_m is None:
        raise _incomplete(scene, "depth.png")
    reflectance = None
    if frame.ir_left is not None:
        reflectance = captured_scene.brightness(scene, smoothing_px=SMOOTHING_PX)
    plain = Example(
        scene=scene.name,
        room=scene.room,
        info=scene.info,
        depth_m=truth_m,
        reflectance=reflectance,
        ndp=np.isnan(frame.depth_m),
        counted=counted_pixels(scene, truth_m),
    )
    if simulation is None:
        return plain
    return dataclasses.replace(plain, physics=_physics(scene, plain, simulation))


def _reference(scene: CapturedScene) -> Image:
    truth_m = scene.truth_m()
    if truth_m is None:
        raise _incomplete(scene, "truth.png")
    return truth_m


def _incomplete(scene: CapturedScene, missing: str) -> InputError:
    return refuse(
        f"scene {scene.name}",
        "must have reference depth and the device's own",
        f"no {missing}",
        "Leave it out, or capture both.",
    )


def counted_pixels(scene: CapturedScene, truth_m: Image) -> Mask:
    """Where a hole counts, (h, w): known reference, right of the left band."""
    where = np.isfinite(truth_m)
    where[:, : round(LEFT_BAND * scene.info.width)] = False
    return where


def surface(scene: CapturedScene, sensor: Sensor, *, even: bool = False) -> Scene:
    """What is known of a scene: its model where there is one, else its reference depth.

    Args:
        scene: of a capture set.
        sensor: that the captures are of.
        even: reference depth gets one reflectance all over.
    """
    believed = known_geometry.load(scene, sensor)
    if believed is not None:
        return believed
    if not even:
        return captured_scene.load(
            scene.path, sensor, smoothing_px=SMOOTHING_PX, within_surfaces=True
        )
    plain = Material(name="even", reflectance=_EVEN)
    disparity_px = scene.info.disparity_px(_reference(scene))
    return depth_surface.scene(scene.name, disparity_px, scene.info, plain)


def sensor_digest(sensor: Sensor) -> str:
    """Name of a sensor that changes with any of its numbers and with its patterns' images."""
    light = sensor.projector
    found = hashlib.sha256(repr(sensor).encode())
    for path in sorted({light.pattern, *(emitter.pattern for emitter in light.emitters)}):
        found.update(Path(path).read_bytes() if Path(path).suffix else b"")
    return found.hexdigest()[:16]


def _physics(scene: CapturedScene, plain: Example, simulation: Simulation) -> Physics:
    key = _digest(scene, plain, simulation) if simulation.cache else ""
    if simulation.cache and (kept := physics_file.read(simulation.cache, key)):
        return kept
    from starling.learning.data import simulated  # Loads the renderer, which takes seconds.

    made = simulated.physics(
        surface(scene, simulation.sensor, even=simulation.even),
        simulation.sensor,
        draws=simulation.draws,
        seed=scene_seed(simulation.seed, scene.name),
    )
    if simulation.cache:
        physics_file.write(simulation.cache, key, made)
    return made


def _digest(scene: CapturedScene, plain: Example, simulation: Simulation) -> str:
    """Name that changes when anything does that the simulation depends on."""
    drawn = (simulation.draws, simulation.seed, simulation.even)
    how = (_MADE, sensor_digest(simulation.sensor), *drawn)
    believed = scene.known()
    found = hashlib.sha256(f"{how} {record.versions()} {plain.info} {believed}".encode())
    if believed is not None and (scene.path / believed.scene).is_file():
        found.update((scene.path / believed.scene).read_bytes())
    for image in (plain.depth_m, plain.reflectance):
        found.update(b"" if image is None else np.ascontiguousarray(image).tobytes())
    return f"{scene.name}-{found.hexdigest()[:16]}"


def ndp_rate(learnt_from: Sequence[Example]) -> float:
    """Share of the counted pixels without depth, 0 to 1; scenes count alike."""
    holes = [ndp[counted].mean() for ndp, counted in map(known_holes, learnt_from)]
    return float(np.mean(holes))


def caching(simulation: Simulation, folder: Path) -> Simulation:
    """Keep what is simulated in a folder, unless it is kept somewhere already."""
    return simulation if simulation.cache else dataclasses.replace(simulation, cache=folder)
