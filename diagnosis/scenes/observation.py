"""One observation of a scene: repeated infrared pairs and disparity maps, captured or simulated."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes import stability
from starling.diagnosis.transfer import dequantise
from starling.patterns.errors import refuse
from starling.sim.captures.capture import CapturedScene, Frame, GreyImage
from starling.sim.imaging.imager import converter
from starling.sim.imaging.imager.exposure import Exposure, read_exposure
from starling.sim.sensor.imager import BIT_DEPTHS, Imager
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo import measurement as measurement

if TYPE_CHECKING:  # Loads a compiler.
    from starling.sim.simulate import InfraredPair
    from starling.sim.stereo.memory import Memory

MOST_REPEATS = 50  # Read of a scene; a simulation renders as many, and keeps them in memory.
Images = NDArray[np.unsignedinteger]
Maps = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Repeats:
    """Notes on the repeats of a scene; arrays are (repeats, h, w)."""

    moved: bool = False  # Whether repeats differ by more than noise and flicker.
    exposures: tuple[Exposure, ...] = ()  # Of the first repeat; empty if the camera records none.
    unlit: bool = False  # Whether the pairs were captured with the projector off.

    def first_repeats(self, count: int) -> Self:
        """Keep the first `count` repeats."""
        arrays = {name: part for name, part in vars(self).items() if isinstance(part, np.ndarray)}
        return dataclasses.replace(self, **{name: part[:count] for name, part in arrays.items()})


@dataclass(frozen=True, kw_only=True, eq=False)
class StereoObservation(_Repeats):
    """Infrared pairs."""

    left: Images  # Infrared images [DN].
    right: Images
    ours_px: Maps  # Disparity by our matcher, first repeat only; NaN where invalid.

    @property
    def repeats(self) -> int:
        """Number of repeats."""
        return len(self.left)

    @property
    def depth_px(self) -> Maps:
        """Disparity by the device where it was captured, else by our matcher."""
        return self.ours_px

    @cached_property
    def levels(self) -> tuple[Maps, Maps]:
        """Left and right images, dequantised [DN] (see `transfer.dequantise`)."""
        left, right = (
            np.stack([dequantise.draw_levels(image) for image in images])
            for images in (self.left, self.right)
        )
        return left, right

    def with_depth(self, device_px: Maps) -> FullObservation:
        """Add or replace the device's disparity."""
        return FullObservation(**_contents(self, StereoObservation), device_px=device_px)


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthObservation(_Repeats):
    """Disparity maps of a device."""

    device_px: Maps  # Disparity by the device's own matcher; NaN where invalid.

    @property
    def repeats(self) -> int:
        """Number of repeats."""
        return len(self.device_px)

    @property
    def depth_px(self) -> Maps:
        """Disparity by the device."""
        return self.device_px


@dataclass(frozen=True, kw_only=True, eq=False)
class FullObservation(DepthObservation, StereoObservation):
    """Infrared pairs with the device's disparity."""

    @property
    def repeats(self) -> int:
        """Number of repeats."""
        return min(len(self.left), len(self.device_px))


SceneObservation = StereoObservation | DepthObservation  # A full one is both.
NOT_CAPTURED = DepthObservation(device_px=np.empty((0, 0, 0), np.float32))
Kind = TypeVar("Kind", StereoObservation, DepthObservation, FullObservation)


def expect(observation: SceneObservation, kind: type[Kind]) -> Kind:
    """Return an observation that holds what its caller needs.

    Raises:
        TypeError: if it does not.
    """
    if not isinstance(observation, kind):
        raise TypeError(f"{kind.__name__} is needed; got {type(observation).__name__}")
    return observation


def _contents(observation: _Repeats, kind: type[_Repeats]) -> dict[str, Any]:
    return {field.name: getattr(observation, field.name) for field in fields(kind)}


