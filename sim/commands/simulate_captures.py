"""`starling simulate`: simulate scenes with a sensor and write a capture set."""

from __future__ import annotations

import dataclasses
import os
import time
import warnings
import zlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures import capture, writer
from starling.sim.console import names, progress
from starling.sim.console.output import OutputFolder, refuse_own_input
from starling.sim.effects import Value, setting
from starling.sim.render import backend
from starling.sim.scene.placing import AS_IN_FILE, AS_IN_SCENE, Placing, Viewpoint
from starling.sim.sensor.sensor import Sensor

_FARTHEST_CODE = 65535  # Largest code of a depth image.
_SAMPLES = 16  # Default number of paths per coarse pixel for indirect light.

if TYPE_CHECKING:  # Loads the renderer, which takes seconds.
    from starling.sim.geometry.frames import Pose
    from starling.sim.render.mitsuba_scene import MitsubaScene
    from starling.sim.scene.scene import Scene
    from starling.sim.scene.scene_file import SceneFile
    from starling.sim.simulate import Quality, Shot

    _Reading = tuple[Shot, Scene, NDArray[np.uint8] | None, int]


@dataclass(frozen=True, kw_only=True, slots=True)
class _Task:
    """One scene to simulate."""

    text: str  # Specifier for `starling.sim.scene.sources.load`.
    name: str
    room: str
    captured: bool  # Whether its geometry comes from captures.
    view: Viewpoint = AS_IN_SCENE


