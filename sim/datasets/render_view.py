"""Rendering of a plan's view: its files are a pure function of plan and number."""

from __future__ import annotations

import dataclasses
import hashlib
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from starling.sim.captures import info as capture_info
from starling.sim.captures import png, writer
from starling.sim.captures.info import CaptureInfo
from starling.sim.commands.simulate_captures import facts, indirectly_lit, rgb
from starling.sim.datasets import mesh_pile
from starling.sim.datasets.mesh_pile import RestingMesh
from starling.sim.datasets.plan import Plan, PlannedView, view
from starling.sim.datasets.source import Pile, SceneSpecifier, Setting
from starling.sim.effects import setting
from starling.sim.files import file_digest
from starling.sim.geometry.frames import Pose
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import sources
from starling.sim.scene.scene import Scene
from starling.sim.sensor import edits, presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot, sequence

_SAMPLES = 16  # Paths per coarse pixel if the plan sets none; unused without indirect light.

Row = dict[str, Any]  # Row of the index.


@dataclass(frozen=True, kw_only=True, slots=True)
class RenderedView:
    """One view's files, by path in the capture set, and the index rows of its frames."""

    name: str
    files: Mapping[str, bytes]  # Empty if they are on disk.
    rows: tuple[Row, ...]
    staged: Path | None = None  # Folder that holds the files.


def render(
    plan: Plan, number: int, info: CaptureInfo, out: Path, *, on_disk: bool = False
) -> RenderedView:
    """Render a view's frames.

    Args:
        plan: plan of the data set.
        number: number of the view.
        info: camera of the set; a different camera is written to the view's folder.
        out: folder of the set; paths of meshes are written relative to it.
        on_disk: write each frame's files to a folder in `out` at once, so that the memory does not
            grow with the frames.

    Raises:
        InputError: if a scene's file is missing or damaged.
        OSError: if a file cannot be written.
    """
    planned = view(plan, number)
    sensor = camera(planned)
    loaded = load_scene(planned.setting, planned.preset, planned.mode)
    stage = posed(loaded.stage, planned, samples=plan.samples)
    files = MemoryFolder(out)
    view_info = info_of(sensor)
    if view_info != info:
        files.write(f"{planned.name}/{capture_info.OWN}", capture_info.dumps(view_info))
    rows, written = [], {}
    # Named by the process: a process that outlives its run never writes to the folder of another.
    staged = out / f".{planned.name}.{os.getpid()}.partial" if on_disk else None
    shots = sequence(
        stage, sensor, frames=plan.frames, seed=planned.seed, samples=plan.samples or _SAMPLES
    )
    for repeat, shot in enumerate(shots):
        if repeat == 0:
            _write_view(files, plan, planned, stage.scene, sensor, shot)
        _write_frame(files, plan, planned, repeat, sensor, stage.scene, loaded, shot)
        new = files.take()  # The first frame's row lists the view's shared files.
        rows.append(_row(plan, planned, repeat, shot, new))
        if staged is None:
            written |= new
        else:
            write_files(staged, planned.name, new)
    return RenderedView(name=planned.name, files=written, rows=tuple(rows), staged=staged)


def write_files(folder: Path, name: str, files: Mapping[str, bytes]) -> None:
    """Write a view's files to a folder that is not yet in its place.

    Args:
        folder: the folder.
        name: name of the view; paths of the files begin with it.
        files: contents by path in the capture set.

    Raises:
        OSError: if a file cannot be written.
    """
    for path, data in files.items():
        file = folder / Path(path).relative_to(name)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(data)


def camera(planned: PlannedView) -> Sensor:
    """Return the sensor of a view.

    Raises:
        InputError: if the drawn values are invalid in combination.
    """
    device = presets.load(planned.preset, mode=planned.mode)
    sensor = edits.with_values(device, planned.fields.items())
    return setting.on_sensor(sensor, planned.effects)


def posed(stage: MitsubaScene, planned: PlannedView, *, samples: int) -> MitsubaScene:
    """Return the scene with a view's effects and camera pose."""
    scene = indirectly_lit(setting.on_scene(stage.scene, planned.effects), samples)
    pose = scene.world_from_left @ planned.own_from_left
    return stage.with_scene(dataclasses.replace(scene, world_from_left=pose))


def info_of(sensor: Sensor) -> CaptureInfo:
    """Return the capture info of a set's camera."""
    return writer.info_of(
        sensor, source="starling generate", licence="as the scenes'", notes="simulated"
    )


def _write_view(
    files: MemoryFolder, plan: Plan, planned: PlannedView, scene: Scene, sensor: Sensor, shot: Shot
) -> None:
    truth = "truth" in plan.layers
    writer.write_scene(
        files,
        planned.name,
        room=planned.room,
        truth_m=shot.layers.truth.depth_m if truth else None,
        depth_unit_m=sensor.post.depth_unit_m,
        known=_known(planned, scene.file_from_left, files.path),
    )
    if truth:
        label = shot.layers.left.body.astype(np.uint16)
        files.write(f"{planned.name}/label.png", png.encode(label))


