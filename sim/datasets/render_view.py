"""The files of a plan's view: a pure function of plan and number."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from starling.sim.captures import info as capture_info
from starling.sim.captures import png, writer
from starling.sim.captures.info import CaptureInfo
from starling.sim.commands.simulate_captures import facts, indirectly_lit, rgb
from starling.sim.datasets import stages
from starling.sim.datasets.files import Files
from starling.sim.datasets.plan import Plan
from starling.sim.datasets.source import Word
from starling.sim.datasets.stages import Set
from starling.sim.datasets.view import View, view
from starling.sim.effects import setting as setting
from starling.sim.geometry.frames import Pose
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene.scene import Scene
from starling.sim.sensor import edits, presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot, sequence

_SAMPLES = 16  # Paths a coarse pixel where a plan asks for none: then nothing is indirect.

Row = dict[str, Any]  # Of the index.


@dataclass(frozen=True, kw_only=True, slots=True)
class Taken:
    """One view's files, by path in the capture set, and its frames' rows of the index."""

    name: str
    files: Mapping[str, bytes]
    rows: tuple[Row, ...]


def take(plan: Plan, number: int, info: CaptureInfo, out: Path) -> Taken:
    """Take a view's frames.

    Args:
        plan: whose.
        number: of the view.
        info: camera of the set; one of another geometry is written beside the view.
        out: where the set will stand: paths of meshes are written from there.

    Raises:
        InputError: if a scene's file is missing or damaged.
    """
    one = view(plan, number)
    sensor = camera(one)
    found = stages.of(one.setting, one.preset)
    stage = posed(found.stage, one, samples=plan.samples)
    files = Files(out)
    own = info_of(sensor)
    if own != info:
        files.write(f"{one.name}/{capture_info.OWN}", capture_info.dumps(own))
    rows = []
    shots = sequence(
        stage, sensor, frames=plan.frames, seed=one.seed, samples=plan.samples or _SAMPLES
    )
    told = 0  # Files that rows tell of: a view's own stand in that of its first frame.
    for repeat, shot in enumerate(shots):
        if repeat == 0:
            _write_view(files, plan, one, stage.scene, sensor, shot)
        _write_frame(files, plan, one, repeat, sensor, stage.scene, found, shot)
        new = dict(list(files.content.items())[told:])
        told += len(new)
        rows.append(_row(plan, one, repeat, shot, new))
    return Taken(name=one.name, files=files.content, rows=tuple(rows))


def camera(one: View) -> Sensor:
    """The sensor of a view.

    Raises:
        InputError: for values that it cannot have together.
    """
    sensor = edits.with_values(presets.load(one.preset), one.fields.items())
    return setting.on_sensor(sensor, one.effects)


def posed(stage: Stage, one: View, *, samples: int) -> Stage:
    """The scene as a view's camera stands before it, with its effects on the scene."""
    scene = indirectly_lit(setting.on_scene(stage.scene, one.effects), samples)
    pose = scene.world_from_left @ one.own_from_left
    return stage.of(dataclasses.replace(scene, world_from_left=pose))


def info_of(sensor: Sensor) -> CaptureInfo:
    """What a set says of the camera of its captures."""
    return writer.info_of(
        sensor, source="starling generate", licence="as the scenes'", notes="simulated"
    )


def _write_view(
    files: Files, plan: Plan, one: View, scene: Scene, sensor: Sensor, shot: Shot
) -> None:
    truth = "truth" in plan.layers
    writer.write_scene(
        files,
        one.name,
        room=one.room,
        truth_m=shot.layers.truth.depth_m if truth else None,
        depth_unit_m=sensor.post.depth_unit_m,
        known=_known(one, scene.world_from_left, files.path),
    )
    if truth:
        label = shot.layers.left.body.astype(np.uint16)
        files.write(f"{one.name}/label.png", png.encode(label))


def _known(one: View, world_from_left: Pose, out: Path) -> Any:
    if not isinstance(one.setting, Word) or not one.setting.known:
        return None
    from starling.sim.scene.captured import known_geometry

    return known_geometry.describe(one.setting.text, world_from_left, out / one.name)


def _write_frame(
    files: Files,
    plan: Plan,
    one: View,
    repeat: int,
    sensor: Sensor,
    scene: Scene,
    found: Set,
    shot: Shot,
) -> None:
    left_from_world = np.linalg.inv(scene.world_from_left)
    writer.write_frame(
        files,
        one.name,
        repeat,
        depth=shot.depth,
        depth_unit_m=sensor.post.depth_unit_m,
        infrared=(shot.ir_left, shot.ir_right) if "infrared" in plan.layers else None,
        colour=rgb(scene, sensor) if repeat == 0 and "rgb" in plan.layers else None,
        reasons="reason" in plan.layers,
        layers=shot.layers if "exr" in plan.layers else None,
        facts={
            **facts(shot, sensor),
            "seed": one.seed,
            "view": one.number,
            "preset": Path(one.preset).stem,
            "set": dict(one.fields),
            "effects": dict(one.effects),
            "left_from_world": left_from_world.tolist(),
            "bodies": [body.name for body in scene.bodies],
            "objects": [
                {
                    "body": lying.name,
                    "mesh": lying.path.name,
                    "left_from_mesh": (left_from_world @ lying.world_from_mesh).tolist(),
                }
                for lying in found.lying
            ],
        },
    )


def _row(plan: Plan, one: View, repeat: int, shot: Shot, files: Mapping[str, bytes]) -> Row:
    return {
        "frame": one.number * plan.frames + repeat,
        "view": one.number,
        "scene": one.scene,
        "repeat": repeat,
        "name": f"{one.name}/{repeat}",
        "room": one.room,
        "sensor": Path(one.preset).stem,
        "seed": one.seed,
        "ndp_rate": float(1 - shot.depth.valid.mean()),
        "mean_dn": float(shot.ir_left.mean()),
        "exposure_s": shot.exposure_s,
        "gain": shot.gain,
        "files": sorted(files),
        "bytes": sum(map(len, files.values())),
        "sha256": fingerprint(files),
    }


def fingerprint(files: Mapping[str, bytes]) -> str:
    """SHA-256 of names and contents, in hexadecimal digits."""
    found = hashlib.sha256()
    for name in sorted(files):
        found.update(f"{name} {len(files[name])}\n".encode())
        found.update(files[name])
    return found.hexdigest()
