"""ROS 2 messages of captures: images, intrinsics, transforms, metadata."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.captures.exchange.ros_types import EXTRINSICS, METADATA
from starling.sim.geometry import frames
from starling.sim.geometry.frames import Pose
from starling.sim.geometry.pinhole import Pinhole

# Frames of the images: both infrared ones are in the left imager's.
_FRAMES = {
    "depth": "camera_depth_optical_frame",
    "color": "camera_color_optical_frame",
    "aligned_depth_to_color": "camera_color_optical_frame",
}
_LEFT = "camera_infra1_optical_frame"


class Messages:
    """Builds ROS messages from captures."""

    def __init__(self, types: dict[str, Any]) -> None:
        """Store the message classes by type name, as `rosbags` provides them."""
        self._types = types

    def image(self, stream: str, image: NDArray[Any], time_s: float) -> Any:
        """Return an image message: depth, infrared, or (h, w, 3) red, green, blue."""
        height, width = image.shape[:2]
        little = np.ascontiguousarray(image, image.dtype.newbyteorder("<"))
        step = width * image.itemsize * (3 if image.ndim == 3 else 1)
        return self._types["sensor_msgs/msg/Image"](
            header=self._header(stream, time_s),
            height=height,
            width=width,
            encoding=_encoding(stream, image),
            is_bigendian=0,
            step=step,
            data=little.view(np.uint8).ravel(),
        )

    def camera_info(
        self, stream: str, camera: Pinhole, time_s: float, *, baseline_m: float = 0.0
    ) -> Any:
        """Return the intrinsics of rectified images; `baseline_m` is that of the right ones."""
        shift = -camera.fx_px * baseline_m
        k = [camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 1]
        p = [camera.fx_px, 0, camera.cx_px, shift, 0, camera.fy_px, camera.cy_px, 0, 0, 0, 1, 0]
        roi = self._types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self._types["sensor_msgs/msg/CameraInfo"](
            header=self._header(stream, time_s),
            height=camera.height,
            width=camera.width,
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=np.array(k, float),
            r=np.eye(3).ravel(),
            p=np.array(p, float),
            binning_x=0,
            binning_y=0,
            roi=roi,
        )

    def transforms(self, poses: Sequence[tuple[str, str, Pose]], time_s: float) -> Any:
        """Return the transforms of (parent, child, `parent_from_child`)."""
        kind = self._types
        transforms = []
        for parent, child, pose in poses:
            x, y, z, w = frames.to_quaternion(pose)
            place = [float(component) for component in pose[:3, 3]]
            transform = kind["geometry_msgs/msg/Transform"](
                translation=kind["geometry_msgs/msg/Vector3"](*place),
                rotation=kind["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
            )
            header = kind["std_msgs/msg/Header"](stamp=_stamp(kind, time_s), frame_id=parent)
            transforms.append(
                kind["geometry_msgs/msg/TransformStamped"](
                    header=header, child_frame_id=child, transform=transform
                )
            )
        return kind["tf2_msgs/msg/TFMessage"](transforms=transforms)

    def metadata(self, stream: str, facts: Mapping[str, Any], time_s: float) -> Any:
        """Return what realsense-ros states of a frame, as JSON text."""
        header = self._header(stream, time_s)
        return self._types[METADATA](header=header, json_data=json.dumps(dict(facts)))

    def extrinsics(self, pose: Pose, time_s: float) -> Any:
        """Return `other_from_depth`: the rotation by columns, as librealsense has it."""
        return self._types[EXTRINSICS](
            header=self._header("depth", time_s),
            rotation=np.asarray(pose[:3, :3], np.float64).T.ravel(),
            translation=np.array(pose[:3, 3], np.float64),
        )

    def _header(self, stream: str, time_s: float) -> Any:
        return self._types["std_msgs/msg/Header"](
            stamp=_stamp(self._types, time_s), frame_id=_FRAMES.get(stream, _LEFT)
        )


def _encoding(stream: str, image: NDArray[Any]) -> str:
    """Return the encoding of an image by REP 118 and sensor_msgs."""
    if image.ndim == 3:
        return "rgb8"
    if image.dtype.kind == "f":
        return "32FC1"
    return "16UC1" if "depth" in stream else f"mono{8 * image.itemsize}"


def _stamp(types: dict[str, Any], time_s: float) -> Any:
    seconds, rest = divmod(round(time_s * 1e9), 10**9)
    return types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