def read_observation(scene: CapturedScene, sensor: Sensor) -> SceneObservation:
    """Read the first repeats of a captured scene, and match its infrared pairs.

    If some repeats have both infrared and depth, only these are read. Features in time depend on
    the number of repeats, and depth is compared with the pair that it was computed from.

    Args:
        scene: scene of a capture set.
        sensor: sensor whose matcher is applied.

    Raises:
        InputError: as `CapturedScene.frame`, or if there is neither a pair nor depth.
    """
    frames = [scene.frame(number) for number in scene.frames[:MOST_REPEATS]]
    if frames[0].record.get("counts", "repeats") != "repeats":
        frames = frames[:1]  # Time steps differ in scene and noise; they are no repeats.
    unlit = [_unlit(frame) for frame in frames] if sensor.projector.power_w == 0 else []
    unlit = [frame for frame in unlit if frame.ir_left is not None and frame.ir_right is not None]
    frames, pairs, depths = _complete_frames(unlit or frames)
    if not frames:
        raise refuse(
            f"scene {scene.name}",
            "must hold infrared pairs or depth",
            "neither",
            "Leave it out, or capture one of them.",
        )
    exposure = read_exposure(frames[0].record)
    notes: dict[str, Any] = {
        "exposures": () if exposure is None else (exposure,),
        "unlit": bool(unlit),
    }
    if not pairs:
        device_px = _stack_disparity(scene, depths)
        moved = stability.depth_moved(device_px)
        return DepthObservation(device_px=device_px, moved=moved, **notes)
    left, right = (np.stack(images) for images in zip(*pairs, strict=True))
    ours_px = match_pairs(left[:1], right[:1], sensor)
    moved = stability.images_moved(left)
    stereo = StereoObservation(left=left, right=right, ours_px=ours_px, moved=moved, **notes)
    return stereo.with_depth(_stack_disparity(scene, depths)) if depths else stereo


def _stack_disparity(scene: CapturedScene, depths_m: Sequence[Maps]) -> Maps:
    return np.stack([scene.info.disparity_px(depth_m) for depth_m in depths_m])


def _unlit(frame: Frame) -> Frame:
    """Take the pair captured with the projector off; there is no depth for it."""
    left, right = frame.ir_left_off, frame.ir_right_off
    return dataclasses.replace(frame, ir_left=left, ir_right=right, depth_m=None)


def _complete_frames(
    frames: Sequence[Frame],
) -> tuple[list[Frame], list[tuple[GreyImage, GreyImage]], list[Maps]]:
    """Select frames with pair and depth, else with a pair, else with depth; return their data."""
    contents = [(frame, _pair(frame.ir_left, frame.ir_right), frame.depth_m) for frame in frames]
    both = [item for item in contents if item[1] is not None and item[2] is not None]
    paired = [item for item in contents if item[1] is not None]
    selected = both or paired or [item for item in contents if item[2] is not None]
    return (
        [frame for frame, _, _ in selected],
        [pair for _, pair, _ in selected if pair is not None],
        [depth for _, _, depth in selected if depth is not None],
    )


def _pair(left: GreyImage | None, right: GreyImage | None) -> tuple[GreyImage, GreyImage] | None:
    return None if left is None or right is None else (left, right)


def common_content(
    first: SceneObservation, second: SceneObservation
) -> tuple[SceneObservation, SceneObservation]:
    """Reduce two observations to what both hold: infrared, device depth, number of repeats.

    Raises:
        InputError: if they have nothing in common.
    """
    count = min(first.repeats, second.repeats)
    for kind in (FullObservation, StereoObservation, DepthObservation):
        if isinstance(first, kind) and isinstance(second, kind):
            first, second = (
                kind(**_contents(observation, kind)).first_repeats(count)
                for observation in (first, second)
            )
            return first, second
    raise refuse(
        "captures against others",
        "must both hold infrared pairs, or both depth",
        "one of each",
        "Capture the same of both.",
    )


def add_exposure_noise(
    observation: StereoObservation, sensor: Sensor, rng: np.random.Generator
) -> StereoObservation:
    """Add the temporal noise of one more exposure to an observation's infrared images.

    Args:
        observation: infrared images.
        sensor: sensor whose shot and read noise is drawn.
        rng: generator of the noise.
    """
    left = _noisier(observation.left, observation.levels[0], sensor.left, rng)
    right = _noisier(observation.right, observation.levels[1], sensor.right, rng)
    return dataclasses.replace(
        observation, left=left, right=right, ours_px=match_pairs(left[:1], right[:1], sensor)
    )


