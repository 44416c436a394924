"""A table with objects and an arm in MuJoCo, as a Starling scene and as MuJoCo's depth images.

Two cameras see the table: one from above, one from the arm's wrist.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

import starling.mujoco
from starling import InputError, Scene, Sensor
from starling.sim.geometry.frames import Pose
from starling.sim.mujoco import model_scene
from starling.sim.mujoco.buffers import Buffers
from starling.sim.mujoco.library import gl_context, mujoco

CAMERAS = ("overhead", "wrist")
SETTLED_S = 1.0  # Time in which the objects fall onto the table.
ARM_DEG = {"j1": 0, "j2": 40, "j4": 112}  # The hand looks forward and down.
FAR_M = 20.0
SIDES = 48  # Of round solids, in both renderers.
TABLE_M = 0.3  # The objects fall within this distance of the table's middle.
_LINKS = 6


def unavailable() -> str | None:
    """Return why MuJoCo cannot draw; None if it can."""
    try:
        gl_context(8, 8).free()
    except InputError as error:
        return str(error)
    return None


class Table:
    """The table, its objects and the arm, at rest."""

    def __init__(self, fov_y_deg: float, *, objects: int = 20) -> None:
        """Build the model and let the objects fall.

        Args:
            fov_y_deg: Vertical field of both cameras [deg].
            objects: Number of objects.
        """
        library = mujoco()
        self.model: Any = library.MjModel.from_xml_string(_mjcf(fov_y_deg, objects), _meshes())
        self.data: Any = library.MjData(self.model)
        while self.data.time < SETTLED_S:
            library.mj_step(self.model, self.data)
        for joint, angle in ARM_DEG.items():
            self.data.joint(joint).qpos[0] = np.deg2rad(angle)
        library.mj_forward(self.model, self.data)

    def scene(self, camera: str) -> Scene:
        """Return the geoms as meshes, seen by a camera."""
        return starling.mujoco.scene(self.model, self.data, camera=camera)

    def depth_from(self, camera: str, sensor: Sensor, left_from_place: Pose) -> NDArray[np.float32]:
        """Draw MuJoCo's depth (h, w) seen from a place near a camera [m]; NaN at the far plane.

        Args:
            camera: Name of the camera.
            sensor: Gives the camera of the image.
            left_from_place: Pose (4, 4) of the place, in the camera's OpenCV axes.
        """
        number = model_scene.camera_number(self.model, camera)
        place = model_scene.camera_pose(self.data, number) @ left_from_place
        buffers = Buffers(self.model, sensor, model_scene.GROUPS)
        buffers.update(self.data, place)
        depth_m, _ = buffers.draw(place)
        buffers.close()
        return depth_m


def _meshes() -> dict[str, bytes]:
    """Files of the meshes in the model."""
    lump = trimesh.creation.icosphere(subdivisions=4, radius=0.04)
    lump.vertices *= 1 + 0.25 * np.sin(40 * lump.vertices[:, :1])
    meshes = {
        "lump": lump,
        "ring": trimesh.creation.annulus(0.03, 0.05, 0.06, sections=SIDES),
        "link": trimesh.creation.capsule(0.08, 0.03, count=[SIDES, SIDES]),
    }
    return {f"{name}.stl": mesh.export(file_type="stl") for name, mesh in meshes.items()}


def _mjcf(fov_y_deg: float, objects: int) -> str:
    """The model: floor, table, objects above it, arm with gripper, two cameras."""
    camera = f'resolution="640 480" fovy="{fov_y_deg}"'
    hand = f"""<body name="hand" pos="0 0 0.17">
      <geom type="box" size="0.045 0.02 0.02" material="steel"/>
      <geom type="box" pos="0.03 0 0.05" size="0.006 0.012 0.04" rgba="0.1 0.1 0.1 1"/>
      <geom type="box" pos="-0.03 0 0.05" size="0.006 0.012 0.04" rgba="0.1 0.1 0.1 1"/>
      <camera name="wrist" pos="-0.08 0 -0.04" xyaxes="0 -1 0 -1 0 0" {camera}/></body>"""
    arm = hand
    for number in reversed(range(_LINKS)):
        axis = "0 1 0" if f"j{number}" in ARM_DEG else "0 0 1"
        arm = f"""<body gravcomp="1" pos="0 0 {0.17 if number else 0}">
          <joint name="j{number}" axis="{axis}" damping="5"/>
          <geom type="mesh" mesh="link" pos="0 0 0.08" rgba="0.85 0.85 0.88 1"/>{arm}</body>"""
    return f"""<mujoco><compiler angle="degree"/><statistic extent="1"/>
      <visual><map znear="0.01" zfar="{FAR_M}"/><quality numslices="{SIDES}" numstacks="{SIDES}"/>
        <global offwidth="1280" offheight="960"/></visual>
      <default><geom condim="6" friction="1 0.05 0.05"/></default>
      <asset><mesh name="lump" file="lump.stl"/><mesh name="ring" file="ring.stl"/>
        <mesh name="link" file="link.stl"/><material name="steel" rgba=".7 .7 .7 1"
          metallic="1" roughness="0.2"/></asset>
      <worldbody><light pos="0 0 3"/>
        <geom type="box" pos="0 0 -0.05" size="2 2 0.05" rgba=".5 .5 .5 1"/>
        <geom type="box" pos="0 0 .38" size=".4 .4 .02" rgba=".75 .7 .6 1"/>
        {_objects(objects)}
        <body pos="-0.45 0 .4">{arm}</body>
        <camera name="overhead" pos="0 -0.55 1.0" xyaxes="1 0 0 0 0.75 0.65" {camera}/>
      </worldbody></mujoco>"""


def _objects(count: int) -> str:
    rng = np.random.default_rng(0)
    shapes = ("box", "sphere", "cylinder", "capsule", "ellipsoid", "lump", "ring")
    lines = []
    for number in range(count):
        shape = shapes[number % len(shapes)]
        x, y = rng.uniform(-TABLE_M, TABLE_M, 2)
        colour = " ".join(f"{level:.2f}" for level in rng.uniform(0.15, 0.95, 3))
        size = " ".join(f"{length:.3f}" for length in rng.uniform(0.02, 0.05, 3))
        solid = f'type="{shape}" size="{size}"'
        if shape in ("lump", "ring"):
            solid = f'type="mesh" mesh="{shape}"'
        z = 0.5 + 0.06 * (number % 5)
        lines.append(
            f'<body pos="{x:.3f} {y:.3f} {z:.2f}"><freejoint/>'
            f'<geom {solid} rgba="{colour} 1" density="400"/></body>'
        )
    return "\n".join(lines)
