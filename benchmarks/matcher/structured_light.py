"""Compare a simulated structured-light camera with real Kinect v1 frames: steps, noise, planes.

    python benchmarks/matcher/structured_light.py [--sensor kinect-v1]

Captures: `kinect-v1-tables` in $STARLING_CAPTURES. Each real table is a plane, which is simulated
and measured in the same part of the image. Parameters were chosen on `learn*` frames only.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim import randomness
from starling.sim.captures import capture
from starling.sim.scene import materials
from starling.sim.scene.builtin import scenes, solids
from starling.sim.scene.scene import Body, Mesh, Scene
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot, simulate
from starling.sim.stereo import depth

STEPS_PER_PX = 8  # Kinect's disparities come in eighths of a pixel of the 640-column image.
CLIP_M = 0.01  # Maximum distance of a plane's points, along its normal.
TILE_PX = 32  # Side of the tiles with separate planes, for the local noise.
AROUND = (0.97, 0.985, 1.0, 1.015, 1.03)  # Nearby walls; each has one fraction of disparity.
WALLS_M = (0.6, 0.8, 1.0, 1.5, 2.0, 2.5, 3.0)
TABLE = 1  # Label of the table.
BASELINE_M = 0.075
FOCAL_BASELINE = 575.8 * BASELINE_M  # f * b of the device [px m]; see `steps`.
COLOUR_FROM_PROJECTOR_M = 0.05  # Assumed: frames are registered to the colour camera, 25 mm away.

Points = NDArray[np.float64]
Mask = NDArray[np.bool_]
Camera = Sensor | capture.CaptureInfo


def folder() -> Path:
    return Path(os.environ.get("STARLING_CAPTURES", "")) / "kinect-v1-tables"


def published_m(depth_m: float) -> float:
    """Return the axial noise of a Kinect v1 [m] (Nguyen et al. 2012, eq. 2, up to 60 deg)."""
    return 1.2e-3 + 1.9e-3 * (depth_m - 0.4) ** 2


def rays_of(camera: Camera) -> Points:
    """Return the ray (h, w, 3) with z = 1 through each pixel's centre."""
    v, u = np.mgrid[: camera.height, : camera.width].astype(np.float64)
    x, y = (u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px
    return np.stack([x, y, np.ones_like(x)], axis=-1)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Plane:
    """Points p with normal . p = distance_m; the unit normal points towards the camera."""

    normal: Points
    distance_m: float  # Below 0 if the camera is in front of the plane.

    @property
    def tilt_deg(self) -> float:
        """Angle between the normal and the optical axis."""
        return float(np.degrees(np.arccos(-self.normal[2])))

    def depth_m(self, rays: Points) -> Points:
        """Return the depth at which rays with z = 1 meet the plane."""
        return self.distance_m / (rays @ self.normal)


def plane(points: Points, *, seed: int = 0) -> Plane:
    """Fit a plane to points (n, 3): RANSAC with +-CLIP_M, then least squares of the inliers."""
    rng = randomness.generator(seed, 0, "benchmark", "ransac")
    sample = points[rng.choice(len(points), min(4000, len(points)), replace=False)]
    best, highest_count = Plane(normal=np.array([0.0, 0, -1]), distance_m=-1.0), 0
    for _ in range(300):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-9:
            continue
        candidate = _facing(normal / length, a)
        count = int((np.abs(sample @ candidate.normal - candidate.distance_m) < CLIP_M).sum())
        if count > highest_count:
            best, highest_count = candidate, count
    for _ in range(8):
        inliers = points[np.abs(points @ best.normal - best.distance_m) < CLIP_M]
        middle = inliers.mean(axis=0)
        scatter = (inliers - middle).T @ (inliers - middle)
        best = _facing(np.linalg.eigh(scatter)[1][:, 0], middle)
    return best


def _facing(normal: Points, point: Points) -> Plane:
    normal = -normal * np.sign(normal @ point)
    return Plane(normal=normal, distance_m=float(normal @ point))


def nmad(values: Points) -> float:
    """Return 1.4826 times the median absolute deviation, the sigma of a normal distribution."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


@dataclass(frozen=True, kw_only=True, slots=True)
class TableFigures:
    """Deviations of a depth image from its fitted plane.

    Sigma is that of depth minus the plane's depth along the pixel's ray (axial noise), over the
    labelled table. Along the normal it is smaller by the cosine of ray and normal.
    """

    median_m: float  # Depth.
    tilt_deg: float
    sigma_mm: float  # 1.4826 MAD of depth minus the plane's.
    clipped_mm: float  # Standard deviation of the same within +-10 mm.
    normal_mm: float  # Standard deviation along the normal.
    local_px: float  # Deviation of disparity from planes of tiles; excludes large-scale warp.
    distinct: int  # Number of distinct depth codes.
    fill: float


def table_figures(depth_m: NDArray, where: Mask, camera: Camera, unit_m: float) -> TableFigures:
    """Measure the plane in the mask `where` (h, w); depth is NaN where missing."""
    known = where & np.isfinite(depth_m)
    rays = rays_of(camera)
    depth = depth_m.astype(np.float64)
    points = (rays * depth[..., None])[known]
    fitted = plane(points)
    distance = points @ fitted.normal - fitted.distance_m
    along = depth[known] - fitted.depth_m(rays[known])
    on = np.abs(distance) < CLIP_M
    return TableFigures(
        median_m=float(np.median(depth[known])),
        tilt_deg=fitted.tilt_deg,
        sigma_mm=1e3 * nmad(along),
        clipped_mm=1e3 * float(along[np.abs(along) < CLIP_M].std()),
        normal_mm=1e3 * float(distance[on].std()),
        local_px=float(np.median([sigma for _, sigma in tiles(depth, known)] or [np.nan])),
        distinct=len(np.unique(np.rint(depth[known] / unit_m))),
        fill=float(known.sum() / where.sum()),
    )


def tiles(depth_m: NDArray, where: Mask) -> Iterator[tuple[float, float]]:
    """Yield median depth [m] and sigma of disparity [px] from the plane of each flat tile.

    A plane's disparity is linear in the image. A tile counts if 95 % of it have depth and lie
    within three eighths of a pixel of its plane.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        disparity = FOCAL_BASELINE / depth_m
    v, u = np.mgrid[:TILE_PX, :TILE_PX] / TILE_PX
    linear = np.stack([u.ravel(), v.ravel(), np.ones(TILE_PX**2)], axis=-1)
    for top in range(0, depth_m.shape[0] - TILE_PX + 1, TILE_PX):
        for left in range(0, depth_m.shape[1] - TILE_PX + 1, TILE_PX):
            part = slice(top, top + TILE_PX), slice(left, left + TILE_PX)
            known = where[part].ravel() & np.isfinite(disparity[part].ravel())
            if known.mean() < 0.95:
                continue
            basis, values = linear[known], disparity[part].ravel()[known]
            residual = values - basis @ np.linalg.lstsq(basis, values, rcond=None)[0]
            if (np.abs(residual) < 3 / STEPS_PER_PX).mean() > 0.95:
                yield float(np.median(depth_m[part].ravel()[known])), float(residual.std())


def steps(codes_mm: NDArray) -> tuple[float, float, float]:
    """Fit z = floor(a / (n + offset)) [mm] with integer n to the observed depth values.

    Returns:
        a [mm], eight times focal length times baseline; offset in [0, 1); share of values that
        the law reproduces exactly.
    """
    best = (0.0, 0.0, 0.0)
    for scale in np.arange(345_000.0, 346_000.0, 1.0):
        for offset in np.arange(0.0, 1.0, 0.02):
            count = np.rint(scale / (codes_mm + 0.5) - offset)
            share = float((np.floor(scale / (count + offset)) == codes_mm).mean())
            if share > best[2]:
                best = (float(scale), float(offset), share)
    return best


def codes_mm(captures: capture.CaptureSet) -> NDArray:
    """Return all depth values of the frames [mm], ascending."""
    depth_maps = [scene.frame(0).depth_m for scene in captures.scenes]
    values = [np.unique(np.rint(read[read > 0] * 1e3)) for read in depth_maps if read is not None]
    return np.unique(np.concatenate(values))


def as_seen(where: Mask, real: Camera, sensor: Sensor) -> Mask:
    """Resample a mask of the real view (h, w) to the sensor's focal length."""
    v, u = np.mgrid[: sensor.height, : sensor.width].astype(np.float32)
    scale = np.float32(real.fx_px / sensor.fx_px)
    column = (u - np.float32(sensor.cx_px)) * scale + np.float32(real.cx_px)
    row = (v - np.float32(sensor.cy_px)) * scale + np.float32(real.cy_px)
    return cv2.remap(where.astype(np.uint8), column, row, cv2.INTER_NEAREST) > 0


def table(surface: Plane) -> Scene:
    """Return a scene with the plane from 0.4 m to 2 m of depth, and three boxes on it."""
    across = np.cross(surface.normal, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    along = np.cross(across, surface.normal)
    middle = np.array([0.0, 0.0, surface.distance_m / surface.normal[2]])
    ends = [(depth - middle[2]) / along[2] for depth in (0.4, 2.0)]
    corners = [
        middle + s * across + t * along
        for s, t in ((-2, ends[0]), (2, ends[0]), (2, ends[1]), (-2, ends[1]))
    ]
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]], np.uint32)
    sheet = Mesh(vertices=np.array(corners, np.float32), faces=faces)
    bodies = [Body(name="table", mesh=sheet, material=materials.PAPER)]
    for x, y, height in ((-0.15, 0.0, 0.08), (0.05, 0.08, 0.18), (0.16, -0.08, 0.05)):
        pose = np.eye(4)
        pose[:3, :3] = np.stack([across, along, surface.normal], axis=1)
        pose[:3, 3] = middle + x * across + y * along + surface.normal * height / 2
        bodies.append(
            solids.body(
                f"box at {x:g}", solids.box((0.09, 0.07, height)), materials.CARDBOARD, pose
            )
        )
    return Scene(name="table", bodies=tuple(bodies))