def simulate_captures(
    scene: str,
    sensor: Sensor,
    out: Path,
    *,
    further: Sequence[str] = (),
    frames: int = 1,
    seed: int = 0,
    samples: int = 0,
    quality: Quality = "full",
    effects: Mapping[str, Value] | None = None,
    empty: bool = False,
    force: bool = False,
    views: Sequence[Viewpoint] = (AS_IN_SCENE,),
    frame: Placing = AS_IN_FILE,
    options: Mapping[str, Any] | None = None,
    track: progress.Progress = progress.silent,
) -> dict[str, Any]:
    """Simulate scenes, or every scene of a capture set, and write a capture set.

    If the sensor has the geometry of captured scenes (see `starling.sim.sensor.resolve`), the
    simulated and the real images can be compared pixel by pixel.

    `scene.toml` holds the nominal geometry: the builtin name, or the path to the mesh or Mitsuba
    XML, and the left imager's pose (see `starling.sim.scene.captured.known_geometry.describe`).
    Effects on the scene (model errors, motion, other surfaces) change `truth.png` and the images,
    not `scene.toml`. Captures with a `scene.toml` are simulated from it, and it is copied.

    Args:
        scene: a capture set, one scene in it, a builtin name, a mesh or a Mitsuba XML.
        sensor: camera to simulate.
        out: folder to create.
        further: more builtin scenes or files of the set, each a room of its own.
        frames: frames per scene, each with independent noise.
        seed: seed of the whole set; each scene's seed is derived from it (see `scene_seed`).
        samples: paths per coarse pixel for indirect light; a value above 0 switches interreflection
            on. 0 uses 16 for scenes that have interreflection.
        quality: `draft` renders one position a pixel in place of four.
        effects: effects to set on the sensor and on every scene (see
            `starling.sim.effects.setting.apply`).
        empty: allow scenes without a visible surface.
        force: replace an earlier set.
        views: where the camera stands; each of several views becomes a scene of the set.
        frame: unit and up axis of a mesh file, where its own do not hold.
        options: further command-line options to record, as typed.
        track: wraps the loop over frames.

    Returns:
        `{"out", "files", "seconds", "scenes": {NAME: {"ndp_rate", "mean_dn", ...}}}`.

    Raises:
        InputError: if the scene, the sensor or the folder is invalid; no partial output remains.
    """
    from starling.sim.simulate import refuse_impossible

    frames = errors.whole_number("frames", frames, 1, 100_000, "Give a count inside.")
    samples = errors.whole_number("samples", samples, 0, 4096, "16 are enough for most scenes.")
    seed = errors.whole_number("seed", seed, 0, 2**63 - 1, "Give a whole number from 0.")
    started = time.perf_counter()
    effects = dict(setting.checked({} if effects is None else effects))
    camera = setting.on_sensor(sensor, effects)
    _refuse_samples_of_nothing(samples, effects)
    refuse_impossible(camera, frames)
    texts = (scene, *further)
    tasks, licence, notes = _tasks(texts, views, frame)
    for text in texts:
        _refuse_own_input(out, text)
    source = f"starling simulate {' '.join(texts)}"
    info = writer.info_of(camera, source=source, licence=licence, notes=notes)
    arguments = {
        "scene": list(texts) if further else scene,
        "frames": frames,
        "seed": seed,
        "samples": samples,
        "quality": quality,
    }
    with OutputFolder(out, force=force) as folder:
        figures = _write_scenes(
            folder,
            tasks,
            camera,
            effects,
            frame=frame,
            frames=frames,
            seed=seed,
            samples=samples,
            quality=quality,
            empty=empty,
            track=track,
        )
        writer.write_set(
            folder,
            info,
            camera,
            verb="simulate",
            arguments={**arguments, "effect": effects, **(options or {})},
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


def _refuse_samples_of_nothing(samples: int, effects: Mapping[str, Value]) -> None:
    """Refuse `samples` above 0 if an effect switches interreflection off."""
    for name, value in effects.items():
        effect, _ = setting.parameter_of(name)
        if samples and effect.name == "interreflection" and value == 0:
            raise errors.refuse(
                "samples", f"must be 0 where effect {name} is 0", samples, "Drop one of them."
            )


def _refuse_own_input(out: Path, scene: str) -> None:
    if capture.is_capture(scene):
        refuse_own_input(out, capture.open_set(scene).path)
    elif os.path.isfile(scene):
        refuse_own_input(out, scene)


def _tasks(
    texts: Sequence[str], views: Sequence[Viewpoint], frame: Placing
) -> tuple[list[_Task], str, str]:
    """List the scenes to simulate; return them with the licence and notes of the output."""
    scene = next(filter(capture.is_capture, texts), "")
    if not scene:
        tasks = [task for text in texts for task in _viewed(text, views)]
        if len({task.name for task in tasks}) < len(tasks):
            raise errors.refuse("scenes", "must differ in name", ", ".join(texts), "Rename one.")
        return tasks, "as the scene's", "simulated"
    if len(texts) > 1:
        rule, advice = "must not be one of several scenes", "Simulate it on its own."
        raise errors.refuse("a capture set", rule, scene, advice)
    if any(view.is_given for view in views) or frame != AS_IN_FILE:
        rule = "must not be given with captures"
        got, advice = repr(scene), "Captures have their own pose and metres."
        raise errors.refuse("pose, look-at, up, unit", rule, got, advice)
    real = capture.open_set(scene)
    tasks = [_Task(text=str(s.path), name=s.name, room=s.room, captured=True) for s in real.scenes]
    notes = "simulated; surfaces come from the captures named in source"
    return tasks, f"derived from captures under: {real.info.licence}", notes


def _viewed(text: str, views: Sequence[Viewpoint]) -> Iterator[_Task]:
    """List the views of a scene, which is one room."""
    path = Path(text)
    # A builtin name such as wall:2 becomes the folder name wall-2.
    room = names.scene_folder(path.stem) if path.exists() else text.replace(":", "-")
    digits = len(str(len(views) - 1))
    for number, view in enumerate(views):
        name = room if len(views) == 1 else f"{room}-{number:0{digits}}"
        yield _Task(text=text, name=name, room=room, captured=False, view=view)


def _write_scenes(
    folder: OutputFolder,
    tasks: list[_Task],
    sensor: Sensor,
    effects: Mapping[str, Value],
    *,
    frame: Placing,
    frames: int,
    seed: int,
    samples: int,
    quality: Quality,
    empty: bool,
    track: progress.Progress,
) -> dict[str, Any]:
    """Render each scene once, read it out `frames` times and write it; return figures by scene."""
    figures: dict[str, Any] = {}
    rates: dict[str, list[float]] = defaultdict(list)
    levels: dict[str, list[float]] = defaultdict(list)
    readings: Iterator[_Reading] = iter(())
    stages = _Stages(sensor, effects, frame, samples)
    for task, number in track(list(product(tasks, range(frames))), "simulate"):
        task_seed = scene_seed(seed, task.name)
        if number == 0:
            readings = _readings(stages.stage(task), sensor, frames, task_seed, samples, quality)
        shot, scene, picture, paths = next(readings)
        if number == 0:
            _check_truth(shot.layers.truth.depth_m, task.name, sensor, empty=empty)
            writer.write_scene(
                folder,
                task.name,
                room=task.room,
                truth_m=shot.layers.truth.depth_m,
                depth_unit_m=sensor.post.depth_unit_m,
                known=_known(task, scene.file_from_left, folder.path / task.name, frame),
            )
        writer.write_frame(
            folder,
            task.name,
            number,
            depth=shot.depth,
            depth_unit_m=sensor.post.depth_unit_m,
            infrared=(shot.ir_left, shot.ir_right),
            registered_m=shot.registered_m,
            colour=picture,
            layers=shot.layers,
            facts={
                **facts(shot, sensor),
                **({} if task.view.timestamp is None else {"timestamp": task.view.timestamp}),
                "seed": task_seed,
                "frame": number,
                "samples": paths,
            },
        )
        rates[task.name].append(1 - shot.depth.valid.mean())
        levels[task.name].append(shot.ir_left.mean())
        figures[task.name] = scene_figures(rates[task.name], levels[task.name], shot)
    return figures


def scene_figures(rates: Sequence[float], levels: Sequence[float], last: Shot) -> dict[str, Any]:
    """Return the printed figures of a scene.

    Args:
        rates: share of pixels without depth, by frame.
        levels: mean of the left infrared image, by frame [DN].
        last: last frame.
    """
    return {
        "ndp_rate": float(np.mean(rates)),
        "mean_dn": float(np.mean(levels)),
        "exposure_s": last.exposure_s,
        "reasons": writer.reason_counts(last.depth),
    }


def _check_truth(truth_m: NDArray[np.float32], name: str, sensor: Sensor, *, empty: bool) -> None:
    """Refuse a scene without a visible surface, and warn of surfaces beyond the depth image."""
    farthest_m = _FARTHEST_CODE * sensor.post.depth_unit_m
    seen = np.isfinite(truth_m)
    beyond = seen & (truth_m > farthest_m)
    if not empty and not (seen & ~beyond).any():
        what = f"surfaces beyond {farthest_m:g} m only" if beyond.any() else "no surface"
        advice = "Move the camera, scale the scene to metres, or give --empty."
        raise errors.refuse(name, "must have a surface in view", what, advice)
    if beyond.any():
        share = beyond.sum() / seen.sum()
        warnings.warn(
            f"{name}: {100 * share:.3g} % of the surface lies beyond {farthest_m:g} m, the end of "
            f"the depth image. truth.png is 0 there.",
            stacklevel=2,
        )


class _Stages:
    """Scenes to render; views of one scene share its surfaces."""

    def __init__(
        self, sensor: Sensor, effects: Mapping[str, Value], frame: Placing, samples: int
    ) -> None:
        self._sensor, self._effects = sensor, effects
        self._frame, self._samples = frame, samples
        self._shared: tuple[str, Scene, MitsubaScene] | None = None

    def stage(self, task: _Task) -> Scene | MitsubaScene:
        """Load the scene of a task, or see the last one from the task's view."""
        from starling.sim.scene import sources

        if not task.view.is_given:
            return self._changed(sources.load(task.text, self._sensor, self._frame))
        from starling.sim.render.mitsuba_scene import MitsubaScene, refuse_inside

        if self._shared is None or self._shared[0] != task.text:
            loaded = sources.load(task.text, self._sensor, self._frame, task.view)
            stage = MitsubaScene(self._changed(loaded))
            self._shared = task.text, loaded, stage
            return stage
        _, loaded, stage = self._shared
        stage = stage.with_scene(self._changed(task.view.seen(loaded)))
        refuse_inside(stage)
        return stage

    def _changed(self, scene: Scene) -> Scene:
        return indirectly_lit(setting.on_scene(scene, self._effects), self._samples)


def _readings(
    stage: Scene | MitsubaScene,
    sensor: Sensor,
    frames: int,
    seed: int,
    samples: int,
    quality: Quality,
) -> Iterator[_Reading]:
    """Render a scene once; yield each frame with the scene, its colour picture and paths."""
    from starling.sim.scene.scene import Scene
    from starling.sim.simulate import sequence

    scene = stage if isinstance(stage, Scene) else stage.scene
    paths = (samples or _SAMPLES) if scene.interreflection else 0
    picture = rgb(scene, sensor)
    shots = sequence(
        stage, sensor, frames=frames, seed=seed, samples=paths or _SAMPLES, quality=quality
    )
    for shot in shots:
        yield shot, scene, picture, paths


def _known(task: _Task, file_from_left: Pose, folder: Path, frame: Placing) -> SceneFile | None:
    from starling.sim.scene.captured import known_geometry

    if task.captured:
        return known_geometry.for_folder(capture.open_set(task.text).scenes[0], folder)
    return known_geometry.describe(task.text, file_from_left, folder, frame)


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
