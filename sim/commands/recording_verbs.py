"""Command-line verb for recordings: import."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from starling.sim.console import shell
from starling.sim.console.flags import Common, Shared

_Stream = Annotated[str, arg(metavar="PATTERN|TOPIC")]


def import_(
    source: Positional[Path],
    *,
    out: Path,
    left: _Stream = "",
    right: _Stream = "",
    depth: _Stream = "",
    truth: _Stream = "",
    colour: _Stream = "",
    left_off: _Stream = "",
    right_off: _Stream = "",
    calibration: tuple[Path, ...] = (),
    camera: str = "",
    baseline: float | None = None,
    depth_unit: str = "",
    emitter: Literal["on", "off"] | None = None,
    sensor: str = "",
    black_level: float | None = None,
    rectify: bool = False,
    moving: bool = False,
    every: int = 1,
    most_frames: int = 0,
    scene: str = "",
    licence: str = "not stated",
    force: bool = False,
    common: Shared = Common(),
) -> None:
    """Import a recording of a depth camera as a capture set, and say what was seen in it.

    Example: starling import desk.bag --out out/desk

    Args:
        source: RealSense Viewer .bag, ROS 1 or 2 bag, MCAP file, TUM sequence, or folder of images.
        out: Folder to create: a capture set for `match`, `calibrate`, `diagnose` and `show`.
        left: Left infrared images: pattern of files in a folder, or topic of a bag.
            Without it, usual names are looked for, here and below.
        right: Right infrared images.
        depth: Depth images of the device, in the left view.
        truth: Reference depth, in the left view: one image, or one for each frame.
        colour: Colour images.
        left_off: Left infrared images with the projector off.
        right_off: Right infrared images with the projector off.
        calibration: Calibration, where the source has none: librealsense text, ROS camera_info,
            depthai JSON. Two camera_info files are those of left and right.
        camera: Intrinsics of a TUM sequence, "fx fy cx cy width height" [px].
        baseline: Distance of the imagers [m].
        depth_unit: Unit of depth values: m, mm, or their step [m].
        emitter: Whether the projector was on.
        sensor: Name of the camera: a preset (see `starling sensors`) or any name.
        black_level: Pedestal of the infrared images [codes]: about 4 of 255 for a D400.
        rectify: Rectify the pair by the calibration's distortion.
        moving: The camera or scene moves: each frame becomes a scene.
            By default all frames are repeats of one static scene.
        every: Use one frame out of this many.
        most_frames: Largest number of frames; 0 takes all.
        scene: Name of the scene, and of its room. By default that of the source.
        licence: Licence of the recording, for capture.toml.
        force: Replace a folder that starling wrote earlier.
    """
    from starling.sim.captures.recordings import import_recording as importing
    from starling.sim.captures.recordings.statement import GivenFacts
    from starling.sim.console import progress

    streams = {
        **{"left": left, "right": right, "depth": depth, "truth": truth, "colour": colour},
        **{"left_off": left_off, "right_off": right_off},
    }
    flags = GivenFacts(
        calibration=calibration,
        baseline_m=baseline,
        depth_unit=depth_unit,
        emitter=emitter,
        sensor=sensor,
        black_level_dn=black_level,
        rectify=rectify,
    )
    choice = importing.FrameChoice(
        moving=moving, every=every, most=most_frames, scene=scene, licence=licence
    )
    with progress.on_stderr() as track:
        result = importing.import_recording(
            source,
            out,
            streams={name: value for name, value in streams.items() if value},
            flags=flags,
            camera=camera,
            choice=choice,
            force=force,
            track=track,
        )
    shell.say(result, json=common.json)
