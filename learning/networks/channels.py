"""Named input channels of networks, scaled to about unit size."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from starling.learning.data.example import Example, Image, Physics
from starling.learning.data.physics import as_precise_as_physics, physics_probability
from starling.patterns import errors
from starling.sim.arrays import filled
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.geometry.planes import fit_planes, incidence_cosine
from starling.sim.reason import Reason

PLANE_RADIUS_PX = 3  # Normals are estimated over 7x7 pixels.
LOGIT_SCALE = 0.25  # A power of two, so that the logit is recovered exactly.

# Disparity stays in pixels for all cameras: windows, occlusions and noise scale with pixels.
GEOMETRY: dict[str, str] = {
    "disparity": "reference disparity / 32 px; unknown pixels take the nearest known value",
    "known": "1 where the reference is known",
    "across": "disparity gradient along the row [px / px]",
    "down": "disparity gradient along the column [px / px]",
    "incidence": "cosine between normal and ray; 1 = facing the camera",
    "off_axis": "tangent of the ray's angle to the optical axis, where lenses and lasers dim",
    "column": "column / 1280 px",
    "right_column": "column in the right image / 32 px, clipped to +-1; below 0 lies outside",
}
REFLECTANCE: dict[str, str] = {"reflectance": "square root of near-infrared reflectance, 0 to 1"}
# All channels of physics and reasons are smoothed by the uncertainty of physics, 4 px.
PHYSICS: dict[str, str] = {
    "logit": "logit of the simulated probability of no depth, times `LOGIT_SCALE`",
    "infrared": "square root of the simulated left image",
    "contrast": "local standard deviation over local mean",
    "disparity_error": "simulated less reference disparity / 4 px, clipped to +-1; 0 if unknown",
    "matched": "1 where a draw has a disparity",
}
REASONS: dict[str, tuple[Reason, ...]] = {
    "reason_border": (Reason.NO_SURFACE, Reason.OUTSIDE_OVERLAP),
    "reason_occluded": (Reason.OCCLUDED, Reason.LEFT_RIGHT),
    "reason_shadowed": (Reason.SHADOWED,),
    "reason_signal": (Reason.LOW_SIGNAL, Reason.SUPPORT),
    "reason_saturated": (Reason.SATURATED,),
    "reason_ambiguous": (Reason.AMBIGUOUS,),
    "reason_filtered": (Reason.SPECKLE, Reason.POST_FILTER, Reason.OUT_OF_RANGE, Reason.UNKNOWN),
}
ODD = ("down",)  # Channels that change sign when the image is flipped vertically.


def names(*, with_reflectance: bool, with_physics: bool) -> tuple[str, ...]:
    """Return the names of the channels in order."""
    reflectance = tuple(REFLECTANCE) if with_reflectance else ()
    physics = (*PHYSICS, *REASONS) if with_physics else ()
    return (*GEOMETRY, *reflectance, *physics)


def channels(example: Example, *, with_reflectance: bool, with_physics: bool) -> Image:
    """Stack the input channels, (c, h, w) in the order of `names`.

    Raises:
        InputError: if no reference depth is known, or a requested image is missing or of another
            size than the geometry states.
    """
    check_size(example.info, "depth_m", example.depth_m)
    images = _geometry(example)
    if with_reflectance:
        images |= {"reflectance": np.sqrt(np.clip(reflectance(example), 0, 1))}
    if with_physics:
        images |= physics_images(example)
    order = names(with_reflectance=with_reflectance, with_physics=with_physics)
    return np.stack([images[name] for name in order], dtype=np.float32)


def uninformative(share: float, *, with_reflectance: bool) -> tuple[tuple[int, float], ...]:
    """Return the numbers of the physics channels, each with an uninformative value.

    Args:
        share: share of pixels without depth, 0 to 1, from which the logit is computed.
        with_reflectance: whether reflectance precedes these channels.
    """
    order = names(with_reflectance=with_reflectance, with_physics=True)
    logit = math.log(share / (1 - share)) * LOGIT_SCALE
    return tuple(
        (order.index(name), logit if name == "logit" else 0.0) for name in (*PHYSICS, *REASONS)
    )


def check_size(info: CaptureInfo, name: str, image: NDArray) -> None:
    """Refuse an image of another size than the geometry states.

    Raises:
        InputError: if the sizes differ.
    """
    if image.shape != info.shape:
        rule = f"must be {info.width}x{info.height} as the geometry states"
        raise errors.refuse(name, rule, f"shape {image.shape}", "Correct the one that is wrong.")


def _geometry(example: Example) -> dict[str, Image]:
    camera = Pinhole.from_camera(example.info)
    disparity = example.info.disparity_px(example.depth_m)
    known = np.isfinite(disparity)
    disparity = filled(disparity, known)
    planes = fit_planes(disparity, known, PLANE_RADIUS_PX)
    column = np.broadcast_to(np.arange(camera.width, dtype=np.float32), disparity.shape)
    return {
        "disparity": disparity / np.float32(32),
        "known": known.astype(np.float32),
        "across": np.clip(planes.across, -2, 2),
        "down": np.clip(planes.down, -2, 2),
        "incidence": incidence_cosine(planes, camera),
        "off_axis": np.sqrt(camera.tangent_squared()),
        "column": column / np.float32(1280),
        "right_column": np.clip((column - disparity) / np.float32(32), -1, 1),
    }


def reflectance(example: Example) -> Image:
    """Return the reflectance (h, w) of a scene; unknown pixels take the nearest known value.

    Raises:
        InputError: if there is none, or it is of another size than the geometry states.
    """
    if example.reflectance is None:
        rule = "must be given for a method that uses it"
        remedy = "Take captures with infrared images, or a method without reflectance."
        raise errors.refuse("reflectance", rule, f"none for {example.scene}", remedy)
    check_size(example.info, "reflectance", example.reflectance)
    return filled(example.reflectance, np.isfinite(example.reflectance))


def require_physics(example: Example) -> Physics:
    """Return the simulation of a scene.

    Raises:
        InputError: if there is none, or it is of another size or not finite.
    """
    if example.physics is None:
        rule = "must be given for a method that uses it"
        raise errors.refuse("physics", rule, f"none for {example.scene}", "Simulate the scene.")
    for name in (field.name for field in dataclasses.fields(Physics) if field.name != "draws"):
        image = getattr(example.physics, name)
        check_size(example.info, f"physics {name}", image)
        missing = int(np.count_nonzero(~np.isfinite(image)))
        if missing and not name.endswith("_px"):
            got = f"{missing} pixels in {example.scene} that are not"
            raise errors.refuse(f"physics {name}", "must be finite", got, "Simulate again.")
    return example.physics


def physics_images(example: Example) -> dict[str, Image]:
    """Return the channels of physics, smoothed.

    Sharp edges would be overfitted, because their position depends on the registration of the
    reference, which differs from scene to scene.

    Returns:
        (h, w) each, by the names of `PHYSICS` and `REASONS`.

    Raises:
        InputError: see `require_physics`; or if no reference depth is known.
    """
    physics = require_physics(example)
    reference_px = example.info.disparity_px(example.depth_m)
    reference_px = filled(reference_px, np.isfinite(reference_px))
    probability = physics_probability(physics)
    matched = np.isfinite(physics.disparity_px)
    error = np.where(matched, physics.disparity_px - reference_px, 0)
    physics_channels = {
        "logit": (np.log(probability) - np.log1p(-probability)) * np.float32(LOGIT_SCALE),
        "infrared": np.sqrt(np.clip(physics.infrared, 0, 1)),
        "contrast": np.clip(physics.contrast, 0, 2),
        "disparity_error": np.clip(error / np.float32(4), -1, 1),
        "matched": matched.astype(np.float32),
    }
    reasons = {
        name: np.isin(physics.reason, codes).astype(np.float32) for name, codes in REASONS.items()
    }
    return {
        name: image if name == "logit" else as_precise_as_physics(image)
        for name, image in (physics_channels | reasons).items()
    }
