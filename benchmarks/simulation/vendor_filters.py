"""Compare librealsense's filters with ours on the same 16-bit depth images.

    python benchmarks/simulation/vendor_filters.py [$STARLING_CAPTURES/d415-faro]

Both get the depth codes of simulated scenes, and of the rooms of a capture set. The library filters
frames of a virtual device, in the order of its documentation. That is decimation, threshold, to
disparity, spatial, temporal, to depth, hole filling. The table lists the share of equal pixels over
all frames, and the largest difference in depth units. A room has one frame. Later frames get noise
of up to two depth units and random holes in 5 % of the pixels.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pyrealsense2 as rs
from numpy.typing import NDArray

import starling
from starling.realsense import DeviceImages, virtual_device
from starling.sim.captures.capture import open_set
from starling.sim.sensor.post import Post
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import sequence
from starling.sim.stereo.depth import (
    DepthMap,
    depth_from_disparity,
    disparity_from_depth,
    from_code,
    to_code,
)
from starling.sim.stereo.post import chain

Codes = NDArray[np.uint16]
SCENES = ("clutter:1", "clutter:2", "tabletop:1", "room:3")
FRAMES = 10  # The temporal filter remembers eight.
NOISE_UNITS, HOLES = 2, 0.05
PER_PX = 32  # librealsense's disparities per pixel.
_MODES = ("left", "farthest", "nearest")


def _spatial(alpha: float, delta: int, iterations: int, holes: int = 0) -> dict[str, Any]:
    return {
        "spatial_alpha": alpha,
        "spatial_delta_px": delta / PER_PX,
        "spatial_iterations": iterations,
        "spatial_holes": holes,
    }


def _temporal(alpha: float, delta: int, persistence: int) -> dict[str, Any]:
    return {
        "temporal_alpha": alpha,
        "temporal_delta_px": delta / PER_PX,
        "temporal_persistence": persistence,
    }


SETTINGS: dict[str, dict[str, Any]] = {
    **{f"decimation {side}": {"decimation": side} for side in range(2, 9)},
    **{
        f"spatial {alpha}, {delta}, {iterations}": _spatial(alpha, delta, iterations)
        for alpha, delta, iterations in ((0.5, 20, 2), (0.25, 50, 5), (0.7, 8, 1), (0.9, 1, 3))
    },
    **{f"spatial, holes {mode}": _spatial(0.5, 20, 2, mode) for mode in range(1, 6)},
    **{
        f"temporal {alpha}, {delta}, {mode}": _temporal(alpha, delta, mode)
        for alpha, delta, mode in (
            *((0.4, 20, mode) for mode in range(9)),
            *((0.1, 100, 8), (0.75, 4, 2)),
        )
    },
    **{f"hole filling, {mode}": {"hole_filling": mode} for mode in _MODES},
    **{
        f"threshold {near_m} to {far_m} m": {"near_m": near_m, "far_m": far_m}
        for near_m, far_m in ((0.3, 1.2), (0.7, 1.0), (1.1, 3.0))
    },
    "chain 2": {
        "decimation": 2,
        **{"near_m": 0.3, "far_m": 4.0, "hole_filling": "farthest"},
        **_spatial(0.5, 20, 2),
        **_temporal(0.4, 20, 3),
    },
    "chain 3": {
        "decimation": 3,
        **{"near_m": 0.3, "far_m": 4.0, "hole_filling": "nearest"},
        **_spatial(0.6, 10, 1, 2),
        **_temporal(0.2, 20, 7),
    },
}


def with_post(sensor: Sensor, settings: Mapping[str, Any]) -> Sensor:
    """The sensor, with these filters alone."""
    post = Post(depth_unit_m=sensor.post.depth_unit_m, **settings)
    return dataclasses.replace(sensor, post=post, colour=None)


def ours(codes: Sequence[Codes], sensor: Sensor) -> list[Codes]:
    """Filter depth codes as `starling.simulate` does."""
    unit_m = sensor.post.depth_unit_m
    geometry = {"focal_px": sensor.fx_px, "baseline_m": sensor.baseline_m}
    past, filtered = None, []
    for code in codes:
        disparity_px = disparity_from_depth(from_code(code, unit_m), **geometry)
        raw = DepthMap(
            disparity_px=disparity_px,
            depth_m=depth_from_disparity(disparity_px, **geometry),
            valid=code > 0,
            reason=np.where(code > 0, 0, 1).astype(np.uint32),
        )
        result = chain.process(raw, sensor, causes={}, past=past)
        past = result.history
        filtered.append(to_code(result.depth_m, unit_m))
    return filtered


def vendors(codes: Sequence[Codes], sensor: Sensor) -> list[Codes]:
    """Filter depth codes with librealsense; a decimated image is enlarged again."""
    infrared = np.zeros((sensor.height, sensor.width), np.uint8)
    images = [DeviceImages(depth_u16=code, ir_left=infrared) for code in codes]
    device, queue = virtual_device(sensor, images), rs.frame_queue(4 * len(images))
    blocks, filtered = _blocks(sensor.post), []
    device.start(queue)
    while device.push():
        frame = queue.wait_for_frame()
        while frame.get_profile().stream_type() != rs.stream.depth:
            frame = queue.wait_for_frame()
        for block in blocks:
            frame = block.process(frame)
        depth = np.asanyarray(frame.as_depth_frame().get_data())
        filtered.append(_enlarged(depth, sensor.post.decimation, infrared.shape))
    device.stop()
    return filtered


def _blocks(post: Post) -> list[Any]:
    """librealsense's filters for these settings, in its order."""
    blocks: list[Any] = []
    if post.decimation > 1:
        blocks.append(rs.decimation_filter(post.decimation))
    if post.near_m > 0:
        blocks.append(rs.threshold_filter(post.near_m, post.far_m))
    smoothing: list[Any] = []
    if post.spatial_alpha < 1:
        delta = post.spatial_delta_px * PER_PX
        smoothing.append(
            rs.spatial_filter(
                post.spatial_alpha, delta, post.spatial_iterations, post.spatial_holes
            )
        )
    if post.temporal_alpha < 1:
        delta = post.temporal_delta_px * PER_PX
        smoothing.append(rs.temporal_filter(post.temporal_alpha, delta, post.temporal_persistence))
    if smoothing:
        blocks += [rs.disparity_transform(True), *smoothing, rs.disparity_transform(False)]
    if post.hole_filling != "off":
        blocks.append(rs.hole_filling_filter(_MODES.index(post.hole_filling)))
    return blocks


