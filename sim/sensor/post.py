"""Settings of post-processing, from disparity to the output depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from starling.patterns import errors
from starling.sim import quantities
from starling.sim.sensor.matcher import whole

HoleFilling = Literal["off", "left", "farthest", "nearest"]  # Neighbour that fills a hole.


@dataclass(frozen=True, kw_only=True, slots=True)
class Post:
    """Post-processing in the order of librealsense's filters; by default all are off."""

    near_m: float = 0.0  # Smaller depth is out of range [m].
    far_m: float = 65.535  # Larger depth is out of range [m].
    # Side of the blocks that share one depth [px]; 1 is off, 2 and 3 take the median, 4 to 8 the
    # mean. The depth map keeps its size.
    decimation: int = 1
    spatial_alpha: float = 1.0  # Weight of a pixel in its smoothed value; 1: no spatial filter.
    # librealsense gives both deltas in 1/32 px of the decimated image: its 20 is 0.625 px.
    spatial_delta_px: float = 0.625  # A larger disparity difference is an edge [px].
    spatial_iterations: int = 2  # Passes along rows and columns.
    # Mode of librealsense by which the spatial filter fills holes along rows: 0 none; 1 to 4:
    # 2^mode - 1 pixels from either side; 5: 254 pixels.
    spatial_holes: int = 0
    temporal_alpha: float = 1.0  # Weight of the new frame; 1 switches filter and persistence off.
    temporal_delta_px: float = 0.625  # A larger disparity change is not filtered [px].
    temporal_persistence: int = (
        3  # librealsense's persistence mode, 0 to 8: when holes keep an old depth.
    )
    hole_filling: HoleFilling = "off"
    depth_unit_m: float = 1e-3  # Step of the 16-bit depth image [m]; applied on writing.
    registered: bool = False  # Also compute depth in the colour camera's image.

    def __post_init__(self) -> None:
        quantities.check("post.depth_unit_m", self.depth_unit_m, "depth_unit_m")
        errors.in_interval("post.near_m", self.near_m, 0.0, 1e3)
        errors.in_interval("post.far_m", self.far_m, 0.0, 1e3)
        if self.far_m <= self.near_m:
            raise errors.refuse(
                "post.far_m", "must be > post.near_m", repr(self.far_m), "Swap or widen the range."
            )
        whole("post.decimation", self.decimation, 1, 8, "1 switches it off.")
        errors.in_interval(
            "post.spatial_alpha", self.spatial_alpha, 0.25, 1.0, "1 switches it off."
        )
        errors.in_interval("post.spatial_delta_px", self.spatial_delta_px, 0.0, 64.0)
        whole("post.spatial_iterations", self.spatial_iterations, 1, 5)
        whole("post.spatial_holes", self.spatial_holes, 0, 5, "0 fills none.")
        errors.in_interval(
            "post.temporal_alpha", self.temporal_alpha, 0.0, 1.0, "1 switches it off."
        )
        errors.in_interval("post.temporal_delta_px", self.temporal_delta_px, 0.0, 64.0)
        whole("post.temporal_persistence", self.temporal_persistence, 0, 8)
        errors.one_of("post.hole_filling", self.hole_filling, get_args(HoleFilling))

    @property
    def filters(self) -> bool:
        """Whether a filter other than the range is on."""
        off = self.decimation == 1 and self.hole_filling == "off"
        return not (off and self.spatial_alpha == 1.0 and self.temporal_alpha == 1.0)


def refuse_single_frame(post: Post, frames: int) -> None:
    """Refuse a temporal filter on a single frame.

    Args:
        post: Settings of post-processing.
        frames: Number of consecutive frames of one scene.

    Raises:
        InputError: if the temporal filter is on and `frames` is less than 2.
    """
    if frames < 2 and post.temporal_alpha < 1.0:
        raise errors.refuse(
            "post.temporal_alpha",
            "must be 1 for a single frame",
            repr(post.temporal_alpha),
            "Give --frames 2 or more.",
        )
