"""What a camera gave of one scene, real or simulated, and what our matcher makes of its images."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes import stability as moved
from starling.diagnosis.transfer import dequantise
from starling.patterns.errors import refuse
from starling.sim.captures.capture import CapturedScene, Frame, GreyImage
from starling.sim.imaging.imager import smoothing
from starling.sim.imaging.imager.exposure import Exposure, recorded
from starling.sim.sensor.imager import BIT_DEPTHS, Imager
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo import measurement as measurement

if TYPE_CHECKING:  # Loads a compiler.
    from starling.sim.stereo.memory import Memory

Images = NDArray[np.unsignedinteger]
Maps = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """Repeats of one scene; (n, h, w) each."""

    left: Images | None  # Infrared codes; None where only depth was captured.
    right: Images | None
    ours_px: Maps | None  # Disparity by our matcher, of the first repeat; NaN where there is none.
    device_px: Maps | None  # Disparity by the device's own depth; NaN likewise.
    moved: bool = False  # Whether repeats differ by more than noise and how much light there is.
    exposure: Exposure | None = None  # That the camera recorded for the first repeat.
    unlit: bool = False  # Whether these are pairs captured beside others with the projector off.

    @property
    def depth_px(self) -> Maps:
        """Disparity by the device's own depth where there is any, else by our matcher."""
        maps = self.ours_px if self.device_px is None else self.device_px
        assert maps is not None
        return maps

    @cached_property
    def levels(self) -> tuple[Maps, Maps]:
        """What left and right codes may have been rounded from, as of `within_codes`."""
        assert self.left is not None and self.right is not None
        left, right = (
            np.stack([dequantise.levels(one) for one in images])
            for images in (self.left, self.right)
        )
        return left, right

    def first(self, count: int) -> Reading:
        """The first repeats alone.

        Args:
            count: how many.
        """
        return dataclasses.replace(
            self,
            left=None if self.left is None else self.left[:count],
            right=None if self.right is None else self.right[:count],
            device_px=None if self.device_px is None else self.device_px[:count],
        )

    @property
    def repeats(self) -> int:
        """How many there are."""
        return min(len(one) for one in (self.left, self.device_px) if one is not None)


def read(scene: CapturedScene, sensor: Sensor) -> Reading:
    """Read the repeats of a captured scene, and match its infrared pairs.

    Repeats are taken that have both infrared and depth, if any has: what they tell depends on their
    number, and depth is compared with what its own pair gives.

    Args:
        scene: of a capture set.
        sensor: whose matcher is taken.

    Raises:
        InputError: as `CapturedScene.frame`, or if there is neither a pair nor depth.
    """
    frames = [scene.frame(number) for number in scene.frames]
    if frames[0].record.get("counts", "repeats") != "repeats":
        frames = frames[:1]  # Steps of time, whose noise and scene are each their own.
    unlit = [_unlit(one) for one in frames] if sensor.projector.power_w == 0 else []
    unlit = [one for one in unlit if one.ir_left is not None and one.ir_right is not None]
    frames, pairs, depths = _told(unlit or frames)
    if not frames:
        raise refuse(
            f"scene {scene.name}",
            "must hold infrared pairs or depth",
            "neither",
            "Leave it out, or capture one of them.",
        )
    left = np.stack([one for one, _ in pairs]) if pairs else None
    right = np.stack([other for _, other in pairs]) if pairs else None
    device = np.stack([scene.info.disparity_px(one) for one in depths]) if depths else None
    return Reading(
        left=left,
        right=right,
        ours_px=None if left is None or right is None else matched(left[:1], right[:1], sensor),
        device_px=device,
        moved=_shaken(left, device),
        exposure=recorded(frames[0].record),
        unlit=bool(unlit),
    )


def _unlit(frame: Frame) -> Frame:
    """What was captured with the projector off, of which no depth tells."""
    left, right = frame.ir_left_off, frame.ir_right_off
    return dataclasses.replace(frame, ir_left=left, ir_right=right, depth_m=None)


def _told(
    frames: Sequence[Frame],
) -> tuple[list[Frame], list[tuple[GreyImage, GreyImage]], list[Maps]]:
    """Frames that tell, with their infrared pairs and depths."""
    each = [(frame, _pair(frame.ir_left, frame.ir_right), frame.depth_m) for frame in frames]
    both = [one for one in each if one[1] is not None and one[2] is not None]
    paired = [one for one in each if one[1] is not None]
    told = both or paired or [one for one in each if one[2] is not None]
    return (
        [frame for frame, _, _ in told],
        [pair for _, pair, _ in told if pair is not None],
        [depth for _, _, depth in told if depth is not None],
    )


def _pair(left: GreyImage | None, right: GreyImage | None) -> tuple[GreyImage, GreyImage] | None:
    return None if left is None or right is None else (left, right)


