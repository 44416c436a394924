"""`starling show --rerun`: a recording for the Rerun viewer.

    ROOM/camera                     pose in the frame of the geometry
    ROOM/camera/left                pinhole; infrared, depth, reason
    ROOM/camera/right, colour       pinholes; infrared, rgb
    ROOM/camera/points              points of the depth [m], with colours

The time lines are `frame` (number in the room) and `time` [s].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns.errors import needs, refuse
from starling.sim.captures import capture, frame_reason, png
from starling.sim.captures.exchange import point_cloud
from starling.sim.captures.exchange.stream import (
    TimedFrame,
    by_room,
    in_time_order,
    pose_of_left,
)
from starling.sim.captures.info import CaptureInfo
from starling.sim.console import output, progress
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.plotting.panels import REASON_COLOURS
from starling.sim.reason import LABELS
from starling.sim.stereo.depth import to_code

_SUFFIX = ".rrd"  # The viewer opens no others.
_PICTURES = (  # Name of the view, camera, entity, file in the frame's folder.
    ("infrared left", "left", "infrared", "ir_left"),
    ("infrared right", "right", "infrared", "ir_right"),
    ("depth", "left", "depth", "depth"),
    ("why depth is missing", "left", "reason", "depth"),
    ("colour", "colour", "rgb", "rgb"),
)


def write(
    captures: str, out: Path, *, force: bool = False, track: progress.Progress = progress.silent
) -> dict[str, Any]:
    """Write all frames of a capture set.

    Args:
        captures: a capture set or one scene in it.
        out: file to write, `NAME.rrd`.
        force: replace an earlier recording.
        track: wraps the loop over frames.

    Returns:
        `{"out", "frames"}`.

    Raises:
        InputError: if captures cannot be read, the file cannot be written, or `rerun-sdk` is not
            installed.
    """
    try:
        sdk = import_module("rerun")
    except ImportError as error:
        raise needs("rerun", "rerun-sdk", "rerun") from error
    if out.suffix != _SUFFIX:
        raise refuse("rerun", f"must be NAME{_SUFFIX}", out, "The viewer needs that suffix.")
    opened = capture.open_set(captures)
    output.refuse_own_input(out, opened.path)
    rooms = {room: in_time_order(scenes) for room, scenes in by_room(opened.scenes).items()}
    output.write_file_by(out, lambda path: _write(sdk, path, rooms, track), force=force)
    return {"out": str(out), "frames": sum(map(len, rooms.values()))}


def _write(
    sdk: Any, path: Path, rooms: Mapping[str, Sequence[TimedFrame]], track: progress.Progress
) -> None:
    stream = sdk.RecordingStream("starling")
    stream.set_log_time_enabled(False)  # The time of writing is no time line of the frames.
    try:
        stream.save(path, default_blueprint=_blueprint(sdk, rooms))
    except RuntimeError as error:
        raise refuse("rerun", "must be writable", path, f"{error}. Choose another place.") from None
    views = {room: _RoomView(sdk=sdk, stream=stream, room=room) for room in rooms}
    for room, frames in rooms.items():
        views[room].log_cameras(frames[0])
    listed = [(views[room], *pair) for room, frames in rooms.items() for pair in enumerate(frames)]
    for view, index, timed in track(listed, "frame"):
        stream.set_time("frame", sequence=index)
        stream.set_time("time", duration=timed.time_s)
        view.log_frame(timed)
    try:
        stream.flush()
        stream.disconnect()
    except RuntimeError as error:
        raise refuse("rerun", "must be writable", path, f"{error}. Free some space.") from error


def _blueprint(sdk: Any, rooms: Mapping[str, Sequence[TimedFrame]]) -> Any:
    """Return the arrangement of the viewer: a tab for each room, a view for each image."""
    parts = import_module("rerun.blueprint")
    tabs = []
    for room, frames in rooms.items():
        folder = frames[0].scene.path / str(frames[0].number)
        origin = sdk.new_entity_path([room])
        hidden = [f"- {origin}/camera/left/{name}" for name in ("depth", "reason")]  # As points.
        views = [
            parts.Spatial2DView(
                name=name, origin=f"{origin}/camera/{camera}", contents=[f"$origin/{entity}"]
            )
            for name, camera, entity, file in _PICTURES
            if (folder / f"{file}.png").is_file()
        ]
        space = parts.Spatial3DView(
            name="points", origin=origin, contents=["+ $origin/**", *hidden]
        )
        tabs.append(parts.Grid(space, *views, name=room))
    return parts.Blueprint(parts.Tabs(*tabs), collapse_panels=True)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _RoomView:
    """Entities of one room in a recording."""

    sdk: Any
    stream: Any
    room: str

    def log_cameras(self, first: TimedFrame) -> None:
        """Log what does not change: cameras and the names of reasons."""
        info, sdk = first.scene.info, self.sdk
        if pose_of_left(first.scene, first.scene.record(first.number)) is None:
            self._log(sdk.ViewCoordinates.RIGHT_HAND_Y_DOWN, is_fixed=True)
        left, left_from_right = Pinhole.from_camera(info), np.eye(4)
        left_from_right[0, 3] = info.baseline_m
        self._log_pinhole("left", left, None)
        self._log_pinhole("right", left, left_from_right)
        self._log_pinhole("colour", info.colour, _left_from_colour(info))
        classes = [
            sdk.AnnotationInfo(id=int(code), label=label, color=_rgb(REASON_COLOURS[code]))
            for code, label in LABELS.items()
        ]
        self._log(sdk.AnnotationContext(classes), "camera", "left", "reason", is_fixed=True)

    def log_frame(self, timed: TimedFrame) -> None:
        """Log pose, images and points of a frame."""
        scene, frame = timed.scene, timed.scene.frame(timed.number)
        pose = pose_of_left(scene, frame.record)
        if pose is not None:
            self._log(self._transform(pose), "camera")
        for side, image in (("left", frame.ir_left), ("right", frame.ir_right)):
            if image is not None:
                self._log(self._picture(png.encode(image)), "camera", side, "infrared")
        colour = scene.colour(timed.number)
        if colour is not None:
            self._log(self._picture(png.encode_colour(colour)), "camera", "colour", "rgb")
        reason = frame_reason.read(scene, frame)
        if reason is not None:
            labels = self.sdk.SegmentationImage(reason.astype(np.uint8))
            self._log(labels, "camera", "left", "reason")
        if frame.depth_m is not None:
            unit_m = scene.info.depth_unit_m
            depth = self.sdk.DepthImage(to_code(frame.depth_m, unit_m), meter=1 / unit_m)
            self._log(depth, "camera", "left", "depth")
            points, colours = point_cloud.coloured(scene, frame)
            self._log(self.sdk.Points3D(points, colors=colours), "camera", "points")

    def _log_pinhole(
        self, name: str, camera: Pinhole | None, left_from_camera: NDArray[np.floating] | None
    ) -> None:
        if camera is not None:
            pinhole = self.sdk.Pinhole(
                image_from_camera=camera.matrix,
                resolution=[camera.width, camera.height],
                camera_xyz=self.sdk.ViewCoordinates.RDF,
            )
            self._log(pinhole, "camera", name, is_fixed=True)
        if left_from_camera is not None:
            self._log(self._transform(left_from_camera), "camera", name, is_fixed=True)

    def _log(self, value: Any, *parts: str, is_fixed: bool = False) -> None:
        self.stream.log(self.sdk.new_entity_path([self.room, *parts]), value, static=is_fixed)

    def _picture(self, data: bytes) -> Any:
        return self.sdk.EncodedImage(contents=data, media_type="image/png")

    def _transform(self, pose: NDArray[np.floating]) -> Any:
        return self.sdk.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])


def _left_from_colour(info: CaptureInfo) -> NDArray[np.floating] | None:
    pose = info.colour_from_left
    return None if pose is None else np.linalg.inv(np.array(pose, np.float64))


def _rgb(colour: str) -> tuple[int, ...]:
    """Return the channels of a colour `#rrggbb`."""
    return tuple(bytes.fromhex(colour[1:]))
