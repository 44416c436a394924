"""A table with 20 objects and an arm in MuJoCo, as a Starling scene and as MuJoCo's depth images.

Needs the package `mujoco`. Two cameras see the table: one from above, one from the arm's wrist.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from starling import Scene, Sensor
from starling.sim.geometry.frames import Pose
from starling.sim.scene.builtin import solids
from starling.sim.scene.scene import Ambient, Body, Material

os.environ.setdefault("MUJOCO_GL", "egl")  # Read at the import of mujoco; no display is needed.
CAMERAS = ("overhead", "wrist")
OBJECTS = 20
SETTLED_S = 1.0  # Time in which the objects fall onto the table.
ARM_DEG = {"j1": 0, "j2": 40, "j4": 112}  # The hand looks forward and down.
FAR_M = 20.0
SIDES = 96  # Of round solids, in both renderers.
TABLE_M = 0.3  # The objects fall within this distance of the table's middle.
_OPENCV_FROM_MUJOCO = np.diag([1.0, -1.0, -1.0])  # MuJoCo's cameras: y up, z backward.
_LINKS = 6


def unavailable() -> str | None:
    """Return why MuJoCo cannot render; None if it can."""
    try:
        import mujoco

        mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 8, 8).close()
    except ImportError:
        return "the package mujoco is not installed"
    except Exception as error:  # Drivers raise errors of many types.
        return f"MuJoCo cannot render: {error}"
    return None


class Table:
    """The table, its objects and the arm, at rest."""

    def __init__(self, fov_y_deg: float) -> None:
        """Build the model and let the objects fall.

        Args:
            fov_y_deg: Vertical field of both cameras [deg].
        """
        import mujoco

        self.model: Any = mujoco.MjModel.from_xml_string(_mjcf(fov_y_deg), _meshes())
        self.data: Any = mujoco.MjData(self.model)
        while self.data.time < SETTLED_S:
            mujoco.mj_step(self.model, self.data)
        for joint, angle in ARM_DEG.items():
            self.data.joint(joint).qpos[0] = np.deg2rad(angle)
        mujoco.mj_forward(self.model, self.data)

    def scene(self, camera: str) -> Scene:
        """Return the geoms as meshes, seen by a camera."""
        bodies = tuple(self._body(number) for number in range(self.model.ngeom))
        ambient = Ambient(up=(0.0, 0.0, 1.0))
        pose = self._world_from_camera(camera)
        return Scene(name=f"mujoco {camera}", bodies=bodies, ambient=ambient, world_from_left=pose)

    def depth_from(self, camera: str, sensor: Sensor, left_from_place: Pose) -> NDArray[np.float32]:
        """Render MuJoCo's depth (h, w) seen from a place near a camera [m]; NaN at the far plane.

        Args:
            camera: Name of the camera.
            sensor: Gives the size of the image.
            left_from_place: Pose (4, 4) of the place, in the camera's OpenCV axes.
        """
        import mujoco

        place = self._world_from_camera(camera) @ left_from_place
        record = self.data.cam(camera)
        unmoved = record.xpos.copy(), record.xmat.copy()
        record.xpos[:] = place[:3, 3]
        record.xmat[:] = (place[:3, :3] @ _OPENCV_FROM_MUJOCO).ravel()
        with mujoco.Renderer(self.model, sensor.height, sensor.width) as renderer:
            renderer.enable_depth_rendering()
            renderer.update_scene(self.data, camera)
            depth_m = np.array(renderer.render(), np.float32)
        record.xpos[:], record.xmat[:] = unmoved
        depth_m[depth_m > 0.99 * FAR_M] = np.nan
        return depth_m

    def _world_from_camera(self, camera: str) -> Pose:
        record, pose = self.data.cam(camera), np.eye(4)
        pose[:3, :3] = record.xmat.reshape(3, 3) @ _OPENCV_FROM_MUJOCO
        pose[:3, 3] = record.xpos
        return pose

    def _body(self, number: int) -> Body:
        solid, smooth = self._solid(number)
        place = np.eye(4)
        place[:3, :3] = self.data.geom_xmat[number].reshape(3, 3)
        place[:3, 3] = self.data.geom_xpos[number]
        name = f"geom {number}"
        return solids.body(name, solid, self._material(number, name), place, smooth=smooth)

    def _material(self, number: int, name: str) -> Material:
        """Dyes are bright in the near infrared: 0.25 + 0.6 of the brightest colour."""
        model, shared = self.model, self.model.geom_matid[number]
        brightest = float(model.geom_rgba[number][:3].max() if shared < 0 else 0.7)
        reflectance = 0.25 + 0.6 * ((brightest + 0.055) / 1.055) ** 2.4
        if shared >= 0:
            return Material(name=name, kind="metal", reflectance=reflectance, roughness=0.2)
        return Material(name=name, reflectance=reflectance)

    def _solid(self, number: int) -> tuple[trimesh.Trimesh, bool]:
        """Return triangles in the geom's frame, and whether they shade a curved surface."""
        import mujoco

        model, size = self.model, self.model.geom_size[number]
        shape = mujoco.mjtGeom(model.geom_type[number])
        if shape == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.mesh(int(model.geom_dataid[number]))
            start, count = int(mesh.vertadr[0]), int(mesh.vertnum[0])
            first, faces = int(mesh.faceadr[0]), int(mesh.facenum[0])
            vertices = model.mesh_vert[start : start + count]
            triangles = model.mesh_face[first : first + faces]
            return trimesh.Trimesh(vertices, triangles, process=False), False
        if shape == mujoco.mjtGeom.mjGEOM_BOX:
            return trimesh.creation.box(2 * size), False
        if shape == mujoco.mjtGeom.mjGEOM_CYLINDER:
            return trimesh.creation.cylinder(size[0], 2 * size[1], sections=SIDES), False
        if shape == mujoco.mjtGeom.mjGEOM_CAPSULE:
            return trimesh.creation.capsule(2 * size[1], size[0], count=[SIDES, SIDES]), True
        ball = trimesh.creation.icosphere(subdivisions=5)
        sphere = shape == mujoco.mjtGeom.mjGEOM_SPHERE
        ball.apply_scale(size[0] if sphere else size)
        return ball, True


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


def _mjcf(fov_y_deg: float) -> str:
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
        <mesh name="link" file="link.stl"/><material name="steel" rgba=".7 .7 .7 1"/></asset>
      <worldbody><light pos="0 0 3"/>
        <geom type="box" pos="0 0 -0.05" size="2 2 0.05" rgba=".5 .5 .5 1"/>
        <geom type="box" pos="0 0 .38" size=".4 .4 .02" rgba=".75 .7 .6 1"/>
        {_objects()}
        <body pos="-0.45 0 .4">{arm}</body>
        <camera name="overhead" pos="0 -0.55 1.0" xyaxes="1 0 0 0 0.75 0.65" {camera}/>
      </worldbody></mujoco>"""


def _objects() -> str:
    rng = np.random.default_rng(0)
    shapes = ("box", "sphere", "cylinder", "capsule", "ellipsoid", "lump", "ring")
    lines = []
    for number in range(OBJECTS):
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
