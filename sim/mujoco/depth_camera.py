"""A depth camera in a MuJoCo model, read in a loop."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.corrupt import (
    Corruptor,
    HoleModel,
    Reading,
    narrow_search,
    reading_of,
    refuse_unloaded,
    without_depth,
)
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.mujoco import model_scene
from starling.sim.mujoco.buffers import Buffers
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import visible
from starling.sim.sensor import edits, presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Quality, expose, refuse_impossible, render_views
from starling.sim.stereo.post.temporal import History

By = Literal["warp", "trace"]


class DepthCamera:
    """Reads what a depth camera at a named camera of a model would return."""

    def __init__(
        self,
        model: Any,
        camera: str,
        sensor: Sensor | Path | str = "d435",
        *,
        by: By = "warp",
        size: tuple[int, int] | None = None,
        camera_from_left_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
        views: Literal[1, 3] = 1,
        quality: Quality = "draft",
        groups: tuple[int, ...] = model_scene.GROUPS,
        ambient_w_m2: float = 0.1,
        residual: HoleModel | None = None,
        seed: int = 0,
    ) -> None:
        """Prepare the camera.

        Args:
            model: `mujoco.MjModel`.
            camera: name of a camera in the model. The left imager stands there.
            sensor: depth camera to imitate, or its name as for `starling.load_sensor`.
            by: `warp` corrupts MuJoCo's own depth image. `trace` traces rays through the model,
                with the shadows and gloss that a depth image lacks, and is slower.
            size: (width, height) of the images, with the field of the model's camera. Without it,
                images are those of the model's camera if it has a `resolution`, and the sensor's
                own otherwise.
            camera_from_left_m: place of the left imager in the frame of the model's camera, if that
                is the middle of a housing; x right, y down, z forward. D435: (-0.0175, 0, 0), D415:
                (-0.020, 0, 0), D455: (-0.0475, 0, 0).
            views: 3 draws two further depth images for `warp`, from the right imager and the
                projector, which makes occlusions and shadows exact. `trace` needs none.
            quality: quality of `trace`, as for `starling.simulate`; `warp` has one. `draft` also
                searches only the disparities of the scene, as `warp` does.
            groups: groups of geoms to show.
            ambient_w_m2: irradiance of ambient light.
            residual: removes depth where a trained model does; from `starling.load_residual`.
            seed: seed of the noise. Each reading has its own.

        Raises:
            InputError: no model, unknown camera, sensor or argument; or MuJoCo cannot draw on this
                machine.
        """
        model_scene.refuse_model(model, groups)
        errors.one_of("by", by, get_args(By))
        errors.one_of("quality", quality, get_args(Quality))
        refuse_unloaded(residual)
        if views not in (1, 3):
            raise errors.refuse("views", "must be 1 or 3", views, "3 is exact, 1 is faster.")
        errors.vector("camera_from_left_m", camera_from_left_m, -1.0, 1.0, "Give metres.")
        self._seed = errors.whole_number("seed", seed, 0, 2**63 - 1, "Give a whole number from 0.")
        self._number = model_scene.camera_number(model, camera)
        self.sensor = _with_camera(presets.resolved(sensor), model, self._number, size)
        has_field = size is not None or model_scene.resolution(model, self._number) is not None
        self._field = model_scene.field_of(model, self._number) if has_field else None
        self._camera_from_left = frames.pose(camera_from_left_m)
        self._model, self._frame, self._open = model, 0, True
        self._history: History | None = None
        self._source: _Warp | _Trace
        if by == "warp":
            self._source = _Warp(model, self.sensor, groups, ambient_w_m2, views, residual)
        else:
            self._source = _Trace(model, self.sensor, groups, ambient_w_m2, quality, residual)

    def read(self, data: Any) -> Reading:
        """Return one reading of the model's state; a temporal filter continues from the last one.

        Args:
            data: `mujoco.MjData` with current kinematics, as after `mujoco.mj_step`.

        Raises:
            InputError: if there are no finite kinematics of the camera's model, its field has
                changed, or the camera is closed.
        """
        if not self._open:
            raise errors.refuse("camera", "must be open", "a closed one", "Make a new one.")
        model_scene.refuse_data(data, self._model)
        if self._field not in (None, model_scene.field_of(self._model, self._number)):
            advice = "Make a new DepthCamera."
            raise errors.refuse("field of the model's camera", "must stay", "another one", advice)
        pose = model_scene.camera_pose(data, self._number) @ self._camera_from_left
        reading = self._source.read(data, pose, (self._seed, self._frame), self._history)
        self._frame += 1
        self._history = reading.history
        return reading

    def reset(self, seed: int | None = None) -> None:
        """Begin a new episode: frame 0, nothing to filter; `seed` replaces the seed."""
        if seed is not None:
            self._seed = errors.whole_number("seed", seed, 0, 2**63 - 1, "Give a whole number.")
        self._frame, self._history = 0, None

    @property
    def camera_matrix(self) -> NDArray[np.float64]:
        """Camera matrix (3, 3) of the depth image [px]."""
        return Pinhole.from_camera(self.sensor).matrix

    def close(self) -> None:
        """Free what the camera draws with; it reads no more."""
        self._open = False
        self._source.close()


class _Warp:
    """Corrupts MuJoCo's own depth images."""

    def __init__(
        self,
        model: Any,
        sensor: Sensor,
        groups: tuple[int, ...],
        ambient_w_m2: float,
        views: int,
        residual: HoleModel | None,
    ) -> None:
        effects = {"ambient": ambient_w_m2}
        matrix = Pinhole.from_camera(sensor).matrix
        self._corruptor = Corruptor(sensor, matrix, effects=effects, residual=residual)
        self._buffers = Buffers(model, sensor, groups)
        self._views = views

    def read(self, data: Any, pose: Pose, number: tuple[int, int], past: History | None) -> Reading:
        corruptor, draw = self._corruptor, self._buffers.draw
        self._buffers.update(data, pose)
        depth, colours = draw(pose, colours=True)
        right = projector = None
        if self._views == 3:
            right, _ = draw(pose @ corruptor.left_from_right)
            projector, _ = draw(pose @ corruptor.left_from_projector)
        lit = corruptor.light(
            depth,
            reflectance=colours,
            up=pose[:3, :3].T @ model_scene.UP,
            right_depth_m=right,
            projector_depth_m=projector,
            empty=True,
            is_along_axis=True,
        )
        seed, frame = number
        return corruptor.read(lit, seed=seed, frame=frame, past=past)

    def close(self) -> None:
        self._buffers.close()


