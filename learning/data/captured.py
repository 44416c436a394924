"""Scenes of a capture set as examples: reference depth, the device's holes, and simulation."""

from __future__ import annotations

import dataclasses
import hashlib
import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from starling.learning.data import estimated_reference
from starling.learning.data.example import Example, Image, Mask, Physics, known_holes
from starling.learning.data.physics import read_physics, write_physics
from starling.patterns.errors import InputError, one_of, refuse
from starling.sim.captures.capture import CapturedScene, CaptureSet
from starling.sim.commands.simulate_captures import scene_seed
from starling.sim.console import progress, record
from starling.sim.on_demand import OnDemand
from starling.sim.scene.captured import captured_scene, depth_surface, known_geometry
from starling.sim.scene.scene import Material, Scene
from starling.sim.sensor.sensor import Sensor

# Sigma that removes all dots from the infrared image, an input of the networks [px].
SMOOTHING_PX = 12.0
LEFT_BAND = 100 / 1280  # Share of the columns with few or no matches in the right image.
DRAWS = 8  # Simulated draws of noise and speckle.
_EVEN = 0.5  # Reflectance if no image is used.
_PHYSICS_VERSION = 5  # Version of the simulation, a part of the cache key.


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True)
class Simulation:
    """Settings of the simulation of examples."""

    sensor: Sensor
    draws: int = DRAWS
    seed: int = 0
    even: bool = False  # Use one reflectance for the whole scene, as if it had no image.
    cache: Path | None = None  # Folder of the cache.


def examples(
    captures: CaptureSet,
    *,
    rooms: Sequence[str] | None = None,
    simulation: Simulation | None = None,
    track: progress.Progress = progress.silent,
) -> Sequence[Example]:
    """Check scenes with known holes; they are read again when they are used.

    Memory thus does not grow with the number of scenes. Simulations without a cache are kept.
    Scenes without reference depth give a warning; see `example`.

    Args:
        captures: capture set with the device's depth, and reference depth if known.
        rooms: rooms to read; None reads all.
        simulation: adds physics to the examples; None leaves it out.
        track: wraps the loop over scenes.

    Raises:
        InputError: if a room is unknown, or a scene is invalid.
    """
    wanted = scenes_in(captures, rooms)
    warn_of_estimates(wanted)
    read = partial(example, simulation=simulation)
    if simulation is not None and simulation.cache is None:
        return [read(scene) for scene in track(wanted, "scenes")]
    for scene in track(wanted, "scenes"):
        read(scene)  # Refuses a damaged scene, and fills the cache.
    return OnDemand(wanted, read)


def scenes_in(captures: CaptureSet, rooms: Sequence[str] | None) -> list[CapturedScene]:
    """Return the scenes of some rooms; all where `rooms` is None.

    Raises:
        InputError: as `check_rooms`.
    """
    check_rooms(captures, rooms or ())
    return [scene for scene in captures.scenes if rooms is None or scene.room in rooms]


def check_rooms(captures: CaptureSet, rooms: Sequence[str]) -> None:
    """Refuse rooms that are not in the captures.

    Raises:
        InputError: if a room is unknown.
    """
    known = sorted({scene.room for scene in captures.scenes})
    for room in rooms:
        one_of("room", room, known)


def warn_of_estimates(scenes: Sequence[CapturedScene]) -> None:
    """Warn of scenes whose reference depth is estimated."""
    bare = [scene.name for scene in scenes if not (scene.path / "truth.png").is_file()]
    if bare:
        warnings.warn(
            f"{len(bare)} of {len(scenes)} scenes have no truth.png, {bare[0]} first. "
            "Their reference depth is estimated from depth.png.",
            stacklevel=3,
        )


