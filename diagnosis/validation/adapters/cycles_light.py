"""Light of the validation by Blender's Cycles instead of Starling's renderer.

The two renderers share only meshes, materials, poses and the pattern. Each computes the light from
there to the imager independently.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional

from starling.diagnosis.validation.adapters.light_sets import OTHER_M
from starling.diagnosis.validation.camera import light, nominal
from starling.diagnosis.validation.camera.cycles import job
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.patterns.errors import refuse
from starling.sim.captures import info
from starling.sim.captures.capture import CapturedScene
from starling.sim.console import output, progress
from starling.sim.effects import setting
from starling.sim.geometry import frames
from starling.sim.render import emission
from starling.sim.scene import scene_file
from starling.sim.scene.captured import known_geometry
from starling.sim.scene.scene import Body, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.projector import Projector
from starling.sim.sensor.sensor import Sensor

RECORD = "cycles.json"  # Settings of the rendering.
_SCRIPT = Path(job.__file__).with_name("render_with_blender.py")
_SET_FILES = (info.FILE, nominal.FILE)
_WRITTEN = (light.FILE, scene_file.FILE)  # Files of a scene that are written, not copied.
_SAME = 1e-9  # Tolerance for equal numbers in two files.
_INSTALL = "Install it with tools/blender.sh."


def cycles_light(
    source: Positional[Path],
    out: Positional[Path],
    *,
    blender: Path = Path(".blender/bin/python"),
    samples: int = 64,
    seed: int = 0,
    threads: int = 0,
) -> None:
    """Render a folder of light with Blender's Cycles.

    OUT becomes a copy of SOURCE in which each `light.npz` is rendered by Cycles. Each scene is
    written completely or not at all. Scenes that OUT already holds are skipped, so a stopped run
    continues where it stopped.

    Args:
        source: folder written by `light_sets`.
        out: new folder, or folder of a stopped run.
        blender: Python with bpy, see tools/blender.sh.
        samples: samples per pixel. With 64 the error of a dot's image is 1 % of the mean at a focal
            length of 160 px, and less for larger dots.
        seed: first seed of the samples; every scene has its own.
        threads: number of threads; 0 uses all cores.

    Raises:
        InputError: if a folder or a scene is refused, if `out` was rendered with other settings, or
            if Blender does not start or fails.
        WithheldError: if a light file is refused.
    """
    output.refuse_own_input(out, source)
    camera = nominal.read(source / nominal.FILE)
    scenes = sorted(path.parent for path in source.glob(f"*/{light.FILE}"))
    if not scenes:
        raise refuse("light", f"must hold SCENE/{light.FILE}", source, "Make the light first.")
    _begin(source, out, {"blender": _version(blender), "samples": samples, "seed": seed})
    with progress.on_stderr() as track:
        for number, folder in enumerate(track(scenes, "render")):
            if (out / folder.name / light.FILE).is_file():
                continue
            with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as temporary:
                work, scene_folder = Path(temporary), Path(temporary, "scene")
                # Both views of a scene use their own seed.
                job.write(
                    build_job(folder, camera), work / "job", samples=samples, seed=seed + number
                )
                _render(blender, work, threads, folder.name)
                arrays = job.arrays(work / "job", work / "rendered")
                _copy(folder, scene_folder, out / folder.name)
                np.savez_compressed(scene_folder / light.FILE, allow_pickle=False, **arrays)
                light.read(scene_folder / light.FILE, camera.shape)
                scene_folder.rename(out / folder.name)


def _begin(source: Path, out: Path, record: dict[str, Any]) -> None:
    """Create the folder, or check that an existing one has the same settings."""
    path, settings = out / RECORD, json.dumps(record, indent=1)
    if path.is_file():
        for name, text in ((RECORD, settings), *((n, _text(source / n)) for n in _SET_FILES)):
            if _text(out / name) != text:
                advice = "Use the same settings, or give another folder."
                raise refuse(name, "must be as in the stopped run", out / name, advice)
        return
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise refuse("out", "must be new, empty or of a stopped run", out, "Choose another place.")
    out.mkdir(parents=True, exist_ok=True)
    for name in _SET_FILES:
        shutil.copyfile(source / name, out / name)
    path.write_text(settings, encoding="utf-8")


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise refuse(path.name, "must be readable", path, f"{error}.") from error


def _copy(folder: Path, target: Path, place: Path) -> None:
    """Copy the other files of a scene, with a `scene.toml` adapted to the new folder."""
    shutil.copytree(folder, target, ignore=shutil.ignore_patterns(*_WRITTEN))
    known = known_geometry.for_folder(captured(folder), place)
    assert known is not None  # The job needed it, so it exists.
    (target / scene_file.FILE).write_text(scene_file.dumps(known), encoding="utf-8")


def _version(blender: Path) -> str:
    """Return the version of Blender in an interpreter."""
    asks = "import bpy, sys; sys.stderr.write(bpy.app.version_string)"
    return _run([blender, "-I", "-c", asks], "blender", _INSTALL).strip()


def _render(blender: Path, work: Path, threads: int, scene: str) -> None:
    command = [blender, "-I", _SCRIPT, work / "job", work / "rendered", "--threads", str(threads)]
    _run(command, f"rendering of {scene}", "Run it again, or use another Blender.")
    if not (work / "rendered" / job.DONE).is_file():
        raise refuse(f"rendering of {scene}", "must finish", "no record of it", "Run it again.")


def _run(command: list[str | Path], name: str, remedy: str) -> str:
    """Run a command and return its standard error; Blender writes messages to standard output."""
    try:
        ran = subprocess.run(
            command,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
        )
    except OSError as error:
        raise refuse(
            name, "must be a Python that runs", command[0], f"{error.strerror}. {_INSTALL}"
        ) from error
    if ran.returncode:
        last = (ran.stderr.strip().splitlines() or ["no message"])[-1]
        raise refuse(name, "must succeed", f"{last} (exit {ran.returncode})", remedy)
    return ran.stderr


def build_job(folder: Path, camera: Nominal) -> job.Job:
    """Build the Cycles job of one scene in a light folder.

    Args:
        folder: folder of the scene with `scene.toml`; its parent has `capture.toml`.
        camera: content of `nominal.json`.

    Returns:
        The job, with a sky of 1 W m^-2 and projectors of 1 W.

    Raises:
        InputError: if a file is refused, or the preset's projector is not that of `nominal.json`.
            Also if the scene's geometry is unknown, or holds shapes or textures.
        WithheldError: if a material kind is not supported.
    """
    scene_folder = captured(folder)
    sensor = scene_folder.info.geometry_into(presets.load(scene_folder.info.sensor))
    scene = known_geometry.load(scene_folder, sensor)
    if scene is None:
        raise refuse("scene", "must have a scene.toml", folder, "Make the light again.")
    _refuse_unsupported(scene)
    sensor, _ = setting.ideal(sensor, scene)
    _refuse_changed_preset(sensor, camera)
    world_from_left = np.asarray(scene.world_from_left, np.float64)
    second = dataclasses.replace(
        scene.other_projector, position_m=(OTHER_M, *scene.other_projector.position_m[1:])
    )
    part = sensor.projector
    return job.Job(
        width=camera.width,
        height=camera.height,
        focal_px=(camera.fx_px, camera.fy_px),
        centre_px=(camera.cx_px, camera.cy_px),
        cameras={
            "left": world_from_left,
            "right": world_from_left @ frames.pose((camera.baseline_m, 0.0, 0.0)),
        },
        bodies=tuple(_body(body) for body in scene.bodies),
        projectors=_lamps("own", part, world_from_left, even=True)
        | _lamps("other", second, world_from_left, even=False),
        left_from_projector=frames.pose(part.position_m, part.rotation_deg),
        sky=job.Sky(irradiance_w_m2=1.0, gradient=scene.ambient.gradient, up=scene.ambient.up),
        electrons=job.electrons_per_radiance(camera, sensor.left.lens.transmission),
        power_w=camera.power_w,
    )


def captured(folder: Path) -> CapturedScene:
    """Open a scene of a light folder as a captured scene without frames.

    Raises:
        InputError: if `capture.toml` of the folder above is refused.
    """
    return CapturedScene(
        name=folder.name,
        room=folder.name,
        path=folder,
        info=info.read(folder.parent / info.FILE),
        frames=(),
    )


def _refuse_unsupported(scene: Scene) -> None:
    """Refuse scenes with shapes or textures, which a job cannot describe."""
    textured = [body.name for body in scene.bodies if body.texture is not None]
    if scene.shapes or textured:
        content = f"{len(scene.shapes)} shapes, textures on {textured}"
        raise refuse("scene", "must be bodies of one material each", content, "Take another.")


def _refuse_changed_preset(sensor: Sensor, camera: Nominal) -> None:
    """Refuse a preset that differs from the sensor for which the light was rendered."""
    for name, ours, rendered in (
        ("projector_x_m", sensor.projector.position_m[0], camera.projector_x_m),
        ("wavelength_nm", sensor.projector.wavelength_nm, camera.wavelength_nm),
        ("f_number", sensor.left.lens.f_number, camera.f_number),
    ):
        if abs(ours - rendered) > _SAME:
            raise refuse(
                f"{name} of nominal.json",
                f"must be {ours:g} as in the preset {sensor.name}",
                rendered,
                "Render the light with an unchanged preset.",
            )


def _body(body: Body) -> job.JobBody:
    mesh = body.world_mesh
    return job.JobBody(
        name=body.name,
        vertices=np.asarray(mesh.vertices, np.float32),
        faces=np.asarray(mesh.faces, np.uint32),
        normals=None if mesh.normals is None else np.asarray(mesh.normals, np.float32),
        kind=body.material.kind,
        reflectance=body.material.reflectance,
        roughness=body.material.roughness,
        ior=body.material.ior,
    )


def _lamps(
    name: str, part: Projector, world_from_left: job.Pose, *, even: bool
) -> dict[str, job.JobProjector]:
    """Return a projector's emitters, which share 1 W, with channels for dots and even light."""
    world_from_part = world_from_left @ frames.pose(part.position_m, part.rotation_deg)
    lamps = {}
    for number, emitter in enumerate(emission.emitters(part)):
        pattern = emission.pattern(
            emitter.pattern, part.fov_x_deg, part.fov_y_deg, part.pattern_seed, part.dot_density
        )
        half = pattern.field.half_x, pattern.field.half_y
        kinds: list[NDArray[np.float32]] = [pattern.image]
        if even:
            kinds.append(np.ones_like(pattern.image))
        light = [job.intensity_w_sr(kind, half, emitter.power_share) for kind in kinds]
        lamps[f"{name}-{number}"] = job.JobProjector(
            world_from_projector=world_from_part
            @ frames.pose(emitter.offset_m, emitter.rotation_deg),
            half_tangents=half,
            intensity_w_sr=np.stack(light, axis=-1),
        )
    return lamps