def _noisier(images: Images, levels: Maps, imager: Imager, rng: np.random.Generator) -> Images:
    """Add shot and read noise (photon transfer) to dequantised levels, and quantise again."""
    scale = imager.dn_per_electron
    signal = np.maximum(levels - imager.black_level_dn, 0.0)
    variance = imager.shot_noise**2 * scale * signal + (scale * imager.read_noise_e) ** 2
    noise = (np.sqrt(variance) * rng.standard_normal(images.shape)).astype(np.float32)
    averaged = np.stack([converter.smooth(field, imager.smoothing_px) for field in noise])
    codes = np.rint(levels + averaged)
    ceiling = max(2**imager.bit_depth - 1, int(images.max()))  # Images may have more bits.
    return np.clip(codes, 0, ceiling).astype(images.dtype)


def quantise_depth(disparity_px: Maps, sensor: Sensor) -> Maps:
    """Round disparity (n, h, w) as a device does that stores depth in whole units."""
    scale, unit = sensor.fx_px * sensor.baseline_m, sensor.post.depth_unit_m
    code = np.rint(scale / disparity_px / unit)
    return np.where(code >= 1, scale / (np.maximum(code, 1) * unit), np.nan).astype(np.float32)


def match_pairs(
    left: Images, right: Images, sensor: Sensor, *, memory: Memory | None = None
) -> Maps:
    """Match infrared pairs (n, h, w) at the bit depth of the output images.

    Args:
        left: left images [DN].
        right: right images [DN].
        sensor: sensor whose matcher is applied.
        memory: cache of matching costs, as `starling.sim.stereo.matching.match` takes it.

    Returns:
        (n, h, w) disparity [px] after post-processing and range limits; NaN where invalid.
    """
    return match_all_bits(left, right, without_extra_bits(sensor), memory=memory)


def without_extra_bits(sensor: Sensor) -> Sensor:
    """Make the matcher read images at the bit depth of the output."""
    return with_dropped_bits(sensor, 0)


def with_dropped_bits(sensor: Sensor, dropped: int) -> Sensor:
    """Set how many bits the matcher reads that the output images lack."""
    left, right = (
        dataclasses.replace(imager, dropped_bits=dropped) for imager in (sensor.left, sensor.right)
    )
    return dataclasses.replace(sensor, left=left, right=right)


def match_all_bits(
    left: Images, right: Images, sensor: Sensor, *, memory: Memory | None = None
) -> Maps:
    """Match infrared pairs (n, h, w) that have all bits that the device's matcher reads.

    If the images exceed the sensor's range, a larger bit depth is assumed.

    Returns:
        As `match_pairs`.
    """
    sensor = _deep_enough(sensor, max(int(left.max()), int(right.max())))
    return np.stack(
        [
            measurement.measure(
                left_image, right_image, sensor, causes={}, memory=memory
            ).disparity_px
            for left_image, right_image in zip(left, right, strict=True)
        ]
    )


def infrared_observation(sensor: Sensor, pairs: Sequence[InfraredPair]) -> StereoObservation:
    """Stack the output images of simulated pairs, and match them by our matcher."""
    left = np.stack([pair.left for pair in pairs])
    right = np.stack([pair.right for pair in pairs if pair.right is not None])
    ours_px = match_pairs(left[:1], right[:1], sensor)
    return StereoObservation(left=left, right=right, ours_px=ours_px)


def device_depth(sensor: Sensor, pairs: Sequence[InfraredPair]) -> Maps:
    """Match simulated pairs with all bits, and round depth to whole units."""
    left = np.stack([pair.matched_left for pair in pairs])
    right = np.stack([pair.matched_right for pair in pairs if pair.matched_right is not None])
    return quantise_depth(match_all_bits(left, right, sensor), sensor)


def _deep_enough(sensor: Sensor, largest: int) -> Sensor:
    """Raise the imagers' bit depth until `largest` [DN] fits."""
    if largest < 2**sensor.left.matched_bits:
        return sensor
    bits = next(depth for depth in BIT_DEPTHS if largest < 2**depth)
    left, right = (
        dataclasses.replace(imager, bit_depth=bits, dropped_bits=0)
        for imager in (sensor.left, sensor.right)
    )
    return dataclasses.replace(sensor, left=left, right=right)
