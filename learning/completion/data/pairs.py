"""Frames of a capture set for completion: an image, the camera's depth, and reference depth.

Depth and image must be of one view. Depth is in the view of the left infrared image. For a colour
image, depth and truth are registered to the colour camera as a device's driver does
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

from starling.learning.completion.data.readers.item import read_colour
from starling.learning.completion.method import CompletionFrame, Image, Mask, make_frame
from starling.learning.data import captured
from starling.learning.data.example import Example
from starling.learning.features.holes import hole_kinds
from starling.patterns.errors import InputError, one_of, refuse
from starling.sim.arrays import filled
from starling.sim.captures import exr, png
from starling.sim.captures.capture import CapturedScene
from starling.sim.captures.info import CaptureInfo
from starling.sim.captures.png import GreyImage
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.reason import Reason
from starling.sim.sensor.sensor import Colour, Sensor
from starling.sim.stereo.registration import register

Picture = Literal["ir_left", "ir_left_off", "rgb"]
PICTURES: tuple[Picture, ...] = ("ir_left", "ir_left_off", "rgb")


@dataclasses.dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Pair:
    """An image and depth of one view."""

    scene: str
    room: str  # Splits are by room.
    number: int  # Number of the frame.
    camera: Pinhole  # Camera of the view.
    focal_baseline_px_m: float  # Focal length of the view times baseline of the depth camera.
    image: NDArray[Any]  # (h, w) grey or (h, w, 3), as stored in the file.
    depth_m: Image  # (h, w) the camera's own depth [m], NaN where missing.
    truth_m: Image | None  # (h, w) [m], NaN where unknown; None without reference depth.
    causes: Callable[[], Mapping[str, Mask]]  # Computes the holes by cause: cause -> (h, w).

    @property
    def valid(self) -> Mask:
        """(h, w) True where the camera has depth."""
        return np.isfinite(self.depth_m)

    @property
    def frame(self) -> CompletionFrame:
        """Input of a completion method.

        Raises:
            InputError: see `starling.learning.completion.method.make_frame`.
        """
        return make_frame(self.image, self.depth_m, self.valid)

    def truth(self) -> Image:
        """Reference depth (h, w) [m].

        Raises:
            InputError: if there is none.
        """
        if self.truth_m is None:
            name, advice = f"scene {self.scene}", "Leave it out, or give reference depth."
            raise refuse(name, "must have truth.png", "none", advice)
        return self.truth_m


def read_pair(scene: CapturedScene, number: int, picture: Picture) -> Pair:
    """Read one frame. Each hole has one cause, computed on demand.

    Holes of a simulated camera, with `reason.png` or `frame.exr`, have their simulated reasons.
    Holes of a real camera are classified by the surrounding reference depth. Holes whose match
    would lie left of the right image are `outside_overlap`. The others have the kinds of
    `starling.learning.features.holes`. Without reference, and in a colour image, all holes
    are `unknown`.

    Args:
        scene: scene of a capture set.
        number: number of the frame.
        picture: image to use with the depth.

    Raises:
        InputError: if image or depth is missing, or the pose of the colour camera is unknown; see
            also `starling.sim.captures.capture.CapturedScene.frame`.
    """
    one_of("picture", picture, PICTURES)
    frame = scene.frame(number)
    if frame.depth_m is None:
        raise _missing(scene, number, "depth.png")
    truth_m, depth_m, info = scene.truth_m(), frame.depth_m, scene.info
    camera, reason = Pinhole.from_camera(info), _reason(scene, number, depth_m)
    if picture == "rgb":
        path = scene.path / str(number) / "rgb.png"
        if not path.exists():
            raise _missing(scene, number, "rgb.png")
        image = read_colour(path)
        colour_view = _colour_view(info)
        if colour_view is not None:
            camera = Pinhole.from_camera(colour_view.colour)
            depth_m = register(depth_m, colour_view)
            truth_m = None if truth_m is None else register(truth_m, colour_view)
            reason = _unknown(depth_m)
    else:
        image = _infrared(scene, number, getattr(frame, picture), picture)
    sortable = truth_m is not None and camera == Pinhole.from_camera(info)
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
    """Build the error of a missing file."""
    name, advice = f"frame {number} of {scene.name}", "Choose another picture, or leave it out."
    return refuse(name, f"must have {file}", "none", advice)


def _infrared(
    scene: CapturedScene, number: int, image: GreyImage | None, picture: str
) -> GreyImage:
    if image is None:
        raise _missing(scene, number, f"{picture}.png")
    return image


def _colour_view(info: CaptureInfo) -> Sensor | None:
    """Return the camera pair with its colour camera; None if this is the left imager itself."""
    if info.colour is None or info.colour_from_left is None:
        rule = "must have colour and colour_from_left"
        advice = "Add them, or choose ir_left."
        raise refuse("capture.toml", rule, "neither or one of them", advice)
    pose = np.array(info.colour_from_left)
    if info.colour == Pinhole.from_camera(info) and np.array_equal(pose, np.eye(4)):
        return None
    left_from_colour = np.linalg.inv(pose)
    turn = Rotation.from_matrix(left_from_colour[:3, :3]).as_rotvec(degrees=True)
    colour_camera = Colour(
        **dataclasses.asdict(info.colour),
        position_m=tuple(left_from_colour[:3, 3].tolist()),
        rotation_deg=tuple(turn.tolist()),
    )
    left_camera = dataclasses.asdict(Pinhole.from_camera(info))
    return Sensor(name=info.sensor, baseline_m=info.baseline_m, colour=colour_camera, **left_camera)


def _reason(scene: CapturedScene, number: int, depth_m: Image) -> NDArray[np.uint32]:
    """Return why a pixel has no depth, (h, w) codes of `starling.sim.reason`."""
    reason = _unknown(depth_m)
    reasons = _simulated_reason(scene.path / str(number), reason.shape)
    if reasons is not None:
        # Depth beyond the range of the 16-bit code is a hole in the file only.
        reason = np.where((reason > 0) & (reasons > 0), reasons, reason)
    return reason


def _simulated_reason(frame: Path, shape: tuple[int, ...]) -> NDArray[np.unsignedinteger] | None:
    """Read the reasons of a simulated frame; None if there are none."""
    path = frame / "reason.png"
    if path.exists():
        reasons = png.read(path, "reason")
        if reasons.shape != shape or reasons.max() > max(Reason):
            got = f"{path}, {reasons.shape} up to {reasons.max()}"
            rule = f"must be of the depth's size, with codes up to {max(Reason):d}"
            raise refuse("reason", rule, got, "Delete the file, or write it again.")
        return reasons
    path = frame / "frame.exr"
    return exr.read(path)[1].reason if path.exists() else None


def _unknown(depth_m: Image) -> NDArray[np.uint32]:
    return np.where(np.isfinite(depth_m), Reason.VALID, Reason.UNKNOWN).astype(np.uint32)


def _causes(scene: CapturedScene, reason: NDArray[np.uint32], *, sortable: bool) -> dict[str, Mask]:
    """Return the holes by cause."""
    codes = [Reason(code) for code in np.unique(reason) if code]
    if codes == [Reason.UNKNOWN] and sortable:
        return _kinds(captured.example(scene), reason > 0)
    return {code.name.lower(): reason == code for code in codes}


def _kinds(example: Example, holes: Mask) -> dict[str, Mask]:
    """Classify the holes of a real camera by the surrounding reference depth."""
    disparity = example.info.disparity_px(example.depth_m)
    disparity = filled(disparity, np.isfinite(disparity))
    outside = disparity > np.arange(holes.shape[1])
    kinds = {name: mask & holes & ~outside for name, mask in hole_kinds(example).items()}
    return {Reason.OUTSIDE_OVERLAP.name.lower(): outside & holes, **kinds}