class _Trace:
    """Traces rays through the model's geoms."""

    def __init__(
        self,
        model: Any,
        sensor: Sensor,
        groups: tuple[int, ...],
        ambient_w_m2: float,
        quality: Quality,
        residual: HoleModel | None,
    ) -> None:
        refuse_impossible(sensor, 2)
        self._model, self._sensor = model, sensor
        self._quality: Quality = quality
        self._ambient_w_m2, self._residual = ambient_w_m2, residual
        self._groups, self._geoms = groups, model_scene.shown(model, groups, level=4)
        self._looks = model_scene.looks_of(model)
        # One scene, or one for each colour of the sensor; built by the first reading.
        self._stages: tuple[MitsubaScene, ...] = ()

    def read(self, data: Any, pose: Pose, number: tuple[int, int], past: History | None) -> Reading:
        looks = model_scene.looks_of(self._model)
        if looks != self._looks:
            self._looks, self._stages = looks, ()
            self._geoms = model_scene.shown(self._model, self._groups, level=4)
        self._stages = self._placed(data, pose) if self._stages else self._built(data, pose)
        sensor, (seed, frame) = self._sensor, number
        layers = render_views(self._stages, sensor, seed=seed, quality=self._quality)
        searched = sensor
        if self._quality == "draft":
            searched = narrow_search(sensor, layers.truth.depth_m)
        scene = self._stages[0].scene
        shot = expose(layers, scene, searched, seed=seed, frame=frame, past=past)
        if not np.isfinite(layers.truth.depth_m).any():
            shot = without_depth(shot, past)
        return reading_of(shot, sensor, self._residual, seed=seed, frame=frame)

    def _built(self, data: Any, pose: Pose) -> tuple[MitsubaScene, ...]:
        """The model in its present state, seen from a pose."""
        geoms, light = self._geoms, self._ambient_w_m2
        scene = model_scene.assembled(self._model, data, geoms, name="mujoco", ambient_w_m2=light)
        scene = dataclasses.replace(scene, world_from_left=pose)
        return tuple(map(MitsubaScene, visible.views(scene, self._sensor)))

    def _placed(self, data: Any, pose: Pose) -> tuple[MitsubaScene, ...]:
        """The scenes of the last reading, with geoms and camera in their present poses."""
        poses = (model_scene.geom_pose(data, geom) for geom in self._geoms)
        moved = {
            body.name: placed
            for body, placed in zip(self._stages[0].scene.bodies, poses, strict=True)
            if not np.array_equal(placed, body.world_from_body)
        }
        return tuple(
            stage.with_scene(dataclasses.replace(stage.scene, world_from_left=pose)).place(moved)
            for stage in self._stages
        )

    def close(self) -> None:
        self._stages = ()


def _with_camera(sensor: Sensor, model: Any, number: int, size: tuple[int, int] | None) -> Sensor:
    """The sensor with the intrinsics of the model's camera, if it has any."""
    chosen = model_scene.resolution(model, number) if size is None else size
    if chosen is None:
        return sensor
    if np.shape(chosen) != (2,):
        raise errors.refuse("size", "must be (width, height)", repr(chosen), "Give pixels.")
    for side in chosen:
        errors.whole_number("entry of size", side, 1, 2**31, "Give (width, height) in pixels.")
    return edits.with_camera(sensor, model_scene.intrinsics(model, number, chosen), chosen)
