"""Accuracy of a surface fused from a simulated stream.

    python benchmarks/data/fuse_stream.py [--views 60] [--voxels 0.005 0.0025] [--pictures
    out/fused]

A D435 at 640x360 moves around a table with objects. Its frames are fused three times: with true
depth, with true depth where the simulated D435 has depth, and with the simulated depth. The fused
surface is compared with the true depth in the view of each pose (up to `far`):

    median, sigma, p95   of reference - truth [mm]; sigma by the median absolute deviation
    complete             share of true surface that has reference depth
    missed               share of the device's holes on true surface without reference
    false                share of the holes with a wrong reference: no surface there, or an error
                         of more than 15 mm
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.sim import simulate
from starling.sim.captures.exchange.stream import Moment, Stream, posed_frames
from starling.sim.captures.fusion import pairs
from starling.sim.captures.fusion.volume import Fusion, fuse_frames
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene import sources
from starling.sim.sensor import resolve

SIZE = ("width=640", "height=360", "fx_px=320", "fy_px=320", "cx_px=319.5", "cy_px=179.5")
MIDDLE_M = (0.0, 0.25, 1.05)  # Centre of the objects on the table [m].
OFF_M = 0.015  # Greatest error of a correct reference [m].
Image = NDArray[np.float32]


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FusedView:
    """True depth and the device's depth at one pose, (h, w) [m]."""

    world_from_camera: frames.Pose
    truth_m: Image
    device_m: Image


def main() -> None:
    """Print a row for each kind of depth and voxel."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=60)
    parser.add_argument("--voxels", type=float, nargs="+", default=[5e-3, 2.5e-3])
    parser.add_argument("--far", type=float, default=2.0)
    parser.add_argument("--least", type=int, default=2)
    parser.add_argument("--scene", default="tabletop")
    parser.add_argument("--pictures", type=Path, default=None)
    options = parser.parse_args()
    sensor = resolve.load("d435", edits=SIZE)
    stage = MitsubaScene(sources.load(options.scene, sensor))
    views = []
    for number, pose in enumerate(poses(options.views)):
        posed = stage.with_scene(dataclasses.replace(stage.scene, world_from_left=pose))
        shot = simulate.simulate(posed, sensor, seed=number)
        truth_m = shot.layers.truth.depth_m
        views.append(
            FusedView(world_from_camera=pose, truth_m=truth_m, device_m=shot.depth.depth_m)
        )
    print("                      median  sigma    p95  complete  missed  false  triangles  seconds")
    true = [near(view, options.far) for view in views]
    print(f"{'device, not fused':20}{errors([view.device_m for view in views], views, true)}")
    for kind in ("clean", "holes", "device"):
        for voxel_m in options.voxels:
            fusion = Fusion(voxel_m=voxel_m, far_m=options.far, least=options.least)
            row(kind, views, Pinhole.from_camera(sensor), fusion, options.pictures)


def near(view: FusedView, far_m: float) -> NDArray[np.bool_]:
    """Return the pixels with a surface up to a distance."""
    return np.isfinite(view.truth_m) & (view.truth_m <= far_m)


def poses(count: int) -> Iterator[frames.Pose]:
    """Yield poses on an arc of 140 degrees, moving up and down, that look at the objects."""
    for share in np.linspace(0, 1, count):
        turn = np.deg2rad(140) * (share - 0.5)
        up_m, radius_m = 0.45 + 0.2 * np.sin(6 * np.pi * share), 0.85
        away = (radius_m * np.sin(turn), -up_m, -radius_m * np.cos(turn))
        yield frames.look_at(tuple(np.add(MIDDLE_M, away)), MIDDLE_M, (0.0, -1.0, 0.0))


def row(
    kind: str, views: list[FusedView], camera: Pinhole, fusion: Fusion, pictures: Path | None
) -> None:
    """Fuse one kind of depth with one voxel size and print its figures."""
    start = time.perf_counter()
    depths = [depth_of_kind(kind, view) for view in views]
    moments = tuple(
        Moment(
            time_s=number / 30,
            world_from_camera=view.world_from_camera,
            depth=lambda depth_m=depth_m: depth_m,
            image=None,
        )
        for number, (view, depth_m) in enumerate(zip(views, depths, strict=True))
    )
    stream = Stream(camera=camera, moments=moments)
    mesh = fuse_frames(posed_frames(stream), camera, fusion)
    references = list(
        pairs.reference_depths(mesh, camera, [view.world_from_camera for view in views])
    )
    taken_s = time.perf_counter() - start
    true = [near(view, fusion.far_m) for view in views]
    missed, false = [], []
    for view, surface, depth_m, fused_m in zip(views, true, depths, references, strict=True):
        known, hole = np.isfinite(fused_m), np.isnan(depth_m)
        correct = np.abs(fused_m - view.truth_m) <= OFF_M
        missed.append(~known[surface & hole])
        false.append(~correct[known & hole])
    print(
        f"{f'{kind}, {1e3 * fusion.voxel_m:g} mm':20}{errors(references, views, true)}"
        f"{share(missed):8.3f}{share(false):7.3f}{len(mesh.faces):11d}{taken_s:9.1f}",
        flush=True,
    )
    if pictures is not None:
        name = f"{kind}-{1e3 * fusion.voxel_m:g}.png"
        picture(pictures / name, views, depths, references, fusion.far_m)


def depth_of_kind(kind: str, view: FusedView) -> Image:
    """Return the depth to fuse."""
    if kind == "holes":
        return np.where(np.isnan(view.device_m), np.float32(np.nan), view.truth_m)
    return view.truth_m if kind == "clean" else view.device_m


def errors(depths: list[Image], views: list[FusedView], true: list[NDArray[np.bool_]]) -> str:
    """Format median, sigma and 95th percentile [mm], and the share of complete pixels."""
    both = list(zip(depths, views, true, strict=True))
    error = 1e3 * np.concatenate([(depth_m - view.truth_m)[where] for depth_m, view, where in both])
    error = error[np.isfinite(error)]
    middle = np.median(error)
    sigma = 1.4826 * np.median(np.abs(error - middle))
    complete = share([np.isfinite(depth_m)[where] for depth_m, _, where in both])
    return f"{middle:8.3f}{sigma:7.3f}{np.percentile(np.abs(error), 95):7.2f}{complete:10.4f}"


def share(masks: list[NDArray[np.bool_]]) -> float:
    """Return the share of True, NaN of no values."""
    together = np.concatenate(masks)
    return float(together.mean()) if len(together) else float("nan")


def picture(
    path: Path, views: list[FusedView], depths: list[Image], references: list[Image], far_m: float
) -> None:
    """Draw true, input and fused depth, and the fused error up to +-10 mm, for three views."""
    rows = []
    for number in np.linspace(0, len(views) - 1, 3).astype(int):
        truth_m, fused_m = views[number].truth_m, references[number]
        panels = [coloured(depth_m / far_m) for depth_m in (truth_m, depths[number], fused_m)]
        rows.append(np.hstack([*panels, coloured((fused_m - truth_m) / 0.02 + 0.5)]))
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.vstack(rows))


def coloured(level: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Colour values 0..1; NaN is black."""
    codes = (255 * np.nan_to_num(np.clip(level, 0, 1))).astype(np.uint8)
    image = cv2.applyColorMap(codes, cv2.COLORMAP_TURBO)
    image[np.isnan(level)] = 0
    return image.astype(np.uint8)


if __name__ == "__main__":
    main()
