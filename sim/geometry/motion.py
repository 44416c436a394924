"""Motion blur and rolling shutter: an exposure averages the views along the sensor's path.

Imagers and projector move as a rigid unit through a static scene. With a rolling shutter each row
is exposed at its own time. Time 0 is the middle of the middle row's exposure, the same in both
imagers. The ground truth belongs to time 0.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.geometry import frames
from starling.sim.render import backend
from starling.sim.render.lights import Lights
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.render.rays import JitCamera, JitPose, opaque, pixels
from starling.sim.scene.scene import Motion
from starling.sim.sensor.sensor import Sensor

CENTRE = (0.0, 0.0, 0.0)  # Position and time of the single moment at rest (see `moments`).
STEP_PX = 0.5  # Largest image motion between two averaged views [px].
_MOST_PX = 100.0  # Longest blur; longer ones are not useful and take minutes [px].
_GRID_PX = 8  # Spacing of the pixels at which image motion is measured [px].
_NEAREST_M = 0.01  # Lower limit of depth in the projection [m].


@dataclass(frozen=True, slots=True)
class ExposureMotion:
    """Motion of one imager and the projector through one exposure."""

    pivot: Any  # Point3f: the left imager at time 0, the centre of rotation.
    velocity: Any  # Vector3f, world [m/s]
    axis: Any  # Vector3f, world, unit length
    rate: Any  # Float [rad/s]
    delay: Any  # Float: exposure time of each pixel after the middle row's [s].
    exposure_s: float
    steps: int  # Number of time samples.

    def pose_at(self, time_s: Any, pose: JitPose) -> JitPose:
        """Pose of a part of the rig at `time_s`, plus each pixel's own delay."""
        dr = backend.drjit()
        time = time_s + dr.tile(self.delay, dr.width(time_s) // dr.width(self.delay))
        sine, cosine = dr.sincos(self.rate * time)

        def rotate(vector: Any) -> Any:  # Rodrigues' formula.
            along = self.axis * dr.dot(self.axis, vector)
            return along + (vector - along) * cosine + dr.cross(self.axis, vector) * sine

        origin = self.pivot + self.velocity * time + rotate(pose.origin - self.pivot)
        return JitPose(rotate(pose.x), rotate(pose.y), rotate(pose.z), origin)


def exposure_motions(
    mi_scene: MitsubaScene,
    sensor: Sensor,
    left: JitCamera,
    exposure_s: float,
    *,
    step_px: float = STEP_PX,
) -> tuple[ExposureMotion | None, ExposureMotion | None]:
    """Motion of the left and the right imager through one exposure; None for a still sensor.

    Args:
        mi_scene: Scene with its motion.
        sensor: Sensor with the imagers' rolling shutters.
        left: Left imager at time 0.
        exposure_s: Integration time [s].
        step_px: Largest image motion between two time samples [px].

    Raises:
        BackendError: in a variant that cannot trace moving rays.
        InputError: if the blur of any point exceeds 100 px.
    """
    motion = mi_scene.scene.motion
    if motion.still:
        return None, None
    blur_px = _longest_blur_px(mi_scene, left, exposure_s)
    if blur_px > _MOST_PX:
        raise errors.refuse(
            "scene.motion",
            f"must blur the image by at most {_MOST_PX:g} px",
            f"{blur_px:.0f} px in {exposure_s:g} s",
            "Slow it down, or shorten the exposure.",
        )
    world_from_left = mi_scene.scene.world_from_left
    velocity = opaque("Vector3f", world_from_left[:3, :3] @ motion.velocity_m_s)
    turn = np.deg2rad(world_from_left[:3, :3] @ motion.turn_deg_s)
    rate = float(np.linalg.norm(turn))
    axis = opaque("Vector3f", turn / rate if rate else (0.0, 0.0, 1.0))
    row = pixels(left.size).y / (left.size[1] - 1) - 0.5
    left_motion, right_motion = (
        ExposureMotion(
            pivot=left.place.origin,
            velocity=velocity,
            axis=axis,
            rate=opaque("Float", [rate]),
            delay=row * opaque("Float", [imager.rolling_shutter_s]),
            exposure_s=exposure_s,
            steps=int(np.ceil(blur_px / step_px)),
        )
        for imager in (sensor.left, sensor.right)
    )
    return left_motion, right_motion


def moments(subpixels: int, path: ExposureMotion | None) -> list[tuple[float, float, float]]:
    """List the sub-pixel positions and times whose average is the exposure.

    Args:
        subpixels: n of the n x n fixed positions in a pixel.
        path: Motion through the exposure; None for a still sensor.

    Returns:
        Tuples of x, y [px from the pixel's centre] and time [s]. Times are spread evenly over the
        exposure. Each position is sampled at t and -t, so that positions have equal mean times.
    """
    positions = [
        ((column + 0.5) / subpixels - 0.5, (row + 0.5) / subpixels - 0.5)
        for row, column in np.ndindex(subpixels, subpixels)
    ]
    if path is None:
        return [(x, y, 0.0) for x, y in positions]
    half = len(positions) * int(np.ceil(max(path.steps, 1) / (2 * len(positions))))
    times = (np.arange(half) + 0.5) / (2 * half) * path.exposure_s
    return [
        (*positions[number % len(positions)], float(sign * time))
        for number, time in enumerate(times)
        for sign in (-1, 1)
    ]


def at_time(
    path: ExposureMotion | None, time_s: Any, camera: JitCamera, lights: Lights
) -> tuple[JitCamera, Lights]:
    """Return imager and lights at the given times; unchanged for a still sensor.

    The sun and other devices do not move.
    """
    if path is None:
        return camera, lights
    moved = dataclasses.replace(
        lights.projector, place=path.pose_at(time_s, lights.projector.place)
    )
    return (
        dataclasses.replace(camera, place=path.pose_at(time_s, camera.place)),
        dataclasses.replace(lights, projector=moved),
    )


def refuse_without_compiler(motion: Motion) -> None:
    """Refuse motion in the variant that renders with Mitsuba's own integrators.

    Raises:
        BackendError: if the sensor moves.
    """
    if not motion.still:
        raise backend.BackendError(
            "scene.motion must be still in scalar_rgb; got a moving sensor. "
            "Install libllvm19 for the compiled variant."
        )


def _longest_blur_px(mi_scene: MitsubaScene, left: JitCamera, exposure_s: float) -> float:
    """Longest image motion of a surface point during the exposure, left imager [px]."""
    mi, dr = backend.mitsuba(), backend.drjit()
    columns, rows = (np.arange(0, size, _GRID_PX, dtype=np.float32) for size in left.size)
    grid = np.meshgrid(columns, rows)
    pixel = mi.Vector2f(*(mi.Float(axis.ravel()) for axis in grid))
    si = mi_scene.mitsuba.ray_intersect(left.ray(pixel))
    local, valid = left.place.local(si.p), si.is_valid()
    dr.eval(local, valid)
    points = np.array(local, np.float64).T[np.array(valid)]
    if len(points) == 0:
        return 0.0
    motion, half = mi_scene.scene.motion, exposure_s / 2
    start, end = (_projected(points, motion, time, left) for time in (-half, half))
    return float(np.linalg.norm(end - start, axis=1).max())


def _projected(
    points: NDArray[np.float64], motion: Motion, time_s: float, left: JitCamera
) -> NDArray[np.float64]:
    """Image positions (n, 2) at `time_s` of points given in the left frame at time 0."""
    vx, vy, vz = (value * time_s for value in motion.velocity_m_s)
    wx, wy, wz = (value * time_s for value in motion.turn_deg_s)
    moved = frames.pose((vx, vy, vz), (wx, wy, wz))
    local = (points - moved[:3, 3]) @ moved[:3, :3]
    slope = local[:, :2] / np.maximum(local[:, 2:], _NEAREST_M)
    return slope * np.array(left.focal, np.float64).ravel()
