"""Capture sets: infrared pairs, depth and reference depth of real and simulated sensors."""

from __future__ import annotations

import os
import re
import sys
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim import files
from starling.sim.captures import frame_record, png
from starling.sim.captures import info as capture_info
from starling.sim.captures.info import CaptureInfo
from starling.sim.captures.png import GreyImage
from starling.sim.scene import scene_file
from starling.sim.scene.scene_file import SceneFile
from starling.sim.sensor import presets
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo import depth

# Files of a scene: a folder with one of them, but without frames, is refused as incomplete.
_SCENE_FILES = frozenset(
    ("camera.toml", "depth.png", "ir_left.png", "label.png", "room", "scene.toml", "truth.png")
)
_NUMBER = re.compile(r"0|[1-9][0-9]{0,8}")
_NUMBER_LIKE = re.compile(r"[+-]?\d+")  # Folders that the user takes for frames.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Frame:
    """One frame of a sensor; every image is (h, w) in the left infrared view, None if absent."""

    number: int
    ir_left: GreyImage | None = None
    ir_right: GreyImage | None = None  # None for a structured-light sensor.
    ir_left_off: GreyImage | None = None  # Projector off.
    ir_right_off: GreyImage | None = None
    depth_m: NDArray[np.float32] | None = None  # z [m], NaN = no depth.
    record: dict[str, Any] = field(default_factory=dict)  # `frame.json`, {} without the file.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class CapturedScene:
    """One static scene of a set; images are read on demand."""

    name: str
    room: str  # Shared by scenes of one room; without the file `room`, the scene's own name.
    path: Path
    info: CaptureInfo
    frames: tuple[int, ...]  # Numbers of the existing frames, ascending.

    def frame(self, number: int) -> Frame:
        """Read one frame.

        Raises:
            InputError: if the frame does not exist or is empty, or an image is damaged or has a
                wrong type or size.
        """
        name, known = f"frame of {self.name}", f"There are: {', '.join(map(str, self.frames))}."
        number = errors.whole_number(name, number, -sys.maxsize, sys.maxsize, known)
        if number not in self.frames:
            raise errors.refuse(name, "must exist", number, known)
        folder = self.path / str(number)
        images = {
            name: self._image(folder, name)
            for name in ("ir_left", "ir_right", "ir_left_off", "ir_right_off")
        }
        _check_pair(folder, images["ir_left"], images["ir_right"], "ir")
        _check_pair(folder, images["ir_left_off"], images["ir_right_off"], "ir off")
        depth_m = self._depth(folder, "depth")
        if depth_m is None and images["ir_left"] is None:
            raise errors.refuse(
                "frame", "must hold ir_left.png or depth.png", folder, "Is the folder complete?"
            )
        return Frame(number=number, depth_m=depth_m, record=_record(folder), **images)

    def fullest(self) -> Frame:
        """Read the first frame with an infrared pair and depth.

        If there is none, read the first with a pair, then the first with an infrared image, then
        the first.

        Raises:
            InputError: as `frame`.
        """
        for names in (("ir_left", "ir_right", "depth"), ("ir_left", "ir_right"), ("ir_left",)):
            for number in self.frames:
                paths = (self.path / str(number) / f"{name}.png" for name in names)
                if all(_exists(path) for path in paths):
                    return self.frame(number)
        return self.frame(self.frames[0])

    def ir_left(self, number: int) -> GreyImage | None:
        """Read the left infrared image of one frame without its other files; None without it.

        Raises:
            InputError: as `frame`.
        """
        return self._image(self.path / str(number), "ir_left")

    def colour(self, number: int) -> NDArray[np.uint8] | None:
        """Read `rgb.png` of one frame, (h, w, 3) red, green, blue; None without the file.

        Raises:
            InputError: if the file is no colour PNG of 8 bits.
        """
        path = self.path / str(number) / "rgb.png"
        if not _exists(path):
            return None
        return png.decode_colour(files.read_bytes(path), path, "rgb")

    def depth_in_colour_m(self, number: int) -> NDArray[np.float32] | None:
        """Read `depth_colour.png` of one frame: z [m] in the colour image; None without the file.

        Raises:
            InputError: as `frame`.
        """
        path = self.path / str(number) / "depth_colour.png"
        if not _exists(path):
            return None
        code = png.read(path, "depth_colour")
        return depth.from_code(code.astype(np.uint16), self.info.depth_unit_m)

    def record(self, number: int) -> dict[str, Any]:
        """Read `frame.json` of one frame without its images; {} without the file.

        Raises:
            InputError: if the file is no JSON object.
        """
        return _record(self.path / str(number))

    def refuse_other_sensor(self, sensor: Sensor) -> None:
        """Refuse a sensor that cannot have captured this scene: of another kind or image size.

        Raises:
            InputError: if kind or size differ.
        """
        device = self.info.sensor
        kind = presets.load(device).kind if device in presets.names() else sensor.kind
        if _exists(self.path / str(self.frames[0]) / "ir_right.png"):
            kind, holds = "stereo", f"Scene {self.name} holds an infrared pair."
        else:
            holds = f"Scene {self.name} is of a {device}."
        if sensor.kind != kind:
            words = {"stereo": "a stereo camera's", "structured_light": "of structured light"}
            raise errors.refuse("sensor", f"must be {words[kind]}", sensor.kind, holds)
        if (sensor.height, sensor.width) != self.info.shape:
            rule = f"must have images of {self.info.width}x{self.info.height}"
            got = f"{sensor.width}x{sensor.height}"
            raise errors.refuse("sensor", rule, got, f"Scene {self.name} has images of that size.")

    def truth_m(self) -> NDArray[np.float32] | None:
        """Read the reference depth z [m] (h, w), NaN where unknown; None without the file.

        Raises:
            InputError: as `frame`.
        """
        return self._depth(self.path, "truth")

    def label(self) -> GreyImage | None:
        """Read the object number of each pixel (h, w); None without the file.

        Raises:
            InputError: as `frame`.
        """
        return self._image(self.path, "label")

    def known(self) -> SceneFile | None:
        """Read the known geometry and the left imager's pose; None without the file.

        `starling.sim.scene.captured.known_geometry.load` turns it into a scene to simulate.

        Raises:
            InputError: as `starling.sim.scene.scene_file.read`.
        """
        path = self.path / scene_file.FILE
        return scene_file.read(path) if _exists(path) else None

    def _image(self, folder: Path, name: str) -> GreyImage | None:
        path = folder / f"{name}.png"
        if not _exists(path):
            return None
        image = png.read(path, name, shape=self.info.shape)
        level, largest = self.info.black_level_dn, np.iinfo(image.dtype).max
        if name.startswith("ir") and level is not None and level >= largest:
            rule = f"in capture.toml must be below {largest}, the largest code of {path}"
            advice = "Give the pedestal in codes of these images."
            raise errors.refuse("black_level_dn", rule, f"{level:g}", advice)
        return image

    def _depth(self, folder: Path, name: str) -> NDArray[np.float32] | None:
        code = self._image(folder, name)
        if code is None:
            return None
        if code.dtype != np.uint16:
            raise errors.refuse(
                name,
                "must be a 16-bit PNG in steps of depth_unit_m",
                f"{folder / name}.png, 8-bit",
                "Save the sensor's own codes.",
            )
        return depth.from_code(code.astype(np.uint16), self.info.depth_unit_m)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class CaptureSet:
    """A folder of captures of one device, or of several if scenes have a `camera.toml`."""

    path: Path
    info: CaptureInfo  # Camera of the set; a scene's own camera may differ.
    scenes: tuple[CapturedScene, ...]  # Sorted by name.

    def refuse_mixed(self) -> None:
        """Refuse sets in which a scene's camera differs from the set's.

        Raises:
            InputError: with the first such scene.
        """
        for scene in self.scenes:
            if scene.info != self.info:
                raise errors.refuse(
                    "captures",
                    "must be of one camera here",
                    f"{scene.path} with a {capture_info.OWN} of its own",
                    "Give one scene, or a set of one camera.",
                )