def yaw_deg(tables: list[tuple[NDArray, Mask]], camera: Camera) -> float:
    """Estimate the yaw of a device's projector relative to its factory reference.

    At the projector's tangent x, the yaw shifts light along a row, and disparity, by
    f yaw (1 + x^2). A change of the plane explains a linear shift, so only the square remains.

    Args:
        tables: depth (h, w) [m] and mask of each table.
        camera: camera of the frames.
    """
    focal = FOCAL_BASELINE / BASELINE_M
    squares, residuals = [], []
    for depth_m, where in tables:
        known = where & np.isfinite(depth_m)
        rays = rays_of(camera)[known][::7]
        depth = depth_m[known][::7].astype(np.float64)
        x = rays[:, 0] - COLOUR_FROM_PROJECTOR_M / depth
        columns = np.stack([focal * x * x, FOCAL_BASELINE / depth], axis=-1)
        linear = np.linalg.qr(rays)[0]
        columns -= linear @ (linear.T @ columns)
        on = np.abs(columns[:, 1]) < 6 / STEPS_PER_PX
        squares.append(columns[on, 0])
        residuals.append(columns[on, 1])
    square, disparity = np.concatenate(squares), np.concatenate(residuals)
    return float(np.degrees(square @ disparity / (square @ square)))


