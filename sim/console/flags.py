"""Command-line flags that several verbs share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, UseAppendAction, arg


@dataclass(frozen=True, kw_only=True, slots=True)
class Common:
    """Flags of every verb."""

    json: bool = False
    """Print the result as JSON."""
    debug: bool = False
    """Show the traceback if the command fails."""


Shared = OmitArgPrefixes[Common]
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
