"""Images of a recorded frame in the form that capture sets hold."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from starling.patterns import errors
from starling.sim.captures.png import GreyImage
from starling.sim.captures.recordings.recording import RecordedFrame
from starling.sim.captures.recordings.rectification import Rectification
from starling.sim.stereo.depth import to_code

_LARGEST_CODE = 2**16 - 1
_STEPS_M = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)  # Of floating-point depth, the finest first.
_INFRARED = ("left", "right", "left_off", "right_off")
_DEPTHS = ("depth", "truth")


def read(
    frame: RecordedFrame, shape: tuple[int, int], place: str, maps: Rectification | None
) -> dict[str, NDArray[Any]]:
    """Read all images of a frame.

    Args:
        frame: the frame.
        shape: size (h, w) of all images but the colour image.
        place: name of the frame in error messages.
        maps: rectifies the pair; depth is left out then, as its view is the device's own.

    Raises:
        InputError: if an image has another size or type.
        LostMessageError: if an image is damaged in a bag.
    """
    images: dict[str, NDArray[Any]] = {}
    for name, read_image in frame.images.items():
        if maps is not None and name == "depth":
            continue
        image = read_image()
        if name == "colour":
            images[name] = _colour(image, f"{name} of {place}")
            continue
        image = _single(image, f"{name} of {place}")
        if image.shape != shape:
            rule = f"must be {shape[1]}x{shape[0]} as the left image"
            got = f"{image.shape[1]}x{image.shape[0]}"
            advice = "Record all streams at one size; depth in the left view."
            raise errors.refuse(f"{name} of {place}", rule, got, advice)
        if name in _INFRARED:
            image = _infrared(image, f"{name} of {place}")
            if maps is not None:
                image = (maps.right if name.startswith("right") else maps.left)(image)
        images[name] = image
    for first, second in (("left", "right"), ("left_off", "right_off")):
        pair = [images[name].dtype for name in (first, second) if name in images]
        if len(set(pair)) > 1:
            rule = "must have left and right of one bit depth"
            got = f"{pair[0]} and {pair[1]}"
            raise errors.refuse(place, rule, got, "Save both alike.")
    return images


def _single(image: NDArray[Any], name: str) -> NDArray[Any]:
    """Return one channel of an image whose channels are equal."""
    if image.ndim == 2:
        return image
    if image.shape[2] < 3 or not all(np.array_equal(image[..., 0], image[..., n]) for n in (1, 2)):
        rule, advice = "must be grey", "Give the infrared stream, or --colour for this one."
        raise errors.refuse(name, rule, "a colour image", advice)
    return np.ascontiguousarray(image[..., 0])


def _infrared(image: NDArray[Any], name: str) -> GreyImage:
    if image.dtype not in (np.uint8, np.uint16):
        advice = "Save the camera's own codes."
        raise errors.refuse(name, "must be of 8 or 16 bits", image.dtype, advice)
    return image


def _colour(image: NDArray[Any], name: str) -> NDArray[np.uint8]:
    """Return an image of 8 bits with three channels."""
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.dtype != np.uint8:
        raise errors.refuse(name, "must be of 8 or 16 bits", image.dtype, "Save codes, sRGB.")
    return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image


def depth_step_m(
    largest: Mapping[str, float], unit_m: float, *, is_float: bool, stated_m: float | None
) -> float:
    """Return the step of the 16-bit codes [m] that depth is written in.

    Args:
        largest: largest values of each stream of depth.
        unit_m: unit of the values [m].
        is_float: whether they are floating-point numbers; whole ones are kept as codes.
        stated_m: step that floating-point depth had.

    Raises:
        InputError: if whole numbers exceed 16 bits, or depth exceeds the coarsest step.
    """
    if not is_float:
        for name, value in largest.items():
            _refuse_wide(name, value)
        return unit_m
    farthest_m = max(largest.values(), default=0.0) * unit_m
    if stated_m is not None and farthest_m <= _LARGEST_CODE * stated_m:
        return stated_m
    for step_m in _STEPS_M:
        if farthest_m <= _LARGEST_CODE * step_m:
            return step_m
    rule = f"must be below {_LARGEST_CODE * _STEPS_M[-1]:g} m"
    advice = "Is its unit right? Give --depth-unit."
    raise errors.refuse("depth", rule, f"{farthest_m:.4g} m", advice)


def _refuse_wide(name: str, value: float) -> None:
    if value > _LARGEST_CODE:
        rule = f"must be at most {_LARGEST_CODE}, 16 bits"
        raise errors.refuse(name, rule, f"{value:g}", "Is it depth? Save it in mm.")


def largest_depth(image: NDArray[Any]) -> float:
    """Return the largest finite value of a depth image; 0 without any."""
    known = image[np.isfinite(image)] if image.dtype.kind == "f" else image
    return float(known.max()) if known.size else 0.0


def codes(image: NDArray[Any], unit_m: float, step_m: float) -> NDArray[np.uint16]:
    """Return depth as codes; 0, negative and unknown depth is none.

    Raises:
        InputError: if whole numbers exceed 16 bits.
    """
    if image.dtype.kind in "iu" and unit_m == step_m:
        _refuse_wide("depth", largest_depth(image))
        return np.clip(image, 0, None).astype(np.uint16)
    with np.errstate(invalid="ignore"):
        return to_code(image.astype(np.float64) * unit_m, step_m)
