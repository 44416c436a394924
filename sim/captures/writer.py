"""Writing of capture sets, in the layout that `starling.sim.captures.capture` reads."""

from __future__ import annotations

import dataclasses
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

_versions = functools.cache(record.versions)  # It takes milliseconds and is needed per frame.


def info_of(sensor: Sensor, *, source: str, licence: str, notes: str) -> CaptureInfo:
    """Describe a sensor for the `capture.toml` of its capture set."""
    return CaptureInfo(
        sensor=sensor.name,
        **dataclasses.asdict(Pinhole.from_camera(sensor)),
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
    """Return the colour camera's intrinsics and pose; empty without a colour camera."""
    if sensor.colour is None:
        return {}
    pose = frames.pose(sensor.colour.position_m, sensor.colour.rotation_deg)
    rows = tuple(tuple(map(float, row)) for row in np.linalg.inv(pose))
    return {"colour": Pinhole.from_camera(sensor.colour), "colour_from_left": rows}


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
    """Write the files of the set as a whole: device, sensor and record.

    Args:
        folder: output folder.
        info: written to `capture.toml`.
        sensor: written to `sensor.toml`, as it was used.
        verb: the command that writes the set.
        arguments: the command's arguments, including the seed.
        figures: figures that the command measured.
        renderer: renderer (see `starling.sim.render.backend.renderer`); None without rendering.
    """
    folder.write(capture_info.FILE, capture_info.dumps(info))
    folder.write("sensor.toml", presets.dumps(sensor))
    folder.write(RECORD, record.of_run(verb, arguments, figures, renderer))


def write_scene(
    folder: Folder,
    scene: str,
    *,
    room: str,
    truth_m: NDArray[np.float32] | None,
    depth_unit_m: float,
    known: SceneFile | None = None,
) -> None:
    """Write the files of a scene: room, reference depth and known geometry.

    Args:
        folder: output folder.
        scene: name of the scene's folder.
        room: name of the room; scenes of one room share it.
        truth_m: reference depth z (h, w) [m], NaN = none; written to `truth.png` as 16-bit code.
        depth_unit_m: step of the code [m].
        known: known geometry, written to `scene.toml`.
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
    """Write one frame: depth, and optionally infrared pair, colour, layers and further facts.

    Args:
        folder: output folder.
        scene: name of the scene's folder.
        number: number of the frame.
        depth: written to `depth.png` as 16-bit code; counts of reasons go to `frame.json`.
        depth_unit_m: step of the code [m].
        infrared: left and right image (h, w); right is None with structured light.
        registered_m: depth in the colour camera's image, written to `depth_colour.png` as code.
        colour: (h, w, 3) red, green, blue, written to `rgb.png`.
        reasons: write every pixel's code of `starling.sim.reason` to `reason.png`.
        layers: written to `frame.exr`, together with `depth`.
        facts: further keys of `frame.json`: exposure_s, gain, seed ...
    """
    place = f"{scene}/{number}"
    if infrared is not None:
        folder.write(f"{place}/ir_left.png", png.encode(infrared[0]))
        if infrared[1] is not None:
            folder.write(f"{place}/ir_right.png", png.encode(infrared[1]))
    folder.write(f"{place}/depth.png", png.encode(to_code(depth.depth_m, depth_unit_m)))
    if registered_m is not None:
        folder.write(f"{place}/depth_colour.png", png.encode(to_code(registered_m, depth_unit_m)))
    if colour is not None:
        folder.write(f"{place}/rgb.png", png.encode_colour(colour))
    if reasons:
        folder.write(f"{place}/reason.png", png.encode(depth.reason.astype(np.uint8)))
    if layers is not None:
        folder.write_by(f"{place}/frame.exr", lambda path: exr.write(path, layers, depth))
    folder.write(
        f"{place}/frame.json",
        record.dumps({**(facts or {}), "reasons": reason_counts(depth), "versions": _versions()}),
    )


def reason_counts(depth: DepthMap) -> dict[str, int]:
    """Count the pixels of each reason that occurs: `{"valid": 901222, "occluded": 8020}`."""
    codes, counts = np.unique(depth.reason, return_counts=True)
    return {
        Reason(code).name.lower(): int(count) for code, count in zip(codes, counts, strict=True)
    }