def example(scene: CapturedScene, *, simulation: Simulation | None = None) -> Example:
    """Read one scene of a capture set.

    Reflectance is the left infrared image, smoothed by a Gaussian of 12 px. Without truth.png the
    reference depth is estimated; see `estimated_reference`.

    Raises:
        InputError: if it has no depth of the device. Also if the simulated sensor is of another
            kind or image size.
    """
    if simulation is not None:
        scene.refuse_other_sensor(simulation.sensor)
    frame = scene.frame(scene.frames[0])
    if frame.depth_m is None:
        raise _without_depth(scene)
    truth_m = _reference(scene)
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
    if truth_m is not None:
        return truth_m
    depth_m = scene.frame(scene.frames[0]).depth_m
    if depth_m is None:
        raise _without_depth(scene)
    return estimated_reference.estimate(depth_m, scene.info)


def _without_depth(scene: CapturedScene) -> InputError:
    rule, remedy = "must have the device's depth", "Leave it out, or capture it."
    return refuse(f"scene {scene.name}", rule, "no depth.png", remedy)


def counted_pixels(scene: CapturedScene, truth_m: Image) -> Mask:
    """Return where holes count, (h, w): known reference, right of the left band."""
    where = np.isfinite(truth_m)
    where[:, : round(LEFT_BAND * scene.info.width)] = False
    return where


def surface(scene: CapturedScene, sensor: Sensor, *, even: bool = False) -> Scene:
    """Return the scene to simulate: its model if there is one, else a mesh of its reference depth.

    The mesh has the reflectance that `starling simulate` gives it.

    Args:
        scene: scene of a capture set.
        sensor: sensor of the captures.
        even: use one reflectance for the whole mesh.
    """
    known_scene = known_geometry.load(scene, sensor)
    if known_scene is not None:
        return known_scene
    if not even:
        return captured_scene.load(scene.path, sensor)
    plain = Material(name="even", reflectance=_EVEN)
    disparity_px = scene.info.disparity_px(_reference(scene))
    return depth_surface.scene(scene.name, disparity_px, scene.info, plain)


def sensor_digest(sensor: Sensor) -> str:
    """Checksum of a sensor, including the files of its patterns."""
    projector = sensor.projector
    digest = hashlib.sha256(repr(sensor).encode())
    for path in sorted({projector.pattern, *(emitter.pattern for emitter in projector.emitters)}):
        digest.update(Path(path).read_bytes() if Path(path).suffix else b"")
    return digest.hexdigest()[:16]


def _physics(scene: CapturedScene, plain: Example, simulation: Simulation) -> Physics:
    key = _digest(scene, plain, simulation) if simulation.cache else ""
    if simulation.cache and (cached := read_physics(simulation.cache, key)):
        return cached
    from starling.learning.data import simulated  # Importing the renderer takes seconds.

    physics = simulated.physics(
        surface(scene, simulation.sensor, even=simulation.even),
        simulation.sensor,
        draws=simulation.draws,
        seed=scene_seed(simulation.seed, scene.name),
    )
    if simulation.cache:
        write_physics(simulation.cache, key, physics)
    return physics


def _digest(scene: CapturedScene, plain: Example, simulation: Simulation) -> str:
    """Cache key that depends on all inputs of the simulation."""
    drawn = (simulation.draws, simulation.seed, simulation.even)
    settings = (_PHYSICS_VERSION, sensor_digest(simulation.sensor), *drawn)
    known_scene = scene.known()
    digest = hashlib.sha256(f"{settings} {record.versions()} {plain.info} {known_scene}".encode())
    if known_scene is not None and (scene.path / known_scene.scene).is_file():
        digest.update((scene.path / known_scene.scene).read_bytes())
    frame = scene.fullest()
    pairs = (frame.ir_left, frame.ir_right, frame.ir_left_off, frame.ir_right_off)
    for image in (plain.depth_m, *pairs):
        digest.update(b"" if image is None else np.ascontiguousarray(image).tobytes())
    return f"{scene.name}-{digest.hexdigest()[:16]}"


def ndp_rate(training_examples: Sequence[Example]) -> float:
    """Mean share of counted pixels without depth, 0 to 1; each scene has the same weight."""
    holes = [ndp[counted].mean() for ndp, counted in map(known_holes, training_examples)]
    return float(np.mean(holes))


def caching(simulation: Simulation, folder: Path) -> Simulation:
    """Set the cache folder of a simulation that has none."""
    return simulation if simulation.cache else dataclasses.replace(simulation, cache=folder)
