"""Command-line flags that several verbs share."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import OmitArgPrefixes, UseAppendAction, arg

LookAt = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, kw_only=True, slots=True)
class Common:
    """Flags of every verb."""

    json: bool = False
    """Print the result as JSON."""
    debug: bool = False
    """Show the traceback if the command fails."""


Shared = OmitArgPrefixes[Common]


@dataclass(frozen=True, kw_only=True, slots=True)
class ViewFlags:
    """Where the camera stands, how a mesh file lies in the world, and how a robot stands."""

    pose: Path | None = None
    """File of camera poses in the frame of the scene's file, in OpenCV's axes: 4 x 4
    world-from-camera matrices [m] as text, .npy or .toml, or a trajectory in TUM format. Each of
    several poses becomes a scene of the set."""
    look_at: Annotated[LookAt | None, arg(metavar="EX EY EZ TX TY TZ")] = None
    """Position of the camera and the point in its centre [m], in place of --pose."""
    up: Literal["x", "y", "z"] | None = None
    """Axis of a mesh file that points up. By default as the file says; y without a word."""
    unit: Literal["m", "cm", "mm", "in"] | None = None
    """Unit of a mesh file. By default as the file says; metres without a word."""
    camera: str | None = None
    """Camera of a MuJoCo model that becomes the left imager."""
    keyframe: str | None = None
    """Keyframe of a MuJoCo model. By default its reference state."""
    qpos: Path | None = None
    """File of generalized positions of a MuJoCo model, .npy or text, in place of a keyframe."""

    def given(self) -> dict[str, object]:
        """Flags that are given, to record."""
        values = {item.name: getattr(self, item.name) for item in dataclasses.fields(self)}
        return {
            name: str(value) if isinstance(value, Path) else value
            for name, value in values.items()
            if value is not None
        }


Views = OmitArgPrefixes[ViewFlags]
REPEATED = ("--set", "--effect")  # Flags that may be given several times.
Edits = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(
        name="set",
        metavar="PATH=VALUE",
        help="Set one field of the sensor, e.g. projector.power_w=0.2. `imager.` sets both "
        "imagers. May be repeated.",
    ),
]
ModeName = Annotated[
    str,
    arg(
        metavar="WxH[@FPS]",
        help="Mode of the camera, e.g. 640x480 or 640x480@60; `starling sensors show NAME` lists "
        "them. By default the sensor's own.",
    ),
]
DevicePreset = Annotated[
    str | None,
    arg(
        metavar="NAME|FILE.json",
        help="Apply a RealSense visual preset (default, high_accuracy, high_density, "
        "medium_density, hand), or the controls in a JSON file exported by the RealSense Viewer.",
    ),
]
Effects = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(
        name="effect",
        metavar="NAME[.PARAM]=VALUE",
        help="Set one effect (see `starling effects`), e.g. lens_blur=0.8. May be repeated.",
    ),
]
CameraMatrix = Annotated[
    tuple[float, float, float, float] | Path | None,
    arg(
        metavar="FX FY CX CY|FILE",
        help="Camera of depth images [px]; pixel centres have whole coordinates. For other scenes, "
        "a FILE gives the camera of the sensor. FILE is the output of rs-enumerate-devices -c, a "
        "ROS camera_info, or a board or calibration file of depthai.",
    ),
]
