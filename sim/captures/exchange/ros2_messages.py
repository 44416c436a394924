"""ROS messages for captures: images, intrinsics, transforms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.sim.captures.exchange import quaternion
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry.frames import Pose


class Messages:
    """Builds ROS messages from captures."""

    def __init__(self, types: dict[str, Any]) -> None:
        """Store the message classes by type name, as `rosbags` provides them."""
        self._types = types

    def image(self, stream: str, image: NDArray[Any], time_s: float) -> Any:
        """Return an image message with one channel."""
        height, width = image.shape
        little = np.ascontiguousarray(image, image.dtype.newbyteorder("<"))
        return self._types["sensor_msgs/msg/Image"](
            header=self._header(stream, time_s),
            height=height,
            width=width,
            encoding="16UC1" if stream == "depth" else f"mono{8 * image.itemsize}",
            is_bigendian=0,
            step=width * image.itemsize,
            data=little.view(np.uint8).ravel(),
        )

    def camera_info(self, stream: str, info: CaptureInfo, time_s: float) -> Any:
        """Return the intrinsics of rectified images, without distortion."""
        shift = -info.fx_px * info.baseline_m if stream == "infra2" else 0.0
        k = [info.fx_px, 0, info.cx_px, 0, info.fy_px, info.cy_px, 0, 0, 1]
        p = [info.fx_px, 0, info.cx_px, shift, 0, info.fy_px, info.cy_px, 0, 0, 0, 1, 0]
        roi = self._types["sensor_msgs/msg/RegionOfInterest"](
            x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        return self._types["sensor_msgs/msg/CameraInfo"](
            header=self._header(stream, time_s),
            height=info.height,
            width=info.width,
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
            x, y, z, w = quaternion.from_pose(pose)
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

    def _header(self, stream: str, time_s: float) -> Any:
        frame = "depth" if stream == "depth" else "infra1"
        return self._types["std_msgs/msg/Header"](
            stamp=_stamp(self._types, time_s), frame_id=f"camera_{frame}_optical_frame"
        )


def _stamp(types: dict[str, Any], time_s: float) -> Any:
    seconds, rest = divmod(round(time_s * 1e9), 10**9)
    return types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest)
