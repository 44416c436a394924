"""Render the light of a job with Blender's Cycles: a script for Blender's Python environment.

Run it as `PYTHON render_with_blender.py JOB OUT [--threads N]`, where PYTHON has `bpy`. It imports
only numpy and the standard library besides Blender, and nothing of Starling. The format of a job is
documented in `starling.diagnosis.validation.camera.cycles.job`. The script writes these arrays,
(h, w, 3) float32, to OUT for the left and the right side:

- `SIDE_own.npy`: radiance [W m^-2 sr^-1] of the device's projector at 1 W: dots, uniform light, 0.
- `SIDE_other.npy`: radiance [W m^-2 sr^-1] of the second projector at 1 W, in the first channel.
- `SIDE_ambient.npy`: radiance [W m^-2 sr^-1] of the sky, in the first channel.
- `SIDE_geometry.npy`: depth z [m], number of the body, and 1 where a pixel centre meets a body.

It writes `rendered.json` last.

Each array is a separate render. With several lights Cycles would choose one at random per path,
which adds noise. Two lights at one position are two colour channels of one light. The direct light
of a point source is random only through the sample position in the pixel.
"""

# pyright: reportMissingImports=false, reportPossiblyUnboundVariable=false
from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

try:
    import bpy
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Matrix, Vector
except ModuleNotFoundError:  # They exist only in Blender's environment; import this file anywhere.
    pass

_SENSOR_MM = 36.0  # Arbitrary sensor width; focal lengths scale with it.
_NEAREST_M, _FARTHEST_M = 1e-3, 1e3
_CENTRE_PX = 0.01  # Blender's narrowest pixel filter, which samples the pixel centre [px].
_MISS_PX = 1e-2  # Largest reprojection error of the camera [px].
# Blender defines the power of a point light over the whole sphere.
_POWER_PER_INTENSITY = 4 * math.pi  # [W] for 1 W sr^-1


def main() -> None:
    """Read the command line and render."""
    parser = argparse.ArgumentParser(description="Render the light of a job with Blender's Cycles.")
    parser.add_argument("job", type=Path, help="folder with job.json")
    parser.add_argument("out", type=Path, help="folder for the images")
    parser.add_argument("--threads", type=int, default=0, help="0 uses all cores")
    options = parser.parse_args()
    table = json.loads((options.job / "job.json").read_text(encoding="utf-8"))
    options.out.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    render(options.job, table, options.out, options.threads)
    summary = {"blender": bpy.app.version_string, "seconds": time.monotonic() - started}
    (options.out / "rendered.json").write_text(json.dumps(summary), encoding="utf-8")


def render(job: Path, table: dict[str, Any], out: Path, threads: int) -> None:
    """Render every layer of a job.

    Args:
        job: Folder of the arrays that the table names.
        table: Content of `job.json`.
        out: Folder for the images.
        threads: Number of threads, 0 for all cores.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _settings(table, threads)
    bodies = [_body(job, body) for body in table["bodies"]]
    lights = {name: _projector(job, name, entry) for name, entry in table["projectors"].items()}
    _sky(table["sky"])
    for number, (side, pose) in enumerate(table["cameras"].items()):
        _camera(table, np.array(pose))
        seed = 2 * int(table["seed"]) + number  # Independent noise in both views.
        for name in lights:
            _choose(lights, name, sky=False)
            _set_occlusion(bodies, open_sky=False)
            _take(out / f"{side}_{name}.npy", table["samples"], seed)
        _choose(lights, None, sky=True)
        _set_occlusion(bodies, open_sky=True)
        _take(out / f"{side}_ambient.npy", table["samples"], seed)
        _choose(lights, None, sky=False)
        _take(out / f"{side}_geometry.npy", 1, seed, override=_geometry())


def _settings(table: dict[str, Any], threads: int) -> None:
    """Configure direct light only, without clamping or adaptive sampling, with a box filter."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = table["width"], table["height"]
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = True  # Pixels without a body stay dark.
    scene.render.use_persistent_data = True
    scene.render.dither_intensity = 0.0
    scene.render.threads_mode = "FIXED" if threads else "AUTO"
    if threads:
        scene.render.threads = threads
    image = scene.render.image_settings
    image.file_format, image.color_mode, image.color_depth = "OPEN_EXR", "RGBA", "32"
    image.exr_codec = "ZIP"
    scene.view_settings.view_transform = "Raw"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.use_animated_seed = False
    cycles.light_sampling_threshold = 0.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.blur_glossy = 0.0
    cycles.max_bounces = cycles.min_light_bounces = cycles.min_transparent_bounces = 0


