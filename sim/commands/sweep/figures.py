"""Figures of a sweep's cameras: depth error on a wall, holes at depth edges, by distance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.sim.commands.sweep import axes
from starling.sim.commands.sweep.axes import Camera
from starling.sim.geometry import frames
from starling.sim.metrics import MAD_TO_SIGMA
from starling.sim.reason import Reason
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import materials
from starling.sim.scene.builtin import scenes, solids
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import simulate

TILT_DEG = 20.0  # Tilt of the wall: disparities above 6 px cover all fractions of a pixel.
BEHIND = 1.5  # Distance of the wall behind the posts, relative to the posts' distance.
PITCH, WIDTH = 0.4, 0.1  # Pitch and width of the posts, relative to their distance.
_POSTS = 9
_MIDDLE = 0.4  # Share of rows and columns on which the depth error is measured.
_WRONG_PX = 1.0  # Larger disparity errors count as wrong [px].
_FEWEST = 0.5  # Least share of these pixels with depth; with fewer the error is NaN.


@dataclass(frozen=True, kw_only=True, slots=True)
class Figures:
    """One camera at one distance. Errors are NaN if most of the wall has no depth."""

    bias_m: float  # Median depth error on the tilted wall [m].
    noise_m: float  # 1.4826 x median absolute deviation of that error [m].
    noise_px: float  # 1.4826 x median absolute deviation of the disparity error [px].
    wall_holes: float  # Share of the wall's middle that has no depth.
    holes: Mapping[str, float]  # Share of the posts' image without depth, by reason.
    wrong: float  # Share of the posts' image with a disparity error above 1 px.
    unseen: float  # Share of the posts' image hidden from the right imager or the projector.

    @property
    def hole_rate(self) -> float:
        """Share of the image of the posts without depth, for any reason."""
        return sum(self.holes.values())


def tilted_wall(distance_m: float) -> Scene:
    """Return the builtin wall, tilted by `TILT_DEG`, at `distance_m` on the optical axis.

    A wall perpendicular to the axis has one disparity, so its error would depend on one fraction
    of a pixel. In the middle of the image the depth varies by 8 % either way.
    """
    square_m = distance_m * float(np.cos(np.deg2rad(TILT_DEG)))
    wall = scenes.wall(square_m)
    tilted = frames.pose((0, 0, 0), (TILT_DEG, 0, 0))
    return Scene(name=f"tilted wall:{distance_m:g}", bodies=wall.bodies, world_from_left=tilted)


def posts(distance_m: float) -> Scene:
    """Return paper posts at `distance_m`, as high as the image, in front of a wall.

    Their pitch is 0.4 and their width 0.1 of the distance. Left of each, f b / (3 z) columns of
    the wall are hidden from the right imager. A projector at x casts a shadow f |x| / (3 z)
    columns wide: on the same side for x > 0, on the other side for x < 0.
    """
    behind_m = BEHIND * distance_m
    sheet = solids.plane(8 * distance_m, 8 * distance_m)
    bodies = [solids.body("wall", sheet, materials.WALL_PAINT, frames.pose((0, 0, behind_m)))]
    for number in range(_POSTS):
        x = (number - _POSTS // 2) * PITCH * distance_m
        post = solids.plane(WIDTH * distance_m, 6 * distance_m)
        place = frames.pose((x, 0, distance_m))
        bodies.append(solids.body(f"post {number}", post, materials.PAPER, place))
    return Scene(name=f"posts:{distance_m:g}", bodies=tuple(bodies))


@dataclass(frozen=True, slots=True)
class SweepScenes:
    """Both scenes at one distance, loaded for any camera."""

    wall: MitsubaScene
    posts: MitsubaScene

    @staticmethod
    def at_distance(distance_m: float) -> SweepScenes:
        """Load the scenes; the distance is that of the wall on the axis, and of the posts."""
        return SweepScenes(MitsubaScene(tilted_wall(distance_m)), MitsubaScene(posts(distance_m)))


def measure(sensor: Sensor, stages: SweepScenes, *, seed: int = 0) -> Figures:
    """Simulate both scenes once and measure.

    Args:
        sensor: the camera, with noise, matcher and post-processing.
        stages: the scenes at one distance.
        seed: seed of the noise.
    """
    shot = simulate(stages.wall, sensor, seed=seed)
    truth_m = _middle(shot.layers.truth.depth_m)
    measured_m = _middle(shot.depth.depth_m)
    error_m = (measured_m - truth_m).astype(np.float64)
    fb = np.float64(sensor.focal_baseline_px_m)
    error_px = _middle(shot.depth.disparity_px) - fb / truth_m
    before_wall = simulate(stages.posts, sensor, seed=seed)
    depth, geometry = before_wall.depth, before_wall.layers.truth
    off_px = np.abs(depth.disparity_px - fb / geometry.depth_m)
    lit = geometry.lit | (sensor.projector.power_w == 0)
    return Figures(
        bias_m=float(np.median(_known(error_m))),
        noise_m=_spread(error_m),
        noise_px=_spread(error_px),
        wall_holes=float(np.mean(~np.isfinite(measured_m))),
        holes={
            cause.name.lower(): float(np.mean(depth.reason == cause))
            for cause in Reason
            if cause is not Reason.VALID
        },
        wrong=float(np.mean(off_px > _WRONG_PX)),
        unseen=float(np.mean(~(geometry.right_sees & lit))),
    )


def nearest_m(sensor: Sensor) -> float:
    """Return the least depth [m] within the matcher's search, f b over the largest disparity."""
    return sensor.focal_baseline_px_m / sensor.matcher.largest_px


