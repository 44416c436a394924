"""Features of a pixel for trees: geometry that makes active stereo fail, from reference depth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.data.example import Example
from starling.learning.features.geometry import (
    edges_left,
    edges_right,
    gap_width,
    seen_from,
    signed_distance,
    thickness,
)
from starling.learning.networks import channels
from starling.patterns import errors
from starling.sim.arrays import filled
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.geometry.planes import fit_planes, incidence_cosine, surface_planes
from starling.sim.metrics import depth_edges
from starling.sim.sensor import presets

Image = NDArray[np.float32]

FINE_PX = 3  # Radius of the small windows for roughness [px].
COARSE_PX = 10  # Radius of the large windows for roughness [px].
WINDOW_PX = 9  # Side of a typical matching window (D400's census) [px].
GRADIENT_SIGMA_PX = 4.0  # Sigma of the smoothing before the gradient of reflectance [px].
MIDDLE = 0.5  # Default position of the projector on the baseline, 0 = left imager, 1 = right.

# Name of each feature, with its unit, and its description.
GEOMETRY: dict[str, str] = {
    "disparity_px": "reference disparity f b / z",
    "disparity_fraction_px": "fractional part of the disparity",
    "column_px": "column in the left image",
    "right_column_px": "column in the right image; below 0 lies outside",
    "off_axis": "tangent of the ray's angle to the optical axis",
    "incidence_cosine": "cosine between normal and ray to the left imager; 1 = facing it",
    "return_per_m2": "incidence cosine / squared range: light from a white surface",
    "occluded_px": "distance behind the occluding edge, seen from the right imager",
    "occlusion_border_px": "distance to the region hidden from the right imager; > 0 inside",
    "shadowed_px": "distance behind the occluding edge, seen from the projector",
    "shadow_border_px": "distance to the projector's shadow; > 0 inside",
    "edge_left_px": "distance along the row to the next depth edge on the left",
    "edge_left_step_px": "disparity beyond that edge less that before it; > 0 = occluded side",
    "edge_right_px": "distance along the row to the next depth edge on the right",
    "edge_right_step_px": "disparity beyond that edge less that before it",
    "edge_px": "distance to a depth edge in any direction",
    "front_px": "greatest disparity in a window of 9 px less that of the pixel",
    "back_px": "disparity of the pixel less the least in a window of 9 px",
    "thickness_px": "side of the smallest square that does not fit into the object in front",
    "gap_px": "side of the smallest square that does not fit into the gap between objects",
    "unknown_px": "distance to pixels without reference; <= 0 in them",
    "roughness_fine_px": "residual of a plane fit over 7 px",
    "roughness_coarse_px": "residual of a plane fit over 21 px",
    "bump_fine_px": "disparity less that of the plane over 7 px: signed curvature",
    "bump_coarse_px": "disparity less that of the plane over 21 px: signed curvature",
}
# Physics adds the channels of `starling.learning.networks.channels.physics_images`.
REFLECTANCE: dict[str, str] = {
    "reflectance": "near-infrared reflectance, 0 to 1",
    "reflectance_gradient_per_px": "length of its gradient after smoothing by sigma 4 px",
    "expected_return_per_m2": "reflectance x incidence cosine / squared range",
}


@dataclass(frozen=True, slots=True, eq=False)
class Features:
    """Features of all pixels of one view."""

    names: tuple[str, ...]
    values: Image  # (h, w, k), finite everywhere.

    def __getitem__(self, name: str) -> Image:
        """Return one feature by name, (h, w).

        Raises:
            InputError: if the name is unknown.
        """
        errors.one_of("feature", name, self.names)
        return self.values[..., self.names.index(name)]


def names(*, with_reflectance: bool, with_physics: bool = False) -> tuple[str, ...]:
    """Return the names in the order of the values."""
    reflectance = tuple(REFLECTANCE) if with_reflectance else ()
    physics = (*channels.PHYSICS, *channels.REASONS) if with_physics else ()
    return (*GEOMETRY, *reflectance, *physics)


def features(
    example: Example,
    *,
    with_reflectance: bool = False,
    with_physics: bool = False,
    projector_x_m: float | None = None,
) -> Features:
    """Compute the features of all pixels. Unknown pixels take the nearest known disparity.

    Args:
        example: only reference depth, geometry and, if requested, reflectance and physics are used.
        with_reflectance: adds the features of `REFLECTANCE`.
        with_physics: adds the simulation.
        projector_x_m: position of the projector, right of the left imager [m]; None = that of the
            sensor's preset, or the middle of the baseline.

    Raises:
        InputError: if no reference depth is known, an image is of another size than the geometry
            states, or a requested reflectance or simulation is missing.
    """
    camera, depth_m = Pinhole.from_camera(example.info), example.depth_m
    channels.check_size(example.info, "depth_m", depth_m)
    baseline_m = example.info.baseline_m
    part = _projector_part(example.info) if projector_x_m is None else projector_x_m / baseline_m
    measured = _geometry(camera, example.info.disparity_px(depth_m), part, baseline_m)
    if with_reflectance:
        measured |= _reflectance(channels.reflectance(example), measured["return_per_m2"])
    if with_physics:
        measured |= channels.physics_images(example)
    order = names(with_reflectance=with_reflectance, with_physics=with_physics)
    return Features(order, np.stack([measured[name] for name in order], axis=-1, dtype=np.float32))


def _projector_part(info: CaptureInfo) -> float:
    """Return the position of the projector on the baseline, 0 = left imager, 1 = right."""
    if info.sensor not in presets.names():
        return MIDDLE
    preset = presets.load(info.sensor)
    return preset.projector.position_m[0] / preset.baseline_m


def _geometry(
    camera: Pinhole, reference_px: Image, projector_part: float, baseline_m: float
) -> dict[str, Image]:
    known = np.isfinite(reference_px)
    disparity = filled(reference_px, known)
    column = np.broadcast_to(np.arange(camera.width, dtype=np.float32), disparity.shape)
    fine = fit_planes(disparity, known, FINE_PX)
    coarse = fit_planes(disparity, known, COARSE_PX)
    cosine = incidence_cosine(surface_planes(disparity, known), camera)
    tangent_squared = camera.tangent_squared()
    depth_m = np.float32(camera.fx_px * baseline_m) / disparity
    right, projector = seen_from(disparity, 1.0), seen_from(disparity, projector_part)
    left_edge, right_edge = edges_left(disparity), edges_right(disparity)
    window = np.ones((WINDOW_PX, WINDOW_PX), np.uint8)
    return {
        "disparity_px": disparity,
        "disparity_fraction_px": disparity - np.floor(disparity),
        "column_px": column,
        "right_column_px": column - disparity,
        "off_axis": np.sqrt(tangent_squared),
        "incidence_cosine": cosine,
        "return_per_m2": cosine / (depth_m**2 * (1 + tangent_squared)),
        "occluded_px": right.behind_px,
        "occlusion_border_px": right.border_px,
        "shadowed_px": projector.behind_px,
        "shadow_border_px": projector.border_px,
        "edge_left_px": left_edge.distance_px,
        "edge_left_step_px": left_edge.step_px,
        "edge_right_px": right_edge.distance_px,
        "edge_right_step_px": right_edge.step_px,
        "edge_px": -signed_distance(depth_edges(reference_px)),
        "front_px": np.asarray(cv2.dilate(disparity, window)) - disparity,
        "back_px": disparity - np.asarray(cv2.erode(disparity, window)),
        "thickness_px": thickness(disparity),
        "gap_px": gap_width(disparity),
        "unknown_px": -signed_distance(~known),
        "roughness_fine_px": fine.residual_px,
        "roughness_coarse_px": coarse.residual_px,
        "bump_fine_px": disparity - fine.disparity_px,
        "bump_coarse_px": disparity - coarse.disparity_px,
    }


def _reflectance(reflectance: Image, return_per_m2: Image) -> dict[str, Image]:
    sigma = GRADIENT_SIGMA_PX
    smooth = cv2.GaussianBlur(reflectance, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
    down, across = np.gradient(smooth)
    return {
        "reflectance": reflectance,
        "reflectance_gradient_per_px": np.hypot(across, down),
        "expected_return_per_m2": reflectance * return_per_m2,
    }