def _take(path: Path, samples: int, seed: int, override: Any = None) -> None:
    """Render the current scene and save an array (h, w, 3) float32."""
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.seed = samples, seed
    scene.cycles.pixel_filter_type = "GAUSSIAN" if override else "BOX"
    scene.cycles.filter_width = _CENTRE_PX
    bpy.context.view_layer.material_override = override
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder, "image.exr"))
        bpy.ops.render.render(write_still=True)
        np.save(path, _pixels(Path(scene.render.filepath)))
    print(f"rendered {path.name}", file=sys.stderr, flush=True)


def _pixels(path: Path) -> NDArray[np.float32]:
    """Read the first three channels (h, w, 3) of an OpenEXR file, first row on top."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    width, height = image.size
    values = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(values)
    bpy.data.images.remove(image)
    return values.reshape(height, width, -1)[::-1, :, :3].copy()


def _camera(table: dict[str, Any], world_from_camera: NDArray[np.float64]) -> None:
    """Place the camera. Blender's camera looks along -z with y up."""
    scene = bpy.context.scene
    if scene.camera is None:
        scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        scene.collection.objects.link(scene.camera)
    fx, fy = table["focal_px"]
    cx, cy = table["centre_px"]
    width, height = table["width"], table["height"]
    # Pixel height over width is fx / fy, and neither of Blender's aspect values may be below 1.
    scene.render.pixel_aspect_x = max(1.0, fy / fx)
    scene.render.pixel_aspect_y = max(1.0, fx / fy)
    camera = scene.camera.data
    camera.sensor_fit, camera.sensor_width = "HORIZONTAL", _SENSOR_MM
    camera.lens = fx * _SENSOR_MM / width
    camera.clip_start, camera.clip_end = _NEAREST_M, _FARTHEST_M
    camera.shift_x = ((width - 1) / 2 - cx) / width
    camera.shift_y = (cy - (height - 1) / 2) * (fx / fy) / width
    pose = world_from_camera @ np.diag([1.0, -1.0, -1.0, 1.0])
    scene.camera.matrix_world = Matrix(pose.tolist())
    bpy.context.view_layer.update()
    _check_camera(table, world_from_camera)


def _check_camera(table: dict[str, Any], world_from_camera: NDArray[np.float64]) -> None:
    """Exit if Blender projects points to other pixels than the job specifies."""
    scene, (width, height) = bpy.context.scene, (table["width"], table["height"])
    fx, fy = table["focal_px"]
    cx, cy = table["centre_px"]
    for x, y in ((0, 0), (width - 1, 0), (0, height - 1), (width / 3, height / 4)):
        local = np.array([(x - cx) / fx, (y - cy) / fy, 1.0]) * 1.5
        point = world_from_camera[:3, :3] @ local + world_from_camera[:3, 3]
        view = world_to_camera_view(scene, scene.camera, Vector(point.tolist()))
        pixel = view[0] * width - 0.5, (1 - view[1]) * height - 0.5
        if math.dist(pixel, (x, y)) > _MISS_PX:
            raise SystemExit(
                f"camera must see a point at pixel ({x:g}, {y:g}); "
                f"got ({pixel[0]:g}, {pixel[1]:g}). "
                "Take the version of bpy that tools/blender.sh installs."
            )