def _enlarged(depth: Codes, side: int, shape: tuple[int, int]) -> Codes:
    """Repeat each pixel over its block; pixels outside complete blocks are 0."""
    rows, columns = shape[0] // side, shape[1] // side
    out = np.zeros(shape, np.uint16)
    large = depth[:rows, :columns].repeat(side, axis=0).repeat(side, axis=1)
    out[: rows * side, : columns * side] = large
    return out


def simulated(scene: str, sensor: Sensor, *, seed: int = 0, frames: int = FRAMES) -> list[Codes]:
    """Depth codes of successive frames of a scene."""
    unit_m = sensor.post.depth_unit_m
    shots = sequence(starling.load_scene(scene, sensor), sensor, frames=frames, seed=seed)
    return [to_code(shot.depth.depth_m, unit_m) for shot in shots]


def varied(code: Codes, frames: int = FRAMES) -> list[Codes]:
    """Frames with noise and random holes; the first is `code`."""
    rng = np.random.default_rng(0)
    result = [code]
    for _ in range(1, frames):
        noise = rng.integers(-NOISE_UNITS, NOISE_UNITS + 1, code.shape)
        seen = (code > 0) & (rng.random(code.shape) >= HOLES)
        result.append(np.where(seen, code + noise, 0).astype(np.uint16))
    return result


def captured(folder: str, scenes: int) -> Iterator[tuple[list[Codes], Sensor]]:
    """Depth codes of the first scenes of a capture set, with their sensor."""
    for scene in open_set(folder).scenes[:scenes]:
        depth_m = scene.frame(scene.frames[0]).depth_m
        if depth_m is not None:
            sensor = scene.info.geometry_into(starling.load_sensor(scene.info.sensor))
            yield varied(to_code(depth_m, scene.info.depth_unit_m)), sensor


def compare(codes: Sequence[Codes], sensor: Sensor) -> tuple[int, int, int]:
    """Return the number of different pixels, of all pixels, and the largest difference."""
    pairs = zip(ours(codes, sensor), vendors(codes, sensor), strict=True)
    differences = [np.abs(left.astype(int) - right) for left, right in pairs]
    unequal = sum(np.count_nonzero(difference) for difference in differences)
    return unequal, sum(part.size for part in differences), max(part.max() for part in differences)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("captures", nargs="?", help="folder of a capture set")
    parser.add_argument("--scenes", type=int, default=5, help="number of its scenes, the first")
    arguments = parser.parse_args()
    d435 = starling.load_sensor("d435")
    groups = {
        "simulated": [
            (simulated(scene, d435, seed=seed), d435) for seed, scene in enumerate(SCENES)
        ]
    }
    if arguments.captures:
        groups["real"] = list(captured(arguments.captures, arguments.scenes))
    heads = (f"equal, {name} | largest difference" for name in groups)
    print(f"| filter | {' | '.join(heads)} |\n|---{'|---' * 2 * len(groups)}|")
    for name, settings in SETTINGS.items():
        cells = []
        for scenes in groups.values():
            counts = [compare(codes, with_post(sensor, settings)) for codes, sensor in scenes]
            unequal, pixels, largest = (np.array(column) for column in zip(*counts, strict=True))
            share = 1 - unequal.sum() / pixels.sum()
            cells.append(f"{100 * share:.5f} % | {largest.max()}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