def is_capture(path: Path | str) -> bool:
    """Return whether a path is a capture set or a scene folder in a set."""
    path = Path(os.path.abspath(path))
    return os.path.isdir(path) and any(
        (p / capture_info.FILE).is_file() for p in (path, path.parent)
    )


def open_set(path: Path | str) -> CaptureSet:
    """Open a capture set, or one scene folder in it as a set of that scene alone.

    Only the text files are read; images are read by `CapturedScene.frame` and `truth_m`. A scene
    with its own `camera.toml`, with the keys of `capture.toml`, has another camera.

    Raises:
        InputError: if the folder is missing or no capture set, `capture.toml` is invalid, or a
            scene holds no frame.

    Example:
        >>> captures = open_set("out/mine")  # doctest: +SKIP
        >>> captures.scenes[0].frame(0).ir_left.shape  # doctest: +SKIP
        (720, 1280)
    """
    path = Path(os.path.abspath(path))
    if not os.path.isdir(path):
        problem = "is a file" if os.path.exists(path) else "does not exist"
        raise errors.refuse(
            "captures",
            "must be a folder",
            path,
            f"It {problem}: give a capture set or a scene in it.",
        )
    if _exists(path / capture_info.FILE):
        info = _read_info(path / capture_info.FILE)
        folders = _scene_folders(path)
        if not folders:
            raise errors.refuse(
                "capture set",
                "must hold a scene folder",
                path,
                "Add SCENE/0/ir_left.png and so on.",
            )
        scenes = tuple(_scene(folder, info) for folder in folders)
        return CaptureSet(path=path, info=info, scenes=scenes)
    if (path.parent / capture_info.FILE).is_file():
        info = _read_info(path.parent / capture_info.FILE)
        scene = _scene(path, info)
        return CaptureSet(path=path.parent, info=scene.info, scenes=(scene,))
    raise errors.refuse(
        "captures",
        "must be a capture set",
        path,
        f"Looked for {capture_info.FILE} in it and, were it one scene, in the folder above."
        " `starling import` makes a set of a recording or of images.",
    )


