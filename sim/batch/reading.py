"""A batch of depth images, corrupted on its device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from starling.patterns import errors
from starling.sim.batch import handoff, images, light, matching, refusals, result, rig
from starling.sim.batch.handoff import launch
from starling.sim.imaging.imager import electrons_per_radiance, noise
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.post.chain import LARGEST_CODE
from starling.sim.warp import depth_input, suspicions

wp: Any = handoff.import_warp()

SLICE_BYTES = 2 * 2**30  # Memory of the environments that are computed together.
_PIXEL_BYTES = 260  # Of images, for each pixel of an environment.
_VOLUME_BYTES = 4  # Of both volumes, for each pixel and disparity.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class BatchReading:
    """Readings of n environments, as torch tensors or Warp arrays on the device of the depth."""

    depth_m: Any  # (n, h, w) float32, NaN where missing.
    reason: Any  # (n, h, w) uint8, codes of `starling.Reason`; 0 if and only if there is depth.
    ir_left: Any  # (n, h, w) uint8; int32 of imagers with more than 8 bits.
    ir_right: Any  # Same.
    exposure_s: Any  # (n,) float32


@dataclass(frozen=True, slots=True, eq=False)
class BatchRig:
    """Constants of a sensor on a device."""

    sensor: Sensor
    device: Any
    light: rig.LightRig
    left: rig.SideRig
    right: rig.SideRig
    exposure: rig.ExposureRule
    matching: matching.MatchRig
    outcome: Any  # `result.Triangulation`

    def environments(self) -> int:
        """Return how many environments are computed together, at least 1."""
        sensor, margin = self.sensor, self.light.margin
        columns = _PIXEL_BYTES + 16 * margin / sensor.width
        columns += _VOLUME_BYTES * sensor.matcher.search_px
        return max(int(SLICE_BYTES / (columns * sensor.width * sensor.height)), 1)


def build(sensor: Sensor, scene: Scene, device: Any) -> BatchRig:
    """Copy the constants of a sensor to a Warp device, and warn of parts without dots."""
    matrix = np.array([[sensor.fx_px, 0, sensor.cx_px], [0, sensor.fy_px, sensor.cy_px], [0, 0, 1]])
    camera = depth_input.DepthCamera(matrix, (sensor.height, sensor.width))
    suspicions.warn_of_cameras(camera, sensor)
    return BatchRig(
        sensor=sensor,
        device=device,
        light=rig.light_rig(sensor, scene, device),
        left=rig.side_rig(sensor, "left", device),
        right=rig.side_rig(sensor, "right", device),
        exposure=rig.exposure_rule(sensor),
        matching=matching.match_rig(sensor.matcher, min(sensor.left.matched_bits, 10), device),
        outcome=_triangulation(sensor),
    )


def admit(depth: Any, sensor: Sensor, camera_matrix: np.ndarray[Any, Any]) -> Any:
    """Return depth images as a Warp array, or refuse them or the sensor.

    Raises:
        InputError: as `Corruptor.batch`.
    """
    clean = handoff.as_warp("depth", depth)
    if clean.ndim != 3 or clean.dtype != wp.float32 or not clean.shape[0]:
        rule = "must be (environments, height, width) float32, at least one"
        raise errors.refuse("depth", rule, f"{clean.shape} {clean.dtype.__name__}", "Reshape it.")
    camera = depth_input.DepthCamera(camera_matrix, tuple(clean.shape[1:]))
    refusals.refuse_unsupported(sensor, camera)
    return clean


def corrupt(
    depth: Any, reflectance: Any, constants: BatchRig, *, seed: int, frame: int
) -> BatchReading:
    """Corrupt depth images, slice by slice.

    Args:
        depth: torch tensor or Warp array that `admit` accepts.
        reflectance: None, a number, or an array; see `Corruptor.batch`.
        constants: those of the sensor on the device of `depth`.
        seed: seed of the capture.
        frame: number of the frame.
    """
    with handoff.stream_of(depth):
        clean = handoff.as_warp("depth", depth)
        shape, device = clean.shape, constants.device
        share = _share(reflectance, clean)
        code = wp.uint8 if constants.sensor.left.bit_depth == 8 else wp.int32
        out = BatchReading(
            depth_m=wp.empty(shape, dtype=float, device=device),
            reason=wp.empty(shape, dtype=wp.uint8, device=device),
            ir_left=wp.empty(shape, dtype=code, device=device),
            ir_right=wp.empty(shape, dtype=code, device=device),
            exposure_s=wp.empty(shape[0], dtype=float, device=device),
        )
        step = constants.environments()
        for first in range(0, shape[0], step):
            part = slice(first, min(first + step, shape[0]))
            outputs = {name: getattr(out, name)[part] for name in BatchReading.__slots__}
            known = share if isinstance(share, float) else share[part]
            draws = images.SliceDraws(seed, frame, first)
            _corrupt_slice(clean[part], known, constants, draws, BatchReading(**outputs))
        names = BatchReading.__slots__
        returned = {name: handoff.like(getattr(out, name), depth) for name in names}
    return BatchReading(**returned)


def _share(reflectance: Any, clean: Any) -> Any:
    """Return the reflectance as a number or an array (n, h, w), or refuse it."""
    if reflectance is None:
        return depth_input.REFLECTANCE
    if errors.is_number(reflectance):
        errors.in_interval("reflectance", reflectance, 0.0, 1.0)
        return float(reflectance)
    image = handoff.as_warp("reflectance", reflectance)
    shape = tuple(clean.shape)
    if image.dtype == wp.uint8 and image.shape == (*shape, 3):
        share = wp.empty(shape, dtype=float, device=clean.device)
        launch(light.fill_reflectance, shape, clean.device, image, share)
        return share
    if image.dtype != wp.float32 or image.shape != shape:
        rule = f"must be {shape} float32, or {(*shape, 3)} uint8 of RGB"
        got = f"{image.shape} {image.dtype.__name__}"
        raise errors.refuse("reflectance", rule, got, "Give one image for each environment.")
    return image


def _corrupt_slice(
    clean: Any, reflectance: Any, constants: BatchRig, draws: images.SliceDraws, out: BatchReading
) -> None:
    """Corrupt a slice of the environments into a slice of the results."""
    left, right = images.light_views(clean, reflectance, constants.light)
    formed_l = images.form(left, "left", constants.left, draws)
    formed_r = images.form(right, "right", constants.right, draws)
    time_s = out.exposure_s
    images.expose(formed_l, constants.exposure, time_s)
    codes_l = images.read_out(formed_l, time_s, "left", constants.left, draws, out.ir_left)
    codes_r = images.read_out(formed_r, time_s, "right", constants.right, draws, out.ir_right)
    accepted, reason = matching.match(codes_l.matched, codes_r.matched, constants.matching)
    wp.copy(out.reason, reason)
    surfaces = (accepted, left.disparity, right.disparity, left.lit)
    light = (formed_l.radiance, out.ir_left, time_s)
    results = (constants.outcome, out.depth_m, out.reason)
    launch(result.conclude, clean.shape, constants.device, *surfaces, *light, *results)


def _triangulation(sensor: Sensor) -> Any:
    """Numbers of the result; see `causes.photometric_causes`."""
    outcome, imager = result.Triangulation(), sensor.left
    unit_m = sensor.post.depth_unit_m
    outcome.focal_baseline = sensor.focal_baseline_px_m
    outcome.nearest = max(sensor.post.near_m, unit_m)
    outcome.farthest = min(sensor.post.far_m, LARGEST_CODE * unit_m)
    outcome.power = sensor.projector.power_w
    outcome.electrons = electrons_per_radiance(imager, sensor.projector.wavelength_nm, 1.0)
    outcome.dark = imager.dark_current_e_s
    outcome.shot, steady = noise.variances(imager)
    step_e = 1 / imager.dn_per_electron
    outcome.steady = steady + step_e * step_e / 12
    outcome.saturation = float(imager.saturation_dn)
    return outcome