def as_written(shot: Shot, sensor: Sensor) -> NDArray[np.float32]:
    """Return depth [m] quantised as in the 16-bit image."""
    unit = sensor.post.depth_unit_m
    return depth.from_code(depth.to_code(shot.depth.depth_m, unit), unit)


def simulated_table(surface: Plane, where: Mask, real: Camera, sensor: Sensor) -> TableFigures:
    """Measure a simulated table of the same plane in the same directions."""
    shot = simulate(table(surface), sensor)
    true_m = shot.layers.truth.depth_m
    on_plane = np.abs(true_m - surface.depth_m(rays_of(sensor))) < 1e-3
    mask = as_seen(where, real, sensor) & on_plane
    return table_figures(as_written(shot, sensor), mask, sensor, sensor.post.depth_unit_m)


def walls(sensor: Sensor) -> Iterator[tuple[float, float, float, float]]:
    """Yield distance [m], bias and sigma of disparity [px], and fill rate of walls near it.

    The border and errors above three steps (mismatches) are excluded.
    """
    for distance in WALLS_M:
        errors_px, known = [], []
        for near in AROUND:
            true_px = sensor.focal_baseline_px_m / (near * distance)
            read = as_written(simulate(scenes.wall(near * distance), sensor), sensor)
            inner = read[40:-40, 40:-40]
            error_px = sensor.focal_baseline_px_m / inner[np.isfinite(inner)] - true_px
            errors_px.append(error_px[np.abs(error_px) < 3 / STEPS_PER_PX])
            known.append(float(np.isfinite(inner).mean()))
        sigma = float(np.sqrt(np.mean([errors.var() for errors in errors_px])))
        yield (
            distance,
            float(np.mean([errors.mean() for errors in errors_px])),
            sigma,
            float(np.mean(known)),
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sensor", default="kinect-v1")
    options = parser.parse_args()
    sensor = presets.load(options.sensor)
    print_walls(sensor)
    if not folder().is_dir():
        print(f"no captures at {folder()}; set STARLING_CAPTURES to the folder above it")
        return
    captures = capture.open_set(folder())
    print_steps(captures)
    print_tables(captures, sensor)
    print_offices(captures)


def print_walls(sensor: Sensor) -> None:
    """Print the noise of simulated walls by distance, in disparity and depth."""
    print("wall m   bias px  sigma px  sigma mm   published mm   fill")
    for distance, bias, sigma, fill in walls(sensor):
        sigma_mm = 1e3 * sigma * distance**2 / sensor.focal_baseline_px_m
        print(
            f"{distance:6.2f} {bias:9.3f} {sigma:9.3f} {sigma_mm:9.2f}"
            f" {1e3 * published_m(distance):14.2f} {fill:6.3f}"
        )


def print_steps(captures: capture.CaptureSet) -> None:
    """Print the fitted law of the observed depth values."""
    scale, offset, share = steps(codes := codes_mm(captures))
    print(
        f"depth values {len(codes)}: {share:.1%} are floor({scale:.0f} / (n + {offset:.2f})) mm,"
        f" n whole: f b = {scale / STEPS_PER_PX / 1e3:.3f} px m at 1/{STEPS_PER_PX} px"
    )


def labelled(captures: capture.CaptureSet) -> dict[str, tuple[NDArray, Mask]]:
    """Return depth [m] and table mask of each labelled scene."""
    tables = {}
    for scene in captures.scenes:
        path, read = scene.path / "label.png", scene.frame(0).depth_m
        if path.is_file() and read is not None:
            tables[scene.name] = read, cv2.imread(str(path), cv2.IMREAD_UNCHANGED) == TABLE
    return tables


def print_tables(captures: capture.CaptureSet, sensor: Sensor) -> None:
    """Print figures of real tables, simulated ones, and simulated ones with the projector's yaw."""
    camera, tables = captures.info, labelled(captures)
    learn = [value for name, value in tables.items() if name.startswith("learn")]
    yaw = yaw_deg(learn, camera)
    light = dataclasses.replace(sensor.projector, rotation_deg=(0.0, yaw, 0.0))
    turned = dataclasses.replace(sensor, projector=light)
    print(f"projector turned by {yaw:.3f} deg yaw (from learn*)")
    columns: dict[str, list[TableFigures]] = {"real": [], "preset": [], "turned": []}
    names = [field.name for field in dataclasses.fields(TableFigures)]
    print(f"{'table':10s}{'':8s}" + "".join(f"{name:>12s}" for name in names))
    held_out = [i for i, name in enumerate(tables) if name.startswith("test")]
    for name, (read, where) in tables.items():
        rays = rays_of(camera)
        known = where & np.isfinite(read)
        surface = plane((rays * read[..., None])[known].astype(np.float64))
        columns["real"].append(table_figures(read, where, camera, captures.info.depth_unit_m))
        columns["preset"].append(simulated_table(surface, where, camera, sensor))
        columns["turned"].append(simulated_table(surface, where, camera, turned))
        for column, rows in columns.items():
            print(f"{name:10s}{column:8s}" + _row([getattr(rows[-1], n) for n in names]))
    for title, chosen in (("test*", held_out), ("all", range(len(tables)))):
        for column, rows in columns.items():
            medians = [float(np.median([getattr(rows[i], n) for i in chosen])) for n in names]
            print(f"{title:10s}{column:8s}" + _row(medians))


def print_offices(captures: capture.CaptureSet) -> None:
    """Print the noise in flat tiles of frames of whole rooms, by distance."""
    near_far: dict[float, list[float]] = {distance: [] for distance in WALLS_M}
    for scene in captures.scenes:
        read = scene.frame(0).depth_m
        if read is None or not scene.name.startswith("capture"):
            continue
        for distance, sigma in tiles(read, np.isfinite(read)):
            nearest = min(WALLS_M, key=lambda wall: abs(np.log(wall / distance)))
            near_far[nearest].append(sigma)
    print("capture*, near m   tiles   sigma px: quarter, median   sigma mm   published mm")
    for distance, sigmas in near_far.items():
        if len(sigmas) > 10:
            print(
                f"{distance:16.2f} {len(sigmas):7d} {np.quantile(sigmas, 0.25):12.3f}"
                f" {np.median(sigmas):8.3f}"
                f" {1e3 * np.median(sigmas) * distance**2 / FOCAL_BASELINE:20.2f}"
                f" {1e3 * published_m(distance):14.2f}"
            )


def _row(values: list[float]) -> str:
    return "".join(
        f"{value:12d}" if isinstance(value, int) else f"{value:12.3f}" for value in values
    )


if __name__ == "__main__":
    main()
