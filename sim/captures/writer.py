"""Writing capture sets, in the one shape that `starling.sim.captures.capture` reads."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.captures import exr, png
from starling.sim.captures import info as capture_info
from starling.sim.captures.info import CaptureInfo
from starling.sim.captures.png import GreyImage
from starling.sim.console import record
from starling.sim.console.output import RECORD, Folder
from starling.sim.geometry import frames
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.reason import Reason
from starling.sim.render.layers import Layers
from starling.sim.scene import scene_file
from starling.sim.scene.scene_file import SceneFile
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import DepthMap, to_code

_versions = functools.cache(record.versions)  # Milliseconds, and frames are many.


def info_of(sensor: Sensor, *, source: str, licence: str, notes: str) -> CaptureInfo:
    """Describe what a sensor will write as a capture set's `capture.toml`."""
    return CaptureInfo(
        sensor=sensor.name,
        width=sensor.width,
        height=sensor.height,
        fx_px=sensor.fx_px,
        fy_px=sensor.fy_px,
        cx_px=sensor.cx_px,
        cy_px=sensor.cy_px,
        baseline_m=sensor.baseline_m,
        depth_unit_m=sensor.post.depth_unit_m,
        source=source,
        licence=licence,
        notes=notes,
        projector="on" if sensor.projector.power_w > 0 else "off",
        black_level_dn=sensor.left.black_level_dn,
        **_colour(sensor),
    )


def _colour(sensor: Sensor) -> dict[str, Any]:
    """The colour camera's intrinsics and place, where there is one."""
    if sensor.colour is None:
        return {}
    pose = frames.pose(sensor.colour.position_m, sensor.colour.rotation_deg)
    rows = tuple(tuple(map(float, row)) for row in np.linalg.inv(pose))
    return {
        "colour": Pinhole.of(sensor.colour),
        "colour_from_left": rows,
    }


def write_set(
    folder: Folder,
    info: CaptureInfo,
    sensor: Sensor,
    *,
    verb: str,
    arguments: Mapping[str, Any],
    figures: Mapping[str, Any],
    renderer: Mapping[str, Any] | None = None,
) -> None:
    """Write what belongs to the set as a whole: device, sensor and how it was made.

    Args:
        folder: where to.
        info: goes to `capture.toml`.
        sensor: goes to `sensor.toml`, as it was used.
        verb: the command that made the set.
        arguments: the command's arguments, the seed among them.
        figures: what the verb measured.
        renderer: what rendered (see `starling.sim.render.backend.renderer`), where something was rendered.
    """
    folder.write(capture_info.FILE, capture_info.dumps(info))
    folder.write("sensor.toml", presets.dumps(sensor))
    folder.write(
        RECORD,
        record.dumps(
            {
                "verb": verb,
                "arguments": arguments,
                "versions": record.versions(),
                **({"renderer": renderer} if renderer else {}),
                "figures": figures,
            }
        ),
    )


def write_scene(
    folder: Folder,
    scene: str,
    *,
    room: str,
    truth_m: NDArray[np.float32] | None,
    depth_unit_m: float,
    known: SceneFile | None = None,
) -> None:
    """Write what belongs to a scene: its room, its reference depth and its known geometry.

    Args:
        folder: where to.
        scene: the scene's folder.
        room: scenes of one room share it.
        truth_m: reference depth z (h, w) [m], NaN = none; goes to `truth.png` as 16-bit code.
        depth_unit_m: step of the code [m].
        known: goes to `scene.toml`.
    """
    folder.write(f"{scene}/room", room + "\n")
    if known is not None:
        folder.write(f"{scene}/{scene_file.FILE}", scene_file.dumps(known))
    if truth_m is not None:
        folder.write(f"{scene}/truth.png", png.encode(to_code(truth_m, depth_unit_m)))


def write_frame(
    folder: Folder,
    scene: str,
    number: int,
    *,
    depth: DepthMap,
    depth_unit_m: float,
    infrared: tuple[GreyImage, GreyImage | None] | None = None,
    registered_m: NDArray[np.float32] | None = None,
    colour: NDArray[np.uint8] | None = None,
    reasons: bool = False,
    layers: Layers | None = None,
    facts: Mapping[str, Any] | None = None,
) -> None:
    """Write one frame: depth, and where given the infrared pair, the layers and the facts.

    Args:
        folder: where to.
        scene: the scene's folder.
        number: the frame's.
        depth: goes to `depth.png` as 16-bit code, its reasons to `frame.json` as counts.
        depth_unit_m: step of the code [m].
        infrared: left and right, (h, w); no right one with structured light.
        registered_m: depth in the colour camera's image, goes to `depth_colour.png` as code.
        colour: (h, w, 3) red, green, blue, goes to `rgb.png`.
        reasons: of every pixel, go to `reason.png` as codes of `starling.sim.reason`.
        layers: with `depth` go to `frame.exr`.
        facts: more keys of `frame.json`: exposure_s, gain, seed ...
    """
    at = f"{scene}/{number}"
    if infrared is not None:
        folder.write(f"{at}/ir_left.png", png.encode(infrared[0]))
        if infrared[1] is not None:
            folder.write(f"{at}/ir_right.png", png.encode(infrared[1]))
    folder.write(f"{at}/depth.png", png.encode(to_code(depth.depth_m, depth_unit_m)))
    if registered_m is not None:
        folder.write(f"{at}/depth_colour.png", png.encode(to_code(registered_m, depth_unit_m)))
    if colour is not None:
        folder.write(f"{at}/rgb.png", png.encode_colour(colour))
    if reasons:
        folder.write(f"{at}/reason.png", png.encode(depth.reason.astype(np.uint8)))
    if layers is not None:
        folder.write_by(f"{at}/frame.exr", lambda path: exr.write(path, layers, depth))
    folder.write(
        f"{at}/frame.json",
        record.dumps({**(facts or {}), "reasons": reason_counts(depth), "versions": _versions()}),
    )


def reason_counts(depth: DepthMap) -> dict[str, int]:
    """Count the pixels of each reason that occurs: `{"valid": 901222, "occluded": 8020}`."""
    codes, counts = np.unique(depth.reason, return_counts=True)
    return {
        Reason(code).name.lower(): int(count) for code, count in zip(codes, counts, strict=True)
    }