def _shaken(left: Images | None, device_px: Maps | None) -> bool:
    """Whether something moved; images tell it better than depth."""
    if left is not None:
        return moved.images(left)
    return device_px is not None and moved.depth(device_px)


def alike(one: Reading, other: Reading) -> tuple[Reading, Reading]:
    """Leave of two readings what both hold: infrared, depth of the device's own, or both, and of
    repeats as many.

    Raises:
        InputError: if they have nothing in common.
    """
    paired = one.left is not None and other.left is not None
    measured = one.device_px is not None and other.device_px is not None
    if not paired and not measured:
        raise refuse(
            "captures against others",
            "must both hold infrared pairs, or both depth",
            "one of each",
            "Capture the same of both.",
        )
    count = min(one.repeats, other.repeats)
    first, second = (
        dataclasses.replace(
            each,
            left=each.left if paired else None,
            right=each.right if paired else None,
            ours_px=each.ours_px if paired else None,
            device_px=each.device_px if measured else None,
        )
        for each in (one.first(count), other.first(count))
    )
    return first, second


def exposed_again(of: Reading, sensor: Sensor, rng: np.random.Generator) -> Reading:
    """Add the noise of one more exposure to a reading's infrared, as photon transfer has it.

    Args:
        of: with infrared.
        sensor: whose noise it is.
        rng: draws it.
    """
    assert of.left is not None and of.right is not None
    left = _noisier(of.left, of.levels[0], sensor.left, rng)
    right = _noisier(of.right, of.levels[1], sensor.right, rng)
    return dataclasses.replace(
        of, left=left, right=right, ours_px=matched(left[:1], right[:1], sensor)
    )


def _noisier(images: Images, levels: Maps, imager: Imager, rng: np.random.Generator) -> Images:
    scale = imager.dn_per_electron
    signal = np.maximum(levels - imager.black_level_dn, 0.0)
    variance = imager.shot_noise**2 * scale * signal + (scale * imager.read_noise_e) ** 2
    noise = (np.sqrt(variance) * rng.standard_normal(images.shape)).astype(np.float32)
    averaged = np.stack([smoothing.smoothed(one, imager.smoothing_px) for one in noise])
    codes = np.rint(levels + averaged)
    ceiling = max(2**imager.bit_depth - 1, int(images.max()))  # Images may have more bits.
    return np.clip(codes, 0, ceiling).astype(images.dtype)


def written(disparity_px: Maps, sensor: Sensor) -> Maps:
    """Disparity (n, h, w) as a device gives it: by way of depth in whole units."""
    scale, unit = sensor.fx_px * sensor.baseline_m, sensor.post.depth_unit_m
    code = np.rint(scale / disparity_px / unit)
    return np.where(code >= 1, scale / (np.maximum(code, 1) * unit), np.nan).astype(np.float32)


def matched(left: Images, right: Images, sensor: Sensor, *, memory: Memory | None = None) -> Maps:
    """Match infrared pairs (n, h, w) as they are captured, without finer bits.

    Args:
        left, right: the pairs.
        sensor: whose matcher it is.
        memory: as `starling.sim.stereo.matching.match`.

    Returns:
        (n, h, w) disparity [px], post-processing and range included; NaN where there is none.
    """
    return measured(left, right, as_captured(sensor), memory=memory)


def as_captured(sensor: Sensor) -> Sensor:
    """The sensor whose matcher reads the images as they are captured, without finer bits."""
    return with_bits(sensor, 0)


def with_bits(sensor: Sensor, dropped: int) -> Sensor:
    """The sensor whose converters have so many bits more than its images."""
    left, right = (
        dataclasses.replace(imager, dropped_bits=dropped) for imager in (sensor.left, sensor.right)
    )
    return dataclasses.replace(sensor, left=left, right=right)


def measured(left: Images, right: Images, sensor: Sensor, *, memory: Memory | None = None) -> Maps:
    """Match infrared pairs (n, h, w) with all the bits that the device's own matcher reads.

    Images of more bits than the sensor has are of another converter, and read as such.

    Returns:
        As `matched`.
    """
    sensor = _deep_enough(sensor, max(int(left.max()), int(right.max())))
    return np.stack(
        [
            measurement.measure(one, other, sensor, causes={}, memory=memory).disparity_px
            for one, other in zip(left, right, strict=True)
        ]
    )


def _deep_enough(sensor: Sensor, most: int) -> Sensor:
    """The sensor with imagers that can put out a code."""
    if most < 2**sensor.left.matched_bits:
        return sensor
    bits = next(depth for depth in BIT_DEPTHS if most < 2**depth)
    left, right = (
        dataclasses.replace(imager, bit_depth=bits, dropped_bits=0)
        for imager in (sensor.left, sensor.right)
    )
    return dataclasses.replace(sensor, left=left, right=right)
