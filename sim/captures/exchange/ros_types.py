"""Types of ROS messages, by `rosbags`, with those of realsense-ros."""

from __future__ import annotations

import functools
from typing import Any

from starling.patterns.errors import needs

METADATA = "realsense2_camera_msgs/msg/Metadata"
EXTRINSICS = "realsense2_camera_msgs/msg/Extrinsics"
_DEFINITIONS = {  # Source: realsense-ros, `realsense2_camera_msgs/msg`.
    METADATA: "std_msgs/Header header\nstring json_data",
    EXTRINSICS: "std_msgs/Header header\nfloat64[9] rotation\nfloat64[3] translation",
}


@functools.cache
def typestore(*, is_ros1: bool) -> Any:
    """Return the types of messages of ROS 1 Noetic or ROS 2 Humble.

    Raises:
        InputError: if `rosbags` is not installed.
    """
    try:
        from rosbags import typesys
    except ImportError as error:
        raise needs("bag", "rosbags", "ros") from error
    stores = typesys.Stores
    types = typesys.get_typestore(stores.ROS1_NOETIC if is_ros1 else stores.ROS2_HUMBLE)
    if not is_ros1:
        for kind, text in _DEFINITIONS.items():
            types.register(typesys.get_types_from_msg(text, kind))
    return types