def _scene_folders(path: Path) -> list[Path]:
    """List the folders of scenes; warn of folders without any file of a scene."""
    folders = sorted(p for p in _list(path) if p.is_dir() and not p.name.startswith((".", "__")))
    scenes = [folder for folder in folders if _is_scene(folder)]
    if scenes and len(scenes) < len(folders):
        listed = ", ".join(folder.name for folder in folders if folder not in scenes)
        warnings.warn(f"{path}: no scenes, and left out: {listed}.", stacklevel=2)
    return scenes or folders


def _is_scene(folder: Path) -> bool:
    return any(path.name in _SCENE_FILES or _NUMBER.fullmatch(path.name) for path in _list(folder))


def _scene(path: Path, info: CaptureInfo) -> CapturedScene:
    refuse_not_utf8(path)
    folders = [p.name for p in _list(path) if _NUMBER_LIKE.fullmatch(p.name) and p.is_dir()]
    frames = sorted(int(name) for name in folders if _NUMBER.fullmatch(name))
    if frames and len(frames) < len(folders):
        listed = ", ".join(sorted(name for name in folders if not _NUMBER.fullmatch(name)))
        message = f"{path}: no frame numbers, and left out: {listed}. Name frames 0, 1 and so on."
        warnings.warn(message, stacklevel=2)
    if not frames:
        raise errors.refuse(
            "scene", "must hold a frame folder", path, "Name it 0: SCENE/0/ir_left.png and so on."
        )
    camera_file = path / capture_info.OWN
    info = _read_info(camera_file) if _exists(camera_file) else info
    room = path / "room"
    name = files.read_text(room).strip() if _exists(room) else path.name
    return CapturedScene(
        name=path.name, room=name or path.name, path=path, info=info, frames=tuple(frames)
    )


def refuse_not_utf8(path: Path) -> None:
    """Refuse names that no text file can hold."""
    try:
        path.name.encode()
    except UnicodeEncodeError as error:
        name = os.fsencode(path.name)
        raise errors.refuse("scene", "must have a UTF-8 name", name, "Rename it.") from error


def _read_info(path: Path) -> CaptureInfo:
    """Read a camera's file, and warn of values that nothing uses."""
    info = capture_info.read(path)
    if info.distortion is not None and any(info.distortion):
        message = f"{path}: distortion is not applied; images are taken as rectified."
        warnings.warn(message, stacklevel=2)
    if info.extra:
        listed = ", ".join(sorted(info.extra))
        warnings.warn(f"{path}: unknown keys are not used: {listed}.", stacklevel=2)
    return info


def _list(path: Path) -> list[Path]:
    try:
        return list(path.iterdir())
    except OSError as error:
        raise errors.refuse(
            "captures", "must be a readable folder", path, f"{error.strerror}."
        ) from error


def _exists(path: Path) -> bool:
    """Return whether there is a file, or refuse a folder that cannot be searched."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError as error:
        rule = "must be a readable folder"
        raise errors.refuse("captures", rule, path.parent, f"{error.strerror}.") from error
    return True


def _record(folder: Path) -> dict[str, Any]:
    path = folder / frame_record.FILE
    return frame_record.parse(files.read_bytes(path), path) if _exists(path) else {}


def _check_pair(folder: Path, left: GreyImage | None, right: GreyImage | None, name: str) -> None:
    """Refuse a pair without left image or of two bit depths; report two equal images."""
    if right is not None and left is None:
        raise errors.refuse(
            f"{name} pair", "must have its left image", folder, "Is the folder complete?"
        )
    if left is not None and right is not None and left.dtype != right.dtype:
        raise errors.refuse(
            f"{name} pair",
            "must be of one bit depth",
            f"{folder}, left {left.dtype}, right {right.dtype}",
            "Save both alike.",
        )
    if left is not None and right is not None and np.ptp(right) and np.array_equal(left, right):
        message = f"{folder}: {name} pair has two equal images. Is the left one stored twice?"
        warnings.warn(message, stacklevel=3)