def law_m(sensor: Sensor, distance_m: float, sigma_d_px: float) -> float:
    """Return the depth noise [m] of a disparity noise [px]: z^2 / (f b) sigma_d, to first order.

    Source: Szeliski, Computer Vision, 2nd ed., sec. 12.1.
    """
    return distance_m**2 / sensor.focal_baseline_px_m * sigma_d_px


def _middle(image: NDArray) -> NDArray:
    """Cut out the middle of an image, where camera makers measure depth noise."""
    height, width = image.shape
    edge = (1 - _MIDDLE) / 2
    rows = slice(round(edge * height), round((1 - edge) * height))
    return image[rows, round(edge * width) : round((1 - edge) * width)]


def _known(error: NDArray) -> NDArray:
    """Return the finite errors, or a single NaN if they are too few."""
    known = error[np.isfinite(error)]
    return known if known.size >= _FEWEST * error.size else np.array([np.nan])


def _spread(error: NDArray) -> float:
    known = _known(error)
    return MAD_TO_SIGMA * float(np.median(np.abs(known - np.median(known))))


@dataclass(frozen=True, kw_only=True, slots=True)
class Sweep:
    """Figures of every camera at every distance."""

    cameras: tuple[Camera, ...]  # The base comes first.
    distances_m: tuple[float, ...]  # Ascending.
    figures: tuple[tuple[Figures, ...], ...]  # By camera, then by distance.
    reference: int  # Index of the distance at which the law's disparity noise is measured.

    @property
    def sigma_d_px(self) -> float:
        """Disparity noise of the law [px]: the base camera's, at the reference distance."""
        return self.figures[0][self.reference].noise_px

    def name(self, camera: Camera) -> str:
        """Name of a camera: its differences from the base."""
        return axes.name_of(camera, self.cameras[0])

    def law_m(self, camera: Camera) -> list[float]:
        """Depth noise [m] at every distance, by the law z^2 / (f b) sigma_d."""
        sigma = self.sigma_d_px
        return [law_m(camera.sensor, z, sigma) for z in self.distances_m]

    def figures_of(self, camera: Camera) -> tuple[Figures, ...]:
        """Return the figures of one camera at every distance."""
        return self.figures[self.cameras.index(camera)]