def _known(planned: PlannedView, file_from_left: Pose, out: Path) -> Any:
    if not isinstance(planned.setting, SceneSpecifier) or not planned.setting.known:
        return None
    from starling.sim.scene.captured import known_geometry

    return known_geometry.describe(planned.setting.text, file_from_left, out / planned.name)


def _write_frame(
    files: MemoryFolder,
    plan: Plan,
    planned: PlannedView,
    repeat: int,
    sensor: Sensor,
    scene: Scene,
    loaded: LoadedScene,
    shot: Shot,
) -> None:
    left_from_world = np.linalg.inv(scene.world_from_left)
    writer.write_frame(
        files,
        planned.name,
        repeat,
        depth=shot.depth,
        depth_unit_m=sensor.post.depth_unit_m,
        infrared=(shot.ir_left, shot.ir_right) if "infrared" in plan.layers else None,
        colour=rgb(scene, sensor) if repeat == 0 and "rgb" in plan.layers else None,
        reasons="reason" in plan.layers,
        layers=shot.layers if "exr" in plan.layers else None,
        facts={
            **facts(shot, sensor),
            "seed": planned.seed,
            "view": planned.number,
            "preset": planned.sensor,
            **({"mode": planned.mode} if planned.mode else {}),
            "set": dict(planned.fields),
            "effects": dict(planned.effects),
            "left_from_world": np.linalg.inv(scene.file_from_left).tolist(),
            "bodies": [body.name for body in scene.bodies],
            "objects": [
                {
                    "body": rested.name,
                    "mesh": rested.mesh,
                    "sha256": _mesh_digest(rested.path),
                    "left_from_mesh": (left_from_world @ rested.world_from_mesh).tolist(),
                }
                for rested in loaded.resting
            ],
        },
    )


def _row(
    plan: Plan, planned: PlannedView, repeat: int, shot: Shot, files: Mapping[str, bytes]
) -> Row:
    return {
        "frame": planned.number * plan.frames + repeat,
        "view": planned.number,
        "scene": planned.scene,
        "repeat": repeat,
        "name": f"{planned.name}/{repeat}",
        "room": planned.room,
        "sensor": planned.sensor,
        "seed": planned.seed,
        "ndp_rate": float(1 - shot.depth.valid.mean()),
        "mean_dn": float(shot.ir_left.mean()),
        "exposure_s": shot.exposure_s,
        "gain": shot.gain,
        "files": sorted(files),
        "bytes": sum(map(len, files.values())),
        "sha256": fingerprint(files),
    }


@lru_cache(maxsize=256)
def _mesh_digest(path: Path) -> str:
    return file_digest(path)


def fingerprint(files: Mapping[str, bytes]) -> str:
    """SHA-256 of names and contents, in hexadecimal digits."""
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name} {len(files[name])}\n".encode())
        digest.update(files[name])
    return digest.hexdigest()


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LoadedScene:
    """A scene in Mitsuba, and the meshes that were dropped into it."""

    stage: MitsubaScene
    resting: tuple[RestingMesh, ...] = ()


@lru_cache(maxsize=2)  # The views of one scene can have two presets.
def load_scene(setting: Setting, preset: str, mode: str = "") -> LoadedScene:
    """Load a scene for a preset.

    Args:
        setting: scene specifier or pile of meshes.
        preset: preset name or sensor file.
        mode: mode of the camera; empty is the sensor's own.

    Raises:
        InputError: if a file is missing or damaged.
    """
    sensor = presets.load(preset, mode=mode)
    if isinstance(setting, Pile):
        scene, resting = mesh_pile.scene(setting, sensor)
        return LoadedScene(stage=MitsubaScene(scene), resting=resting)
    return LoadedScene(stage=MitsubaScene(sources.load(setting.text, sensor)))


class MemoryFolder:
    """Names and contents of files, in the order of writing."""

    def __init__(self, path: Path) -> None:
        """Create an empty folder; `path` is its later place on disk."""
        self.path = path
        self.content: dict[str, bytes] = {}

    def write(self, name: str, data: bytes | str) -> None:
        """Store one file; text is encoded as UTF-8."""
        self.content[name] = data.encode() if isinstance(data, str) else data

    def take(self) -> dict[str, bytes]:
        """Return all files, and forget them."""
        content, self.content = self.content, {}
        return content

    def write_by(self, name: str, writer: Callable[[Path], object]) -> None:
        """Store the file that `writer` writes at the path passed to it."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / Path(name).name
            writer(path)
            self.content[name] = path.read_bytes()
