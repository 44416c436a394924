"""Verbs of data sets (see `starling.sim.commands.verbs`)."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from starling.sim.console import shell
from starling.sim.console.flags import Common, Shared


def generate(
    plan: Positional[Path],
    *,
    out: Path,
    workers: int = 0,
    ray: str = "",
    layout: Literal["folders", "shards"] = "folders",
    shard_frames: int = 64,
    common: Shared = Common(),
) -> None:
    """Make a data set of many captures from a plan; a run that was stopped goes on where it was.

    Example: starling generate plan.toml --out out/set --layout shards

    Args:
        plan: TOML file: scenes, sensors with ranges, poses, frames, seed (see the tutorial).
        out: folder of the set, new or begun by the same plan.
        workers: processes; 0 takes one for each core.
        ray: address of a Ray cluster (HOST:PORT, or local) that makes it instead.
        layout: a folder each view, or tar archives in WebDataset's layout.
        shard_frames: frames of an archive, and of what a worker makes at a time.
    """
    from starling.sim.console import progress
    from starling.sim.datasets import generate as generation

    with progress.on_stderr() as track:
        result = generation.generate(
            plan,
            out,
            workers=workers,
            ray=ray,
            layout=layout,
            shard_frames=shard_frames,
            track=track,
        )
    shell.say(result, json=common.json)


def verify(captures: Positional[Path], *, sample: int = 8, common: Shared = Common()) -> None:
    """Check a data set: every checksum, and whether views made again come out the same.

    Exits with 1 if a frame is missing, there twice, or differs.

    Example: starling verify out/set --sample 20

    Args:
        captures: folder of a finished set.
        sample: views that are made again, by lot.
    """
    import sys

    from starling.sim.console import progress
    from starling.sim.datasets import verify as verification

    with progress.on_stderr() as track:
        result = verification.verify(captures, sample=sample, track=track)
    shell.say(result, json=common.json)
    if result["missing"] or result["duplicate"] or result["differing"]:
        sys.exit(1)


def export(
    captures: Positional[str],
    *,
    layout: Literal["tum", "bop", "ros2"],
    out: Path,
    meshes: Path = Path("."),
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Write captures in another program's layout: TUM's RGB-D benchmark, BOP, or a ROS 2 bag.

    Example: starling export out/set --layout bop --meshes meshes --out out/bop

    Args:
        captures: capture set, or one scene in it.
        layout: tum: depth, infrared and trajectory by time; bop: images, masks and poses of the
            objects that were dropped; ros2: a bag as a RealSense node records it, in OUT/bag.
        out: folder to make.
        meshes: folder that holds the objects' meshes, for bop.
        force: replace a folder that starling wrote before.
    """
    from starling.sim.captures.exchange import export as exporting

    shell.say(exporting.export(captures, layout, out, meshes=meshes, force=force), json=common.json)


def fuse(
    streams: Positional[tuple[Path, ...]],
    *,
    layout: Literal["tum", "labelfusion"],
    out: Path,
    camera: str = "",
    sensor: str = "kinect-v1",
    voxel: float = 0.005,
    band: float | None = None,
    far: float = 3.0,
    every: int = 1,
    least: int = 2,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Fuse RGB-D streams to surfaces; their depth at each pose is the frames' reference depth.

    Example: starling fuse log1 log2 --layout labelfusion --camera "528 528 320 240 640 480"
    --out out/fused

    Args:
        streams: folders, each of one static room; all of one camera.
        layout: tum: TUM's RGB-D benchmark; labelfusion: LabelFusion's logs.
        out: folder of the capture set, which train and evaluate take.
        camera: of the depth images, fx fy cx cy width height [px]; else what the streams tell.
        sensor: the device by its preset, for its baseline.
        voxel: edge of a voxel [m].
        band: distance from a surface at which its field ends [m], wider than the depth's noise;
            30 mm, or four voxels where that is more.
        far: depth beyond this is not fused [m].
        every: take one frame of so many.
        least: frames that must have seen a place; more leave less that is wrong, and less.
        force: replace a folder that starling wrote before.
    """
    from starling.sim.captures.fusion.fuse import fuse as fusing
    from starling.sim.captures.fusion.fused import Fusion
    from starling.sim.console import progress

    with progress.on_stderr() as track:
        result = fusing(
            streams,
            out,
            layout=layout,
            camera=camera,
            sensor=sensor,
            fusion=Fusion(voxel_m=voxel, band_m=band, far_m=far, every=every, least=least),
            force=force,
            track=track,
        )
    shell.say(result, json=common.json)


VERBS = (generate, verify, export, fuse)
