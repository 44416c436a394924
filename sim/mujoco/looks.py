"""Materials and textures of MuJoCo's geoms, in the near infrared and in visible light.

Colours are of visible light; the near infrared is guessed from them (`sim/scene/colours.py`).
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.arrays import Image
from starling.sim.mujoco import geoms, texture_coordinates
from starling.sim.mujoco.library import mujoco
from starling.sim.scene import colours
from starling.sim.scene.meshes.appearance import Appearance, material_of
from starling.sim.scene.scene import Body, Material

_UNSET = (0.5, 0.5, 0.5, 1.0)  # Colour of a geom whose file gives none.


def rgba(model: Any, geom: int) -> NDArray[np.float64]:
    """Colour (4,) of a geom in sRGB: its own, or that of its material."""
    colour, material = np.array(model.geom_rgba[geom], np.float64), int(model.geom_matid[geom])
    if material < 0 or not np.allclose(colour, _UNSET):
        return colour
    return np.array(model.mat_rgba[material], np.float64)


def body(model: Any, geom: int, name: str) -> Body:
    """A geom as a body in its own frame.

    Args:
        model: `mujoco.MjModel`.
        geom: number of the geom.
        name: name of the body.
    """
    colour = np.clip(rgba(model, geom)[:3], 0, 1)
    visible = colours.linear(_bytes(colour))
    material = _material(model, int(model.geom_matid[geom]), name, visible)
    mesh, image = geoms.triangles(model, geom), _texture(model, geom)
    if image is None:
        return Body(name=name, mesh=dataclasses.replace(mesh, uv=None), material=material)
    levels, cubic = image
    dyed = colours.linear(_bytes(levels / 255 * colour))
    if cubic:
        single = levels.shape[0] == levels.shape[1]
        mesh = texture_coordinates.on_cube(model, geom, mesh, single=single)
    else:
        mesh = texture_coordinates.on_image(model, geom, mesh)
    return Body(
        name=name,
        mesh=mesh,
        material=material,
        texture=colours.near_infrared(dyed),
        colour=dyed,
        repeats=not cubic,
    )


def _bytes(levels: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.rint(255 * levels).astype(np.uint8)


def _material(model: Any, number: int, name: str, rgb: Image) -> Material:
    """Material of a colour; MuJoCo marks metal and roughness without a value by -1."""
    metallic = float(model.mat_metallic[number]) if number >= 0 else -1.0
    roughness = float(model.mat_roughness[number]) if number >= 0 else -1.0
    red, green, blue = rgb.tolist()
    look = Appearance(
        name=name,
        rgb=(red, green, blue),
        metallic=max(metallic, 0.0),
        alpha=roughness**2 if roughness >= 0 else 1.0,
    )
    return material_of(look)


def _texture(model: Any, geom: int) -> tuple[NDArray[np.uint8], bool] | None:
    """Image (h, w, 3) of a geom in sRGB, and whether it holds the faces of a cube."""
    material = int(model.geom_matid[geom])
    roles = (mujoco().mjtTextureRole.mjTEXROLE_RGB, mujoco().mjtTextureRole.mjTEXROLE_RGBA)
    numbers = [] if material < 0 else [int(model.mat_texid[material][role]) for role in roles]
    numbers = [number for number in numbers if number >= 0]
    if not numbers:
        return None
    number = numbers[0]
    height, width = int(model.tex_height[number]), int(model.tex_width[number])
    channels, first = int(model.tex_nchannel[number]), int(model.tex_adr[number])
    image = model.tex_data[first : first + height * width * channels]
    image = np.array(image, np.uint8).reshape(height, width, channels)[..., :3]
    if image.shape[2] < 3:
        image = np.repeat(image[..., :1], 3, axis=2)
    return image, int(model.tex_type[number]) != mujoco().mjtTexture.mjTEXTURE_2D
