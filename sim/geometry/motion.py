"""The sensor in motion: an exposure is the average of views from the poses it passes through.

The rig moves as one, imagers and projector, while the scene keeps still. Every row of an imager
with a rolling shutter is exposed at its own time. Time is counted from the middle of the exposure
of the left imager's middle row, to which the truth belongs; both imagers' middle rows are exposed
together.
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
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.render.rays import Camera, Placed, opaque, pixels
from starling.sim.scene.scene import Motion
from starling.sim.sensor.sensor import Sensor

STEP_PX = 0.5  # Image motion between one moment and the next.
_MOST_PX = 100.0  # Longer blur is no image, and takes minutes.
_GRID_PX = 8  # Of the pixels whose motion is looked at.
_NEAREST_M = 0.01  # What comes nearer counts as that near.


@dataclass(frozen=True, slots=True)
class Path:
    """One imager's way, and the projector's with it, through one exposure."""

    pivot: Any  # Point3f: the left imager at time 0, about which the rig turns.
    velocity: Any  # Vector3f, world [m/s]
    axis: Any  # Vector3f, world, unit length
    rate: Any  # Float [rad/s]
    delay: Any  # Float: by which each pixel is exposed later than the middle row [s].
    exposure_s: float
    steps: int  # Moments that follow one another.

    def at(self, time_s: Any, place: Placed) -> Placed:
        """Place of a part of the rig at times of all pixels in turn, by each one's own delay."""
        dr = backend.drjit()
        time = time_s + dr.tile(self.delay, dr.width(time_s) // dr.width(self.delay))
        sine, cosine = dr.sincos(self.rate * time)

        def turned(vector: Any) -> Any:  # Rodrigues' formula.
            along = self.axis * dr.dot(self.axis, vector)
            return along + (vector - along) * cosine + dr.cross(self.axis, vector) * sine

        origin = self.pivot + self.velocity * time + turned(place.origin - self.pivot)
        return Placed(turned(place.x), turned(place.y), turned(place.z), origin)


def paths(
    stage: Stage, sensor: Sensor, left: Camera, exposure_s: float, *, step_px: float = STEP_PX
) -> tuple[Path | None, Path | None]:
    """Ways of the left and the right imager through one exposure; None where nothing moves.

    Args:
        stage: with the scene's motion.
        sensor: with the imagers' rolling shutters.
        left: the left imager at time 0.
        exposure_s: integration time.
        step_px: image motion between one moment and the next.

    Raises:
        BackendError: in a variant that cannot trace moving rays.
        InputError: if something blurs over more than 100 px.
    """
    motion = stage.scene.motion
    if motion.still:
        return None, None
    blur_px = _longest_blur_px(stage, left, exposure_s)
    if blur_px > _MOST_PX:
        raise errors.refuse(
            "scene.motion",
            f"must blur the image by at most {_MOST_PX:g} px",
            f"{blur_px:.0f} px in {exposure_s:g} s",
            "Slow it down, or shorten the exposure.",
        )
    world_from_left = stage.scene.world_from_left
    velocity = opaque("Vector3f", world_from_left[:3, :3] @ motion.velocity_m_s)
    turn = np.deg2rad(world_from_left[:3, :3] @ motion.turn_deg_s)
    rate = float(np.linalg.norm(turn))
    axis = opaque("Vector3f", turn / rate if rate else (0.0, 0.0, 1.0))
    row = pixels(left.size).y / (left.size[1] - 1) - 0.5
    found = [
        Path(
            pivot=left.place.origin,
            velocity=velocity,
            axis=axis,
            rate=opaque("Float", [rate]),
            delay=row * opaque("Float", [imager.rolling_shutter_s]),
            exposure_s=exposure_s,
            steps=int(np.ceil(blur_px / step_px)),
        )
        for imager in (sensor.left, sensor.right)
    ]
    return found[0], found[1]


def moments(subpixels: int, path: Path | None) -> list[tuple[float, float, float]]:
    """Give the positions in a pixel, and the times, whose average is the exposure.

    Args:
        subpixels: n of the n x n fixed positions in a pixel.
        path: None where nothing moves.

    Returns:
        Tuples of x, y [px from the pixel's centre] and time [s]. Times are evenly spread over
        the exposure; each position is taken at t and -t, so that none leads the others.
    """
    places = [
        ((column + 0.5) / subpixels - 0.5, (row + 0.5) / subpixels - 0.5)
        for row, column in np.ndindex(subpixels, subpixels)
    ]
    if path is None:
        return [(x, y, 0.0) for x, y in places]
    half = len(places) * int(np.ceil(max(path.steps, 1) / (2 * len(places))))
    times = (np.arange(half) + 0.5) / (2 * half) * path.exposure_s
    return [
        (*places[number % len(places)], float(sign * time))
        for number, time in enumerate(times)
        for sign in (-1, 1)
    ]


def at(path: Path | None, time_s: Any, camera: Camera, lights: Lights) -> tuple[Camera, Lights]:
    """Give imager and lights at times of all pixels in turn; the same where nothing moves.

    The sun and other devices keep still.
    """
    if path is None:
        return camera, lights
    moved = dataclasses.replace(lights.projector, place=path.at(time_s, lights.projector.place))
    return (
        dataclasses.replace(camera, place=path.at(time_s, camera.place)),
        dataclasses.replace(lights, projector=moved),
    )


def refuse_without_compiler(motion: Motion) -> None:
    """Refuse motion in a variant that renders by Mitsuba's own integrators.

    Raises:
        BackendError: if anything moves.
    """
    if not motion.still:
        raise backend.BackendError(
            "scene.motion must be still in scalar_rgb; got a moving sensor. "
            "Install libllvm19 for the compiled variant."
        )


def _longest_blur_px(stage: Stage, left: Camera, exposure_s: float) -> float:
    """Longest way of a surface point over the left image within the exposure [px]."""
    mi, dr = backend.mitsuba(), backend.drjit()
    columns, rows = (np.arange(0, size, _GRID_PX, dtype=np.float32) for size in left.size)
    grid = np.meshgrid(columns, rows)
    pixel = mi.Vector2f(*(mi.Float(axis.ravel()) for axis in grid))
    si = stage.mitsuba.ray_intersect(left.ray(pixel))
    local, seen = left.place.local(si.p), si.is_valid()
    dr.eval(local, seen)
    points = np.array(local, np.float64).T[np.array(seen)]
    if len(points) == 0:
        return 0.0
    motion, half = stage.scene.motion, exposure_s / 2
    start, end = (_projected(points, motion, time, left) for time in (-half, half))
    return float(np.linalg.norm(end - start, axis=1).max())


def _projected(
    points: NDArray[np.float64], motion: Motion, time_s: float, left: Camera
) -> NDArray[np.float64]:
    """Pixels (n, 2) at which points of the left frame at time 0 are seen at another time."""
    vx, vy, vz = (value * time_s for value in motion.velocity_m_s)
    wx, wy, wz = (value * time_s for value in motion.turn_deg_s)
    moved = frames.pose((vx, vy, vz), (wx, wy, wz))
    seen = (points - moved[:3, 3]) @ moved[:3, :3]
    slope = seen[:, :2] / np.maximum(seen[:, 2:], _NEAREST_M)
    return slope * np.array(left.focal, np.float64).ravel()
