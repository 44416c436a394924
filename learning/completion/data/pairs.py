"""Frames of a capture set for completion: an image, the camera's depth, and what is known of both.

Depth and image must be of one view. Infrared images are: depth is in the left one. A colour image
is another camera's; depth and truth are brought into it as a device's driver does
(`starling.sim.stereo.registration`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from starling.learning.completion.data.readers.item import colour
from starling.learning.completion.frame import Frame, Image, Mask, checked
from starling.learning.data import captured
from starling.learning.data.example import Example
from starling.learning.features.hole_kinds import hole_kinds
from starling.patterns.errors import InputError, one_of, refuse
from starling.sim.captures import exr, png
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.info import CaptureInfo
from starling.sim.captures.png import GreyImage
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.reason import Reason
from starling.sim.sensor.sensor import Colour, Sensor
from starling.sim.stereo.filled import filled
from starling.sim.stereo.registration import register

Picture = Literal["ir_left", "ir_left_off", "rgb"]
PICTURES: tuple[Picture, ...] = ("ir_left", "ir_left_off", "rgb")


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Pair:
    """One reading in one view."""

    scene: str
    room: str  # Splits go by room.
    number: int  # Of the frame.
    camera: Pinhole  # Of the view.
    focal_baseline_px_m: float  # Its focal length times the depth camera's baseline.
    image: NDArray[Any]  # (h, w) grey or (h, w, 3), as it is on disk.
    depth_m: Image  # (h, w) the camera's own [m], NaN = none.
    truth_m: Image | None  # (h, w) [m], NaN where unknown; None where there is none at all.
    causes: Callable[[], Mapping[str, Mask]]  # Finds why there is no depth: cause -> (h, w) where.

    @property
    def valid(self) -> Mask:
        """(h, w) where the camera has depth."""
        return np.isfinite(self.depth_m)

    @property
    def frame(self) -> Frame:
        """What a method of completion is given.

        Raises:
            InputError: as `starling.learning.completion.frame.checked`.
        """
        return checked(self.image, self.depth_m, self.valid)

    def truth(self) -> Image:
        """Reference depth (h, w) [m], where it is needed.

        Raises:
            InputError: if there is none.
        """
        if self.truth_m is None:
            name, advice = f"scene {self.scene}", "Leave it out, or give reference depth."
            raise refuse(name, "must have truth.png", "none", advice)
        return self.truth_m


def pair(scene: CapturedScene, number: int, picture: Picture) -> Pair:
    """Read one frame; each of its holes has one cause, found when it is asked for.

    Holes of a simulated camera, with `reason.png` or `frame.exr`, come with their reasons. A real
    camera gives none: its holes are sorted by what the reference depth has around them, where there
    is one: first those whose match would lie left of the right image (`outside_overlap`), then the
    kinds of `starling.learning.features.hole_kinds`. Else, and in a colour image, all are `unknown`.

    Args:
        scene: of a capture set.
        number: the frame's.
        picture: which image goes with the depth.

    Raises:
        InputError: if the image or the depth is not there, or nobody says where the colour camera
            stands, or as `starling.sim.captures.capture.CapturedScene.frame`.
    """
    one_of("picture", picture, PICTURES)
    frame = scene.frame(number)
    if frame.depth_m is None:
        raise _missing(scene, number, "depth.png")
    truth_m, depth_m, info = scene.truth_m(), frame.depth_m, scene.info
    camera, reason = Pinhole.of(info), _reason(scene, number, depth_m)
    if picture == "rgb":
        path = scene.path / str(number) / "rgb.png"
        if not path.exists():
            raise _missing(scene, number, "rgb.png")
        image = colour(path)
        seen = _colour_view(info)
        if seen is not None:
            camera = Pinhole.of(seen.colour)
            depth_m = register(depth_m, seen)
            truth_m = None if truth_m is None else register(truth_m, seen)
            reason = _unknown(depth_m)
    else:
        image = _infrared(scene, number, getattr(frame, picture), picture)
    sortable = truth_m is not None and camera == Pinhole.of(info)
    return Pair(
        scene=scene.name,
        room=scene.room,
        number=number,
        camera=camera,
        focal_baseline_px_m=camera.fx_px * info.baseline_m,
        image=image,
        depth_m=depth_m,
        truth_m=truth_m,
        causes=partial(_causes, scene, reason, sortable=sortable),
    )


def _missing(scene: CapturedScene, number: int, file: str) -> InputError:
    name, advice = f"frame {number} of {scene.name}", "Choose another picture, or leave it out."
    return refuse(name, f"must have {file}", "none", advice)


def _infrared(
    scene: CapturedScene, number: int, image: GreyImage | None, picture: str
) -> GreyImage:
    if image is None:
        raise _missing(scene, number, f"{picture}.png")
    return image


def _colour_view(info: CaptureInfo) -> Sensor | None:
    """The camera pair with its colour camera; None where that is the left imager itself."""
    if info.colour is None or info.colour_from_left is None:
        rule = "must tell colour and colour_from_left"
        advice = "Add them, or choose ir_left."
        raise refuse("capture.toml", rule, "neither or one of them", advice)
    pose = np.array(info.colour_from_left)
    if info.colour == Pinhole.of(info) and np.array_equal(pose, np.eye(4)):
        return None
    left_from_colour = np.linalg.inv(pose)
    turn = Rotation.from_matrix(left_from_colour[:3, :3]).as_rotvec(degrees=True)
    eye = Colour(
        **dataclasses.asdict(info.colour),
        position_m=tuple(left_from_colour[:3, 3].tolist()),
        rotation_deg=tuple(turn.tolist()),
    )
    own = dataclasses.asdict(Pinhole.of(info))
    return Sensor(name=info.sensor, baseline_m=info.baseline_m, colour=eye, **own)


def _reason(scene: CapturedScene, number: int, depth_m: Image) -> NDArray[np.uint32]:
    """Why a pixel has no depth, (h, w) codes of `starling.sim.reason`."""
    reason = _unknown(depth_m)
    told = _told(scene.path / str(number), reason.shape)
    if told is not None:
        # Depth beyond the 16-bit code is a hole on disk alone.
        reason = np.where((reason > 0) & (told > 0), told, reason)
    return reason


def _told(frame: Path, shape: tuple[int, ...]) -> NDArray[np.unsignedinteger] | None:
    """Reasons that a simulated frame comes with."""
    path = frame / "reason.png"
    if path.exists():
        told = png.read(path, "reason")
        if told.shape != shape or told.max() > max(Reason):
            got = f"{path}, {told.shape} up to {told.max()}"
            rule = f"must be of the depth's size, with codes up to {max(Reason):d}"
            raise refuse("reason", rule, got, "Leave the file out, or make it anew.")
        return told
    path = frame / "frame.exr"
    return exr.read(path)[1].reason if path.exists() else None


def _unknown(depth_m: Image) -> NDArray[np.uint32]:
    return np.where(np.isfinite(depth_m), Reason.VALID, Reason.UNKNOWN).astype(np.uint32)


def _causes(scene: CapturedScene, reason: NDArray[np.uint32], *, sortable: bool) -> dict[str, Mask]:
    codes = [Reason(code) for code in np.unique(reason) if code]
    if codes == [Reason.UNKNOWN] and sortable:
        return _kinds(captured.example(scene), reason > 0)
    return {code.name.lower(): reason == code for code in codes}


def _kinds(example: Example, holes: Mask) -> dict[str, Mask]:
    """Holes of a real camera, sorted by the reference depth around them."""
    disparity = example.info.disparity_px(example.depth_m)
    disparity = filled(disparity, np.isfinite(disparity))
    outside = disparity > np.arange(holes.shape[1])
    kinds = {name: mask & holes & ~outside for name, mask in hole_kinds(example).items()}
    return {Reason.OUTSIDE_OVERLAP.name.lower(): outside & holes, **kinds}
