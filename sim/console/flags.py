"""Flags that several verbs of the command line share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tyro.conf import OmitArgPrefixes, UseAppendAction, arg


@dataclass(frozen=True, kw_only=True, slots=True)
class Common:
    """Flags of every verb."""

    json: bool = False
    """Print the result alone, as JSON."""
    debug: bool = False
    """Show the traceback of a refusal."""


Shared = OmitArgPrefixes[Common]
Edits = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(
        name="set",
        metavar="PATH=VALUE",
        help="Change one field of the sensor, e.g. projector.power_w=0.2; `imager.` means both "
        "imagers. May be repeated.",
    ),
]
DevicePreset = Annotated[
    str | None,
    arg(
        metavar="NAME|FILE.json",
        help="Put a RealSense under a preset of its maker (default, high_accuracy, high_density, "
        "medium_density, hand) or under the controls its viewer exported.",
    ),
]
Effects = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(
        name="effect",
        metavar="NAME[.PARAM]=VALUE",
        help="Set one effect of the table, e.g. lens_blur=0.8. May be repeated.",
    ),
]