def _body(job: Path, table: dict[str, Any]) -> Any:
    """Create a body with its surface. The pass index is the number of the body."""
    vertices, faces = np.load(job / table["vertices"]), np.load(job / table["faces"])
    mesh = bpy.data.meshes.new(table["name"])
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    if table["normals"]:
        mesh.shade_smooth()
        mesh.normals_split_custom_set_from_vertices(np.load(job / table["normals"]).tolist())
    else:
        mesh.shade_flat()
    mesh.materials.append(_surface(table))
    instance = bpy.data.objects.new(table["name"], mesh)
    instance.pass_index = table["number"]
    bpy.context.scene.collection.objects.link(instance)
    return instance


def _set_occlusion(bodies: list[Any], *, open_sky: bool) -> None:
    """Let bodies occlude each other's light, except under an open sky."""
    for body in bodies:
        body.visible_shadow = body.visible_diffuse = body.visible_glossy = not open_sky


def _nodes(tree: Any) -> tuple[Any, Any]:
    tree.use_nodes = True
    tree.node_tree.nodes.clear()
    return tree.node_tree.nodes, tree.node_tree.links


def _surface(table: dict[str, Any]) -> Any:
    """Create the material of a body: diffuse, diffuse under a clear coat, or metal."""
    material = bpy.data.materials.new(table["name"])
    nodes, links = _nodes(material)
    out = nodes.new("ShaderNodeOutputMaterial")
    grey = (_base(table),) * 3 + (1.0,)
    if table["kind"] == "diffuse":
        surface = nodes.new("ShaderNodeBsdfDiffuse")
        surface.inputs["Color"].default_value = grey
        surface.inputs["Roughness"].default_value = 0.0
    else:
        surface = nodes.new("ShaderNodeBsdfPrincipled")
        surface.distribution = "GGX"  # Single scattering, as the materials are defined.
        surface.inputs["Base Color"].default_value = grey
        # Blender's roughness is the square root of GGX alpha.
        surface.inputs["Roughness"].default_value = math.sqrt(table["roughness"])
        surface.inputs["Metallic"].default_value = float(table["kind"] == "metal")
        surface.inputs["IOR"].default_value = table["ior"]
    links.new(surface.outputs["BSDF"], out.inputs["Surface"])
    return material


def _base(table: dict[str, Any]) -> float:
    """Return the base colour: the reflectance, or that of the base under a coat.

    Blender's coat transmits 1 - F, so that the total reflectance is F + (1 - F) base.
    """
    if table["kind"] != "glossy":
        return table["reflectance"]
    fresnel = ((table["ior"] - 1) / (table["ior"] + 1)) ** 2
    return max(table["reflectance"] - fresnel, 0.0) / (1 - fresnel)


def _projector(job: Path, name: str, table: dict[str, Any]) -> Any:
    """Create a point source whose intensity [W sr^-1] an image on its tangent plane gives."""
    lamp = bpy.data.lights.new(name, "POINT")
    lamp.energy, lamp.color, lamp.shadow_soft_size = _POWER_PER_INTENSITY, (1.0, 1.0, 1.0), 0.0
    lamp.use_soft_falloff = False
    instance = bpy.data.objects.new(name, lamp)
    world_from_projector = np.array(table["world_from_projector"])
    instance.matrix_world = Matrix(world_from_projector.tolist())
    bpy.context.scene.collection.objects.link(instance)
    nodes, links = _nodes(lamp)
    incoming = nodes.new("ShaderNodeNewGeometry").outputs["Incoming"]  # From lamp to surface.

    def maths(operation: str, *operands: Any) -> Any:
        node = nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, operand in zip(node.inputs, operands, strict=False):
            if isinstance(operand, float):
                socket.default_value = operand
            else:
                links.new(operand, socket)
        return node.outputs[0]

    def along(axis: NDArray[np.float64]) -> Any:
        node = nodes.new("ShaderNodeVectorMath")
        node.operation = "DOT_PRODUCT"
        links.new(incoming, node.inputs[0])
        node.inputs[1].default_value = axis.tolist()
        return node.outputs["Value"]

    x, y, z = (along(axis) for axis in world_from_projector[:3, :3].T)
    half_x, half_y = table["half_tangents"]
    place = nodes.new("ShaderNodeCombineXYZ")  # (0, 0) is the lower left corner of the image.
    links.new(maths("MULTIPLY_ADD", maths("DIVIDE", x, z), 0.5 / half_x, 0.5), place.inputs[0])
    links.new(maths("MULTIPLY_ADD", maths("DIVIDE", y, z), -0.5 / half_y, 0.5), place.inputs[1])
    image = nodes.new("ShaderNodeTexImage")
    image.image = _image(name, np.load(job / table["intensity_w_sr"]))
    image.interpolation, image.extension = "Linear", "CLIP"
    links.new(place.outputs[0], image.inputs["Vector"])
    emission = nodes.new("ShaderNodeEmission")
    links.new(image.outputs["Color"], emission.inputs["Color"])
    links.new(maths("GREATER_THAN", z, 0.0), emission.inputs["Strength"])
    links.new(emission.outputs[0], nodes.new("ShaderNodeOutputLight").inputs["Surface"])
    return instance


