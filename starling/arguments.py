"""Checks of the types of arguments of the public interface."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from starling.patterns import errors
from starling.patterns.errors import instance, plain, refuse, shown

if TYPE_CHECKING:
    from starling.sim.captures.capture import CaptureSet
    from starling.sim.captures.recordings.import_recording import FrameChoice
    from starling.sim.captures.recordings.statement import GivenFacts
    from starling.sim.scene.placing import LookAt, Viewpoint
    from starling.sim.scene.scene import Scene
    from starling.sim.sensor.sensor import Sensor


def text(name: str, value: object, remedy: str) -> str:
    """Return text, or the text of a path.

    Raises:
        InputError: if the value is neither, or holds half of a character, as no file's name does.
    """
    result = os.fspath(instance(name, value, (str, Path), remedy))
    try:
        os.fsencode(result)
    except UnicodeEncodeError:
        raise refuse(name, "must be Unicode text", shown(result), remedy) from None
    return result


def switch(name: str, value: object) -> bool:
    """Return a truth value.

    Raises:
        InputError: if the value has another type.
    """
    return bool(instance(name, plain(value), bool, "Give True or False."))


def path(name: str, value: object) -> Path:
    """Return a path that is given as text or as a path.

    Raises:
        InputError: if the value is neither.
    """
    return Path(text(name, value, "Give a path."))


def scene(value: object, camera: Sensor) -> Scene:
    """Return a scene, or load it by its specifier.

    Raises:
        InputError: if there is no such scene.
    """
    from starling.sim.scene import sources
    from starling.sim.scene.scene import Scene

    if isinstance(value, Scene):
        return value
    return sources.load(text("scene", value, "Give its name, its file or a Scene."), camera)


def viewpoints(pose: object, look_at: Sequence[float] | None) -> list[Viewpoint]:
    """Viewpoints by poses or their file, or by eye and target; the scene's own without both.

    Args:
        pose: path of a file of poses, one matrix (4, 4), or several (n, 4, 4).
        look_at: six numbers.

    Raises:
        InputError: if both are given, or one of them is wrong.
    """
    from starling.sim.scene import pose_file

    target = None if look_at is None else _look_at(look_at)
    if pose is None or isinstance(pose, (str, Path)):
        return pose_file.views(None if pose is None else Path(pose), target)
    if target is not None:
        raise refuse("pose, look_at", "must not both be given", "both", "Leave one out.")
    return pose_file.of_matrices(pose)


def viewpoint(pose: object, look_at: Sequence[float] | None) -> Viewpoint:
    """One viewpoint (errors as `viewpoints`).

    Raises:
        InputError: also if there are several poses.
    """
    views = viewpoints(pose, look_at)
    if len(views) != 1:
        rule, advice = "must be one pose", "Load the scene once for each, or simulate_captures."
        raise refuse("pose", rule, f"{len(views)} poses", advice)
    return views[0]


def _look_at(values: Sequence[float]) -> LookAt:
    numbers = [float(value) for value in errors.numbers("look_at", values).ravel()]
    if len(numbers) != 6:
        advice = "Give eye and target [m]."
        raise refuse("look_at", "must be six numbers", len(numbers), advice)
    ex, ey, ez, tx, ty, tz = numbers
    return ex, ey, ez, tx, ty, tz


def warn_of_size(shape: tuple[int, ...], camera: Sensor) -> None:
    """Warn of an image of another size than the sensor's: its focal length may be another."""
    size = (camera.height, camera.width)
    if shape != size:
        warnings.warn(
            f"ir_left is of size {shape}, and {camera.name} of {size}: depth is right for a crop "
            f"only. Load the sensor with the images' camera_matrix.",
            stacklevel=3,
        )


def plain_text(name: str, value: object) -> str:
    """Return text, which may be empty.

    Raises:
        InputError: if the value has another type.
    """
    return instance(name, value, str, "Give text, or leave it out.")


def streams(patterns: Mapping[str, object]) -> dict[str, str]:
    """Return the file patterns or topics that are given, by stream.

    Raises:
        InputError: if one is no text.
    """
    texts = {name: plain_text(name, value) for name, value in patterns.items()}
    return {name: pattern for name, pattern in texts.items() if pattern}


def facts(
    *,
    calibration: object,
    baseline: float | None,
    depth_unit: object,
    emitter: str | None,
    sensor: object,
    black_level: float | None,
    rectify: object,
) -> GivenFacts:
    """Return the facts of a recording that are given.

    Raises:
        InputError: if one has a wrong type or value.
    """
    from starling.sim.captures.recordings.statement import GivenFacts

    if emitter is not None:
        errors.one_of("emitter", emitter, ("on", "off"))
    if baseline is not None:
        errors.positive("baseline", baseline)
    if black_level is not None:
        errors.in_interval("black_level", black_level, 0, 2**16 - 1)
    files = (calibration,) if isinstance(calibration, (str, Path)) else calibration
    advice = "Give a file, or those of left and right."
    listed = instance("calibration", files, (tuple, list), advice)
    return GivenFacts(
        calibration=tuple(path("calibration", file) for file in listed),
        baseline_m=errors.plain(baseline),
        depth_unit=plain_text("depth_unit", depth_unit),
        emitter=emitter,
        sensor=plain_text("sensor", sensor),
        black_level_dn=errors.plain(black_level),
        rectify=switch("rectify", rectify),
    )


def frame_choice(
    *, moving: object, every: int, most_frames: int, scene: object, licence: object
) -> FrameChoice:
    """Return which frames of a recording are imported.

    Raises:
        InputError: if a value has a wrong type or is outside.
    """
    from starling.sim.captures.recordings.import_recording import FrameChoice

    return FrameChoice(
        moving=switch("moving", moving),
        every=errors.whole_number("every", every, 1, 10**6),
        most=errors.whole_number("most_frames", most_frames, 0, 10**6),
        scene=plain_text("scene", scene),
        licence=plain_text("licence", licence),
    )


def captures(name: str, value: object) -> CaptureSet:
    """Return captures, or open their folder.

    Raises:
        InputError: if the folder is no capture set.
    """
    from starling.sim.captures import capture

    if isinstance(value, capture.CaptureSet):
        return value
    return capture.open_set(path(name, value))
