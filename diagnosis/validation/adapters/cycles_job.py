"""A scene of a light folder as a job for Cycles: what `scene.toml` and the sensor's name stand for.

Meshes, materials, poses and the pattern are all that the two renderers share. How light goes from
there to an imager is each one's own.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.adapters.light_sets import OTHER_M
from starling.diagnosis.validation.camera.cycles import radiometry
from starling.diagnosis.validation.camera.cycles.job import Body, Job, Pose, Sky
from starling.diagnosis.validation.camera.cycles.job import Projector as Lamp
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.patterns.errors import refuse
from starling.sim.captures import info as capture_info
from starling.sim.captures.capture import CapturedScene
from starling.sim.effects import setting as setting
from starling.sim.geometry import frames
from starling.sim.render import emission
from starling.sim.scene.captured import known_geometry
from starling.sim.scene.scene import Body as Thing
from starling.sim.scene.scene import Scene
from starling.sim.sensor import presets
from starling.sim.sensor.projector import Projector
from starling.sim.sensor.sensor import Sensor

_SAME = 1e-9  # Numbers that were written twice.


def job(folder: Path, camera: Nominal) -> Job:
    """Say what Cycles is to render for one scene of a light folder.

    Args:
        folder: the scene's, with `scene.toml`; the one above has `capture.toml`.
        camera: `nominal.json`.

    Returns:
        The job. Its sky is of 1 W m^-2, its projectors are of 1 W.

    Raises:
        InputError: if a file is refused, the scene is not known by its geometry or holds what
            Cycles is not told of, or the preset's projector is not the one of `nominal.json`.
        WithheldError: if a material is of a kind that Cycles is not told of, or `nominal.json`
            leaves out the imager's light.
    """
    seen = captured(folder)
    sensor = seen.info.geometry_into(presets.load(seen.info.sensor))
    scene = known_geometry.load(seen, sensor)
    if scene is None:
        raise refuse("scene", "must have a scene.toml", folder, "Make the light again.")
    _refuse_untold(scene)
    sensor, _ = setting.ideal(sensor, scene)
    _refuse_other(sensor, camera)
    left = np.asarray(scene.world_from_left, np.float64)
    other = dataclasses.replace(
        scene.other_projector, position_m=(OTHER_M, *scene.other_projector.position_m[1:])
    )
    part = sensor.projector
    return Job(
        width=camera.width,
        height=camera.height,
        focal_px=(camera.fx_px, camera.fy_px),
        centre_px=(camera.cx_px, camera.cy_px),
        cameras={"left": left, "right": left @ frames.pose((camera.baseline_m, 0.0, 0.0))},
        bodies=tuple(_body(body) for body in scene.bodies),
        projectors=_lamps("own", part, left, even=True) | _lamps("other", other, left, even=False),
        left_from_projector=frames.pose(part.position_m, part.rotation_deg),
        sky=Sky(irradiance_w_m2=1.0, gradient=scene.ambient.gradient, up=scene.ambient.up),
        electrons=radiometry.electrons_per_radiance(camera, sensor.left.lens.transmission),
        power_w=camera.power_w,
    )


def captured(folder: Path) -> CapturedScene:
    """The scene of a folder of light, as a captured one without frames.

    Raises:
        InputError: if `capture.toml` of the folder above is refused.
    """
    info = capture_info.read(folder.parent / capture_info.FILE)
    return CapturedScene(name=folder.name, room=folder.name, path=folder, info=info, frames=())


def _refuse_untold(scene: Scene) -> None:
    """Refuse what a job has no words for."""
    textured = [body.name for body in scene.bodies if body.texture is not None]
    if scene.shapes or textured:
        found = f"{len(scene.shapes)} shapes, textures on {textured}"
        raise refuse("scene", "must be bodies of one material each", found, "Take another.")


def _refuse_other(sensor: Sensor, camera: Nominal) -> None:
    """Refuse a preset that is not the sensor the light was made for."""
    for name, ours, told in (
        ("projector_x_m", sensor.projector.position_m[0], camera.projector_x_m),
        ("wavelength_nm", sensor.projector.wavelength_nm, camera.wavelength_nm),
        ("f_number", sensor.left.lens.f_number, camera.f_number),
    ):
        if told is None or abs(ours - told) > _SAME:
            raise refuse(
                f"{name} of nominal.json",
                f"must be {ours:g} as the preset {sensor.name} has it",
                told,
                "Make the light with a preset whose projector and lens are its own.",
            )


def _body(body: Thing) -> Body:
    mesh = body.mesh
    return Body(
        name=body.name,
        vertices_m=np.asarray(mesh.vertices, np.float32),
        faces=np.asarray(mesh.faces, np.uint32),
        normals=None if mesh.normals is None else np.asarray(mesh.normals, np.float32),
        kind=body.material.kind,
        reflectance=body.material.reflectance,
        roughness=body.material.roughness,
        ior=body.material.ior,
    )


def _lamps(name: str, part: Projector, world_from_left: Pose, *, even: bool) -> dict[str, Lamp]:
    """A projector's emitters, which share 1 W: channels are dots and, where asked for, even."""
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
        light = [radiometry.intensity_w_sr(kind, half, emitter.power_share) for kind in kinds]
        lamps[f"{name}-{number}"] = Lamp(
            world_from_projector=world_from_part
            @ frames.pose(emitter.offset_m, emitter.rotation_deg),
            half_tangents=half,
            intensity_w_sr=np.stack(light, axis=-1),
        )
    return lamps