def _image(name: str, channels: NDArray[np.float32]) -> Any:
    """Create an image of (h, w, up to 3) linear values, first row on top."""
    height, width, count = channels.shape
    values = np.zeros((height, width, 4), np.float32)
    values[..., :count], values[..., 3] = channels[::-1], 1.0
    image = bpy.data.images.new(name, width, height, float_buffer=True, is_data=True)
    image.colorspace_settings.name = "Non-Color"
    image.pixels.foreach_set(values.reshape(-1))
    image.update()
    return image


def _sky(table: dict[str, Any]) -> None:
    """Create a sky of radiance L0 (1 + g w . up) in direction w and irradiance pi L0."""
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    world.cycles.sampling_method = "NONE"  # Only BSDF sampling reaches the sky.
    nodes, links = _nodes(world)
    dot = nodes.new("ShaderNodeVectorMath")
    dot.operation = "DOT_PRODUCT"
    links.new(nodes.new("ShaderNodeTexCoord").outputs["Generated"], dot.inputs[0])
    dot.inputs[1].default_value = table["up"]
    strength = nodes.new("ShaderNodeMath")
    strength.operation = "MULTIPLY_ADD"
    level = table["irradiance_w_m2"] / math.pi
    links.new(dot.outputs["Value"], strength.inputs[0])
    strength.inputs[1].default_value = level * table["gradient"]
    strength.inputs[2].default_value = level
    emission = nodes.new("ShaderNodeBackground")
    links.new(strength.outputs[0], emission.inputs["Strength"])
    emission.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    links.new(emission.outputs[0], nodes.new("ShaderNodeOutputWorld").inputs["Surface"])


def _choose(lights: dict[str, Any], name: str | None, *, sky: bool) -> None:
    """Enable one projector, or the sky, or no light."""
    for key, light in lights.items():
        light.hide_render = key != name
    bpy.context.scene.world = bpy.data.worlds["sky"] if sky else None


def _geometry() -> Any:
    """Create a material that emits depth, number of the body, and 1 in its colour channels."""
    if "geometry" in bpy.data.materials:
        return bpy.data.materials["geometry"]
    material = bpy.data.materials.new("geometry")
    material.cycles.emission_sampling = "NONE"  # The material is visible but lights no surface.
    nodes, links = _nodes(material)
    channels = nodes.new("ShaderNodeCombineXYZ")
    links.new(nodes.new("ShaderNodeCameraData").outputs["View Z Depth"], channels.inputs[0])
    links.new(nodes.new("ShaderNodeObjectInfo").outputs["Object Index"], channels.inputs[1])
    channels.inputs[2].default_value = 1.0
    emission = nodes.new("ShaderNodeEmission")
    links.new(channels.outputs[0], emission.inputs["Color"])
    links.new(emission.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


if __name__ == "__main__":
    main()
