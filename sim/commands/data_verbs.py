"""Command-line verbs for data sets: generate, verify, show, export, fuse."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

from starling.patterns.errors import refuse
from starling.sim.console import shell
from starling.sim.console.flags import Common, ModeName, Shared


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
    """Generate a data set of many captures from a plan. An interrupted run can be resumed.

    Example: starling generate plan.toml --out out/set --layout shards

    Args:
        plan: TOML file: scenes, sensors with ranges, poses, frames and seed (see the tutorial).
        out: Folder of the data set: a new one, or one that the same plan started.
        workers: Worker processes. 0 uses one per core.
        ray: Address of a Ray cluster (HOST:PORT, or local) that replaces the worker processes.
        layout: `folders` writes one folder per view.
            `shards` writes tar archives in the WebDataset layout.
        shard_frames: Frames per archive, and frames that a worker generates per task.
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
    """Check a data set: verify every checksum, and regenerate a random sample of views.

    Every damage is listed. The exit code is 1 if there is any.

    Example: starling verify out/set --sample 20

    Args:
        captures: Folder of a finished data set.
        sample: Number of randomly chosen views to regenerate. 0 regenerates none.
    """
    import sys

    from starling.sim.console import progress
    from starling.sim.datasets import verify as verification

    with progress.on_stderr() as track:
        result = verification.verify(captures, sample=sample, track=track)
    shell.say(result, json=common.json)
    if result["findings"] or result["missing"] or result["duplicate"] or result["differing"]:
        sys.exit(1)


def show(
    captures: Positional[str],
    against: Positional[str] = "",
    *,
    out: Path | None = None,
    rerun: Path | None = None,
    frame: int | None = None,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Draw captures: infrared, depth, reasons for missing depth, error against the reference.

    Example: starling show out/check out/check-simulated --out out/check.png

    Args:
        captures: Capture set, or one scene of it.
        against: Second capture set, or one scene of it, drawn next to the first.
        out: NAME.png for one scene, or a folder for several.
        rerun: NAME.rrd for the Rerun viewer, in place of pictures: all frames, with cameras and
            points.
        frame: Number of the frame to draw. By default 0.
        force: Replace pictures that starling wrote earlier.
    """
    from starling.sim.console import progress

    named = ", ".join(name for name, path in (("out", out), ("rerun", rerun)) if path is not None)
    if named not in ("out", "rerun"):
        rule = "must be given, one of the two"
        raise refuse("out, rerun", rule, named or "none", "Pictures, or a recording.")
    if rerun is not None and (against or frame is not None):
        got = f"against {against!r}, frame {frame}"
        advice = "A recording has all frames of one set."
        raise refuse("against, frame", "must not be given with rerun", got, advice)
    with progress.on_stderr() as track:
        if rerun is not None:
            from starling.sim.commands import rerun_recording

            result = rerun_recording.write(captures, rerun, force=force, track=track)
        else:
            from starling.sim.commands import show_captures

            assert out is not None  # One of the two is given.
            result = show_captures.show_captures(
                captures, out, against=against or None, frame=frame or 0, force=force, track=track
            )
    shell.say(result, json=common.json)


def export(
    captures: Positional[str],
    *,
    layout: Literal["tum", "bop", "ros2", "lerobot", "ply", "pcd"],
    out: Path,
    meshes: Path = Path("."),
    storage: Literal["sqlite3", "mcap"] = "sqlite3",
    task: str = "",
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Convert captures to the layout of TUM RGB-D, BOP, ROS 2, LeRobot, or point clouds.

    Example: starling export out/set --layout bop --meshes meshes --out out/bop

    Args:
        captures: Capture set, or one scene of it.
        layout: `tum` writes time-stamped depth, infrared and a trajectory.
            `bop` writes images, masks and poses of the dropped objects.
            `ros2` writes a bag in OUT/bag, with the topics of realsense-ros.
            `lerobot` writes a data set of format v3.0, with an episode for each room.
            `ply` and `pcd` write the points of every frame, with colours.
        out: Folder to create.
        meshes: Folder with the meshes of the objects (`bop` only).
        storage: Kind of file in the bag (`ros2` only).
        task: Task of all frames (`lerobot` only). By default the name of the room.
        force: Replace a folder that starling wrote earlier.
    """
    from starling.sim.captures.exchange import export as exporting

    result = exporting.export(
        captures, layout, out, meshes=meshes, storage=storage, task=task, force=force
    )
    shell.say(result, json=common.json)


def fuse(
    streams: Positional[tuple[Path, ...]],
    *,
    layout: Literal["tum", "labelfusion"],
    out: Path,
    camera: str = "",
    sensor: str = "kinect-v1",
    mode: ModeName = "",
    voxel: float = 0.005,
    band: float | None = None,
    far: float = 3.0,
    every: int = 1,
    least: int = 2,
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Fuse RGB-D streams into surfaces, and render reference depth for each frame from them.

    Example: starling fuse log1 log2 --layout labelfusion --camera "528 528 320 240 640 480"
    --out out/fused

    Args:
        streams: Folders of the streams. Each shows one static room; all are of one camera.
        layout: `tum` reads the layout of the TUM RGB-D benchmark, `labelfusion` a LabelFusion log.
        out: Folder to create: a capture set for `starling train` and `starling evaluate`.
        camera: Intrinsics of the depth images, "fx fy cx cy width height" [px].
            By default they are read from the streams.
        sensor: Preset of the device. It supplies the name and the baseline.
        voxel: Edge length of a voxel [m].
        band: Truncation distance of the signed distance field [m], larger than the depth noise.
            By default 30 mm or four voxels, whichever is larger.
        far: Depth beyond this distance is not fused [m].
        every: Use one frame out of this many.
        least: Frames that must observe a voxel.
            Higher values remove more false surface, and more true surface.
        force: Replace a folder that starling wrote earlier.
    """
    from starling.sim.captures.fusion.fuse import fuse as fusing
    from starling.sim.captures.fusion.volume import Fusion
    from starling.sim.console import progress

    with progress.on_stderr() as track:
        result = fusing(
            streams,
            out,
            layout=layout,
            camera=camera,
            sensor=sensor,
            mode=mode,
            fusion=Fusion(voxel_m=voxel, band_m=band, far_m=far, every=every, least=least),
            force=force,
            track=track,
        )
    shell.say(result, json=common.json)
