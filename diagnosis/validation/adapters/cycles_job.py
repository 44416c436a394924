"""Convert a scene of a light folder to a job for Blender's Cycles.

The two renderers share only meshes, materials, poses and the pattern. Each computes the light from
there to the imager independently.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.validation.adapters.light_sets import OTHER_M
from starling.diagnosis.validation.camera.cycles import radiometry
from starling.diagnosis.validation.camera.cycles.job import Job, JobBody, JobProjector, Pose, Sky
from starling.diagnosis.validation.camera.nominal import Nominal
from starling.patterns.errors import refuse
from starling.sim.captures import info as capture_info
from starling.sim.captures.capture import CapturedScene
from starling.sim.effects import setting as setting
from starling.sim.geometry import frames
from starling.sim.render import emission
from starling.sim.scene.captured import known_geometry
from starling.sim.scene.scene import Body, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.projector import Projector
from starling.sim.sensor.sensor import Sensor

_SAME = 1e-9  # Tolerance for equal numbers in two files.


def job(folder: Path, camera: Nominal) -> Job:
    """Build the Cycles job of one scene in a light folder.

    Args:
        folder: folder of the scene with `scene.toml`; its parent has `capture.toml`.
        camera: content of `nominal.json`.

    Returns:
        The job, with a sky of 1 W m^-2 and projectors of 1 W.

    Raises:
        InputError: if a file is refused, or the preset's projector is not that of `nominal.json`.
            Also if the scene's geometry is unknown, or holds shapes or textures.
        WithheldError: if a material kind is not supported, or `nominal.json` lacks the imager's
            light.
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
    return Job(
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
        sky=Sky(irradiance_w_m2=1.0, gradient=scene.ambient.gradient, up=scene.ambient.up),
        electrons=radiometry.electrons_per_radiance(camera, sensor.left.lens.transmission),
        power_w=camera.power_w,
    )


def captured(folder: Path) -> CapturedScene:
    """Open a scene of a light folder as a captured scene without frames.

    Raises:
        InputError: if `capture.toml` of the folder above is refused.
    """
    info = capture_info.read(folder.parent / capture_info.FILE)
    return CapturedScene(name=folder.name, room=folder.name, path=folder, info=info, frames=())


def _refuse_unsupported(scene: Scene) -> None:
    """Refuse scenes with shapes or textures, which a job cannot describe."""
    textured = [body.name for body in scene.bodies if body.texture is not None]
    if scene.shapes or textured:
        content = f"{len(scene.shapes)} shapes, textures on {textured}"
        raise refuse("scene", "must be bodies of one material each", content, "Take another.")


def _refuse_changed_preset(sensor: Sensor, camera: Nominal) -> None:
    """Refuse a preset that differs from the sensor for which the light was rendered."""
    for name, ours, nominal in (
        ("projector_x_m", sensor.projector.position_m[0], camera.projector_x_m),
        ("wavelength_nm", sensor.projector.wavelength_nm, camera.wavelength_nm),
        ("f_number", sensor.left.lens.f_number, camera.f_number),
    ):
        if nominal is None or abs(ours - nominal) > _SAME:
            raise refuse(
                f"{name} of nominal.json",
                f"must be {ours:g} as in the preset {sensor.name}",
                nominal,
                "Render the light with an unchanged preset.",
            )


def _body(body: Body) -> JobBody:
    mesh = body.mesh
    return JobBody(
        name=body.name,
        vertices_m=np.asarray(mesh.vertices, np.float32),
        faces=np.asarray(mesh.faces, np.uint32),
        normals=None if mesh.normals is None else np.asarray(mesh.normals, np.float32),
        kind=body.material.kind,
        reflectance=body.material.reflectance,
        roughness=body.material.roughness,
        ior=body.material.ior,
    )


def _lamps(
    name: str, part: Projector, world_from_left: Pose, *, even: bool
) -> dict[str, JobProjector]:
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
        light = [radiometry.intensity_w_sr(kind, half, emitter.power_share) for kind in kinds]
        lamps[f"{name}-{number}"] = JobProjector(
            world_from_projector=world_from_part
            @ frames.pose(emitter.offset_m, emitter.rotation_deg),
            half_tangents=half,
            intensity_w_sr=np.stack(light, axis=-1),
        )
    return lamps
