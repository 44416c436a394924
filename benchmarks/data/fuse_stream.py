"""How well a surface fused of a stream stands for the true one, on a stream that is simulated.

    python benchmarks/data/fuse_stream.py [--views 60] [--voxels 0.005 0.0025] [--pictures out/fused]

A D435 goes round a table with things on it, 640x360, and looks at it. Its frames are fused thrice:
with their true depth, with that where the simulated D435 has depth, and with what it tells. What is
printed compares the fused surface, seen from each pose, with the true depth there (up to `far`):

    median, sigma, p95   of reference - truth [mm]; sigma by the median absolute deviation
    complete             share of true surface that has reference depth
    missed               share of the device's holes before true surface that have no reference
    false                share of the holes that have reference whose reference is not the true
                         surface (nothing there, or more than 15 mm off)
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
from starling.sim.captures.exchange.stream import Moment, Stream
from starling.sim.captures.fusion import reference, trajectory
from starling.sim.captures.fusion.fused import Fusion, fused
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.render.mitsuba_scene import Stage
from starling.sim.scene import sources
from starling.sim.sensor import resolve

SIZE = ("width=640", "height=360", "fx_px=320", "fy_px=320", "cx_px=319.5", "cy_px=179.5")
MIDDLE_M = (0.0, 0.25, 1.05)  # Of the things on the table.
OFF_M = 0.015
Image = NDArray[np.float32]


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Seen:
    """What was true and what the device told at one pose, (h, w) [m]."""

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
    asked = parser.parse_args()
    sensor = resolve.load("d435", edits=SIZE)
    stage = Stage(sources.load(asked.scene, sensor))
    seen = []
    for number, pose in enumerate(poses(asked.views)):
        at = stage.of(dataclasses.replace(stage.scene, world_from_left=pose))
        shot = simulate.simulate(at, sensor, seed=number)
        truth_m = shot.layers.truth.depth_m
        seen.append(Seen(world_from_camera=pose, truth_m=truth_m, device_m=shot.depth.depth_m))
    print("                      median  sigma    p95  complete  missed  false  triangles  seconds")
    true = [near(one, asked.far) for one in seen]
    print(f"{'device, as it is':20}{errors([one.device_m for one in seen], seen, true)}")
    for kind in ("clean", "holes", "device"):
        for voxel_m in asked.voxels:
            fusion = Fusion(voxel_m=voxel_m, far_m=asked.far, least=asked.least)
            row(kind, seen, Pinhole.of(sensor), fusion, asked.pictures)


def near(one: Seen, far_m: float) -> NDArray[np.bool_]:
    """Pixels that show something no farther off."""
    return np.isfinite(one.truth_m) & (one.truth_m <= far_m)


def poses(count: int) -> Iterator[frames.Pose]:
    """Poses on an arc of 140 degrees, up and down, that look at the table's middle."""
    for share in np.linspace(0, 1, count):
        turn = np.deg2rad(140) * (share - 0.5)
        up_m, radius_m = 0.45 + 0.2 * np.sin(6 * np.pi * share), 0.85
        away = (radius_m * np.sin(turn), -up_m, -radius_m * np.cos(turn))
        yield frames.look_at(tuple(np.add(MIDDLE_M, away)), MIDDLE_M, (0.0, -1.0, 0.0))


def row(
    kind: str, seen: list[Seen], camera: Pinhole, fusion: Fusion, pictures: Path | None
) -> None:
    """Fuse one kind of depth with one voxel and print its figures."""
    begun = time.perf_counter()
    depths = [given(kind, one) for one in seen]
    moments = tuple(
        Moment(
            time_s=number / 30,
            world_from_camera=one.world_from_camera,
            depth=lambda depth_m=depth_m: depth_m,
            image=None,
        )
        for number, (one, depth_m) in enumerate(zip(seen, depths, strict=True))
    )
    stream = Stream(camera=camera, moments=moments)
    mesh = fused(trajectory.posed(stream), camera, fusion)
    references = list(reference.depths(mesh, camera, [one.world_from_camera for one in seen]))
    taken_s = time.perf_counter() - begun
    true = [near(one, fusion.far_m) for one in seen]
    missed, false = [], []
    for one, surface, depth_m, fused_m in zip(seen, true, depths, references, strict=True):
        known, hole = np.isfinite(fused_m), np.isnan(depth_m)
        right = np.abs(fused_m - one.truth_m) <= OFF_M
        missed.append(~known[surface & hole])
        false.append(~right[known & hole])
    print(
        f"{f'{kind}, {1e3 * fusion.voxel_m:g} mm':20}{errors(references, seen, true)}"
        f"{share(missed):8.3f}{share(false):7.3f}{len(mesh.faces):11d}{taken_s:9.1f}",
        flush=True,
    )
    if pictures is not None:
        name = f"{kind}-{1e3 * fusion.voxel_m:g}.png"
        picture(pictures / name, seen, depths, references, fusion.far_m)


def given(kind: str, one: Seen) -> Image:
    """The depth that is fused."""
    if kind == "holes":
        return np.where(np.isnan(one.device_m), np.float32(np.nan), one.truth_m)
    return one.truth_m if kind == "clean" else one.device_m


def errors(depths: list[Image], seen: list[Seen], true: list[NDArray[np.bool_]]) -> str:
    """Columns of median, sigma and 95th percentile [mm], and of the share that is there."""
    both = list(zip(depths, seen, true, strict=True))
    off = 1e3 * np.concatenate([(one - at.truth_m)[where] for one, at, where in both])
    off = off[np.isfinite(off)]
    middle = np.median(off)
    sigma = 1.4826 * np.median(np.abs(off - middle))
    complete = share([np.isfinite(one)[where] for one, _, where in both])
    return f"{middle:8.3f}{sigma:7.3f}{np.percentile(np.abs(off), 95):7.2f}{complete:10.4f}"


def share(masks: list[NDArray[np.bool_]]) -> float:
    """Share of all that is true, NaN of nothing."""
    together = np.concatenate(masks)
    return float(together.mean()) if len(together) else float("nan")


def picture(
    path: Path, seen: list[Seen], depths: list[Image], references: list[Image], far_m: float
) -> None:
    """True, given and fused depth, and the fused one's error up to +-10 mm, for three views."""
    rows = []
    for number in np.linspace(0, len(seen) - 1, 3).astype(int):
        truth_m, fused_m = seen[number].truth_m, references[number]
        panels = [coloured(one / far_m) for one in (truth_m, depths[number], fused_m)]
        rows.append(np.hstack([*panels, coloured((fused_m - truth_m) / 0.02 + 0.5)]))
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.vstack(rows))


def coloured(level: NDArray[np.floating]) -> NDArray[np.uint8]:
    """0..1 as colours, black where there is none."""
    codes = (255 * np.nan_to_num(np.clip(level, 0, 1))).astype(np.uint8)
    image = cv2.applyColorMap(codes, cv2.COLORMAP_TURBO)
    image[np.isnan(level)] = 0
    return image.astype(np.uint8)


if __name__ == "__main__":
    main()
