"""What a network sees of a scene: images of about unit size, by name."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from starling.learning.data.example import Example, Image, Physics
from starling.learning.data.physics_probability import as_precise_as_physics, physics_probability
from starling.patterns import errors
from starling.sim.captures.info import CaptureInfo
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.geometry.planes import fit_planes, incidence_cosine
from starling.sim.reason import Reason
from starling.sim.stereo.filled import filled

PLANE_RADIUS_PX = 3  # Normals are taken over 7x7 pixels.
LOGIT_SCALE = 0.25  # A power of two, so that the logit is got back exactly.

# Disparities stay in pixels whatever the camera: windows, occlusions and noise are measured in it.
GEOMETRY: dict[str, str] = {
    "disparity": "reference disparity / 32 px, unknown pixels as the nearest known",
    "known": "1 where the reference is known",
    "across": "disparity gradient along the row [px / px]",
    "down": "along the column",
    "incidence": "cosine between normal and ray; 1 = facing the camera",
    "off_axis": "tangent of the ray's angle off the optical axis: lenses and lasers dim there",
    "column": "column / 1280 px",
    "right_column": "column in the right image / 32 px, within one: below 0 it lies outside",
}
REFLECTANCE: dict[str, str] = {"reflectance": "near-infrared, 0 to 1, its square root"}
PHYSICS: dict[str, str] = {  # All no more precise than physics is, 4 px; so the reasons.
    "logit": "logit of what physics tells, times `LOGIT_SCALE`",
    "infrared": "simulated left image, its square root",
    "contrast": "local deviation over mean",
    "disparity_error": "simulated less reference disparity / 4 px, within one; 0 where unknown",
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
ODD = ("down",)  # Change sign when the image is turned upside down.


def names(*, with_reflectance: bool, with_physics: bool) -> tuple[str, ...]:
    """Channels in their order."""
    reflectance = tuple(REFLECTANCE) if with_reflectance else ()
    physics = (*PHYSICS, *REASONS) if with_physics else ()
    return (*GEOMETRY, *reflectance, *physics)


def channels(example: Example, *, with_reflectance: bool, with_physics: bool) -> Image:
    """Stack what a network sees, (c, h, w) in the order of `names`.

    Raises:
        InputError: if nothing is known of the reference, or what is asked for is missing or of
            another size than the geometry says.
    """
    check_size(example.info, "depth_m", example.depth_m)
    seen = _geometry(example)
    if with_reflectance:
        seen |= {"reflectance": np.sqrt(_reflectance(example))}
    if with_physics:
        seen |= physics_images(example)
    order = names(with_reflectance=with_reflectance, with_physics=with_physics)
    return np.stack([seen[name] for name in order], dtype=np.float32)


def saying_nothing(share: float, *, with_reflectance: bool) -> tuple[tuple[int, float], ...]:
    """Physics' channels by number, and the value of each that tells no pixel from another.

    Args:
        share: of pixels without depth, 0 to 1: all that the logit says then.
        with_reflectance: whether reflectance stands before them.
    """
    order = names(with_reflectance=with_reflectance, with_physics=True)
    logit = math.log(share / (1 - share)) * LOGIT_SCALE
    return tuple(
        (order.index(name), logit if name == "logit" else 0.0) for name in (*PHYSICS, *REASONS)
    )


def check_size(info: CaptureInfo, name: str, image: NDArray) -> None:
    """Refuse an image of another size than the geometry says.

    Raises:
        InputError: if it is.
    """
    if image.shape != info.shape:
        rule = f"must be {info.width}x{info.height} as the geometry says"
        raise errors.refuse(name, rule, f"shape {image.shape}", "Correct the one that is wrong.")


def _geometry(example: Example) -> dict[str, Image]:
    camera = Pinhole.of(example.info)
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


def _reflectance(example: Example) -> Image:
    if example.reflectance is None:
        rule = "must be given to a method that was asked to use it"
        remedy = "Take captures with infrared images, or a method without reflectance."
        raise errors.refuse("reflectance", rule, f"none for {example.scene}", remedy)
    check_size(example.info, "reflectance", example.reflectance)
    reflectance = filled(example.reflectance, np.isfinite(example.reflectance))
    return np.clip(reflectance, 0, 1)


def given_physics(example: Example) -> Physics:
    """What was simulated of a scene.

    Raises:
        InputError: if there is nothing, or it is of another size or not finite.
    """
    if example.physics is None:
        rule = "must be given to a method that builds on it"
        raise errors.refuse("physics", rule, f"none for {example.scene}", "Simulate the scene.")
    for name in (field.name for field in dataclasses.fields(Physics) if field.name != "draws"):
        image = getattr(example.physics, name)
        check_size(example.info, f"physics {name}", image)
        missing = int(np.count_nonzero(~np.isfinite(image)))
        if missing and not name.endswith("_px"):
            found = f"{missing} pixels in {example.scene} that are not"
            raise errors.refuse(f"physics {name}", "must be finite", found, "Simulate again.")
    return example.physics


def physics_images(example: Example) -> dict[str, Image]:
    """What physics says, smoothed: sharp, its edges' places would be learnt by heart, which differ
    from scene to scene by the reference's registration.

    Returns:
        (h, w) each, by the names of `PHYSICS` and `REASONS`.

    Raises:
        InputError: as `given_physics`, or if nothing is known of the reference.
    """
    physics = given_physics(example)
    reference_px = example.info.disparity_px(example.depth_m)
    reference_px = filled(reference_px, np.isfinite(reference_px))
    told = physics_probability(physics)
    matched = np.isfinite(physics.disparity_px)
    error = np.where(matched, physics.disparity_px - reference_px, 0)
    found = {
        "logit": (np.log(told) - np.log1p(-told)) * np.float32(LOGIT_SCALE),
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
        for name, image in (found | reasons).items()
    }
