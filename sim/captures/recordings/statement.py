"""What a set needs to know of its camera: stated by the source, or else by flags."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from starling.patterns import errors
from starling.sim import quantities
from starling.sim.captures import depth_file
from starling.sim.captures.recordings import lens_file, oak_calibration
from starling.sim.captures.recordings.recording import ImagerCalibration, Recording
from starling.sim.captures.recordings.rectification import Rectification, rectification
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.sensor import intrinsics, presets


@dataclass(frozen=True, kw_only=True, slots=True)
class GivenFacts:
    """Facts that flags give."""

    calibration: tuple[Path, ...] = ()
    baseline_m: float | None = None
    depth_unit: str = ""  # m, mm, or a step [m].
    emitter: str | None = None  # on or off
    sensor: str = ""
    black_level_dn: float | None = None
    rectify: bool = False


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Geometry:
    """Geometry of the imported pair."""

    camera: Pinhole
    baseline_m: float
    rectification: Rectification | None = None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Calibration:
    camera: Pinhole | None = None
    baseline_m: float | None = None
    lenses: tuple[ImagerCalibration, ImagerCalibration] | None = None
    right_from_left: Pose | None = None


def geometry(recording: Recording, flags: GivenFacts, size: tuple[int, int]) -> Geometry:
    """Return intrinsics and baseline.

    Args:
        recording: the recording.
        flags: facts by flags, which win.
        size: width and height of the images [px].

    Raises:
        InputError: if intrinsics or baseline are unknown, of another image size, or the pair is
            distorted and shall not be rectified.
    """
    read = _calibration(recording, flags, size)
    if flags.rectify:
        if read.lenses is None:
            rule, advice = "must come with distortion of both imagers", "Give --calibration FILE."
            raise errors.refuse("--rectify", rule, "none", advice)
        rectified = rectification(read.lenses, read.right_from_left, size)
        baseline_m = rectified.baseline_m if flags.baseline_m is None else flags.baseline_m
        quantities.check("--baseline", baseline_m, "baseline_m")
        return Geometry(camera=rectified.camera, baseline_m=baseline_m, rectification=rectified)
    if recording.lenses is not None and not flags.calibration:
        lens = next(lens for lens in recording.lenses if lens.is_distorted)
        shown = ", ".join(f"{value:.4g}" for value in lens.distortion)
        rule, advice = "must be rectified", "Add --rectify, or record the rectified images."
        raise errors.refuse("images", rule, f"distortion {shown}", advice)
    if read.camera is None:
        rule, advice = "must be given", "Give --calibration FILE: camera_info, librealsense text."
        raise errors.refuse("intrinsics", rule, f"none in {recording.path}", advice)
    if (read.camera.width, read.camera.height) != size:
        rule = f"must be of images of {size[0]}x{size[1]}"
        got = f"{read.camera.width}x{read.camera.height}"
        raise errors.refuse("intrinsics", rule, got, "Give those of this size: --calibration FILE.")
    baseline_m = read.baseline_m if flags.baseline_m is None else flags.baseline_m
    if baseline_m is None:
        rule, advice = "must be given", f"Give --baseline METRES{_usual(flags, recording)}."
        raise errors.refuse("baseline", rule, f"none in {recording.path}", advice)
    quantities.check("--baseline", baseline_m, "baseline_m")
    return Geometry(camera=read.camera, baseline_m=baseline_m)


def _usual(flags: GivenFacts, recording: Recording) -> str:
    """Return the baseline of the sensor's preset as an example."""
    name = flags.sensor or recording.device or ""
    return f", {presets.load(name).baseline_m:g} as in {name}" if name in presets.names() else ""


def _calibration(recording: Recording, flags: GivenFacts, size: tuple[int, int]) -> _Calibration:
    """Return what calibration files state, or else the recording."""
    paths = list(flags.calibration)
    stated = _Calibration(
        camera=recording.camera,
        baseline_m=recording.baseline_m,
        lenses=recording.lenses,
        right_from_left=recording.right_from_left,
    )
    if not paths:
        return stated
    if len(paths) > 2:
        rule = "must be one file, or those of left and right"
        raise errors.refuse("--calibration", rule, f"{len(paths)} files", "Leave some out.")
    if len(paths) == 2:
        left, right = (lens_file.read(path) for path in paths)
        cameras = [intrinsics.read(path) for path in paths] if not flags.rectify else []
        camera = cameras[0].camera(*size) if cameras else None
        baseline_m = cameras[1].baseline_m if cameras else None
        pose = recording.right_from_left
        return _Calibration(
            camera=camera, baseline_m=baseline_m, lenses=(left, right), right_from_left=pose
        )
    if flags.rectify and oak_calibration.is_calibration(paths[0]):
        lenses, pose = oak_calibration.read(paths[0])
        return _Calibration(lenses=lenses, right_from_left=pose)
    device = intrinsics.read(paths[0])
    baseline_m = device.baseline_m if device.baseline_m is not None else stated.baseline_m
    return dataclasses.replace(stated, camera=device.camera(*size), baseline_m=baseline_m)


def depth_unit_m(recording: Recording, flags: GivenFacts, *, has_depth: bool) -> float:
    """Return the unit of depth values [m].

    Raises:
        InputError: if there is depth of unknown unit, or the given one is implausible.
    """
    if flags.depth_unit:
        unit = depth_file.UNITS.get(flags.depth_unit)
        if unit is not None:
            return unit
        try:
            step = float(flags.depth_unit)
        except ValueError:
            rule, advice = "must be m, mm or a step in metres", "As 0.0001 for a D405."
            raise errors.refuse("--depth-unit", rule, repr(flags.depth_unit), advice) from None
        quantities.check("--depth-unit", step, "depth_unit_m")
        return step
    if recording.depth_unit_m is not None:
        return recording.depth_unit_m
    if has_depth:
        rule = "of the depth values must be given"
        advice = "Give --depth-unit mm, or their step in metres: 0.0001 for a D405."
        raise errors.refuse("unit", rule, f"none in {recording.path}", advice)
    return 1e-3


def emitter(recording: Recording, flags: GivenFacts, dots: str) -> str:
    """Return whether the projector was on: `on`, `off` or `on and off`.

    Args:
        recording: the recording.
        flags: facts by flags.
        dots: whether the images show dots: `yes`, `no`, `unclear`.

    Raises:
        InputError: if neither the source nor a flag states it.
    """
    states = {frame.is_lit for frame in recording.frames} - {None}
    if flags.emitter is not None:
        return flags.emitter
    if not states:
        seen = {"yes": "dots in the images", "no": "no dots in the images"}.get(dots, "none")
        rule = "must be given, as the source does not state it"
        raise errors.refuse("emitter", rule, seen, "Give --emitter on or --emitter off.")
    if len(states) == 2:
        return "on and off"
    return "on" if True in states else "off"


def sensor_name(recording: Recording, flags: GivenFacts) -> str:
    """Return the name of the camera.

    Raises:
        InputError: if it is unknown.
    """
    name = flags.sensor or recording.device
    if not name:
        listed = ", ".join(presets.names())
        rule = "must be given, as the source does not name it"
        raise errors.refuse("sensor", rule, "none", f"Give --sensor NAME: {listed}, or another.")
    return name
