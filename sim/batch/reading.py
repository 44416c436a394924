"""A batch of depth images, corrupted on its device."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from starling.patterns import errors
from starling.sim import randomness
from starling.sim.batch import handoff, imaging, light, matching, refusals, result, rig
from starling.sim.imaging.imager import converter, electrons_per_radiance
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.post.chain import LARGEST_CODE
from starling.sim.warp import depth_input

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
    """Copy the constants of a sensor to a Warp device."""
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
            images = {name: getattr(out, name)[part] for name in BatchReading.__slots__}
            known = share if isinstance(share, float) else share[part]
            draws = _Draws(seed, frame, first)
            _corrupt_slice(clean[part], known, constants, draws, BatchReading(**images))
        returned = {name: handoff.like(getattr(out, name), depth) for name in images}
    return BatchReading(**returned)


@dataclass(frozen=True, slots=True)
class _Draws:
    """Random streams of the environments of a slice."""

    seed: int
    frame: int
    first: int  # Number of the slice's first environment.

    def stream(self, stage: str, effect: str, frame: int) -> int:
        """Seed of one effect, for Warp's generators; see `randomness.generator`."""
        words = [self.seed, frame, zlib.crc32(stage.encode()), zlib.crc32(effect.encode())]
        word = np.random.SeedSequence(words).generate_state(1)
        return int(word.view(np.int32)[0])


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
        arguments = [image, share]
        wp.launch(light.fill_reflectance, shape, inputs=arguments, device=clean.device)
        return share
    if image.dtype != wp.float32 or image.shape != shape:
        rule = f"must be {shape} float32, or {(*shape, 3)} uint8 of RGB"
        got = f"{image.shape} {image.dtype.__name__}"
        raise errors.refuse("reflectance", rule, got, "Give one image for each environment.")
    return image


@dataclass(frozen=True, slots=True, eq=False)
class _Surfaces:
    """Surfaces and light of one view, each (n, h, w)."""

    disparity: Any  # [px], 0 without a surface.
    reflectance: Any
    light: Any  # vec2, see `light.light_by_sky`.
    lit: Any


def _corrupt_slice(
    clean: Any, reflectance: Any, constants: BatchRig, draws: _Draws, out: BatchReading
) -> None:
    left, right = _light(clean, reflectance, constants)
    shape, device = clean.shape, constants.device
    sides = (
        ("left", constants.left, left, out.ir_left),
        ("right", constants.right, right, out.ir_right),
    )
    formed = [_form(part, surfaces, side, draws) for side, part, surfaces, _ in sides]
    rule, means = constants.exposure, formed[0][1]
    arguments = [means, rule.aim, rule.signal, rule.longest_s, out.exposure_s]
    wp.launch(imaging.expose, shape[0], inputs=arguments, device=device)
    codes = []
    for (side, part, _, delivered), (radiance, mean) in zip(sides, formed, strict=True):
        signal = wp.empty(shape, dtype=float, device=device)
        matched = wp.empty(shape, dtype=wp.uint16, device=device)
        seeds = (
            draws.stream("imager", f"noise {side}", draws.frame),
            draws.stream("imager", f"row {side}", draws.frame),
        )
        wp.launch(
            imaging.collect,
            shape,
            inputs=[radiance, mean, out.exposure_s, part.die, part.fixed, *seeds, draws.first],
            outputs=[signal],
            device=device,
        )
        wp.launch(
            imaging.digitise,
            shape,
            inputs=[signal, part.smoothing, part.die],
            outputs=[delivered, matched],
            device=device,
        )
        codes.append(matched)
    kept, reason = matching.match(*codes, constants.matching)
    wp.copy(out.reason, reason)
    wp.launch(
        result.conclude,
        shape,
        inputs=[
            kept,
            left.disparity,
            right.disparity,
            left.lit,
            formed[0][0],
            out.ir_left,
            out.exposure_s,
            constants.outcome,
        ],  # fmt: skip
        outputs=[out.depth_m, out.reason],
        device=device,
    )


def _light(clean: Any, reflectance: Any, constants: BatchRig) -> tuple[_Surfaces, _Surfaces]:
    """Light both views."""
    shape, device, setting = clean.shape, constants.device, constants.light
    views = []
    for _ in range(2):
        images = (wp.empty(shape, dtype=dtype, device=device) for dtype in (float, float, wp.vec2))
        views.append(_Surfaces(*images, lit=wp.zeros(shape, dtype=wp.uint8, device=device)))
    left, right = views
    arguments = [clean, setting.focal_baseline, left.disparity]
    wp.launch(light.fill_disparity, shape, inputs=arguments, device=device)
    if isinstance(reflectance, float):
        left.reflectance.fill_(min(reflectance * setting.reflectance_scale, 1.0))
    else:
        arguments = [reflectance, setting.reflectance_scale, left.reflectance]
        wp.launch(light.scale_reflectance, shape, inputs=arguments, device=device)
    seen = wp.zeros(shape, dtype=wp.uint64, device=device)
    wp.launch(light.see, shape, inputs=[left.disparity, 1.0, 0, seen], device=device)
    arguments = [seen, left.reflectance, right.disparity, right.reflectance]
    wp.launch(light.fill_right, shape, inputs=arguments, device=device)
    for view in views:
        arguments = [view.disparity, view.reflectance, setting.camera, setting.irradiance]
        arguments += [setting.gradient, setting.up, view.light]
        wp.launch(light.light_by_sky, shape, inputs=arguments, device=device)
    n, h, w = shape
    seen = wp.empty((n, h, w + 2 * setting.margin), dtype=wp.uint64, device=device)
    for beam, levels in setting.beams:
        seen.zero_()
        arguments = [left.disparity, beam.place, setting.margin, seen]
        wp.launch(light.see, shape, inputs=arguments, device=device)
        for place, view in enumerate(views):
            wp.launch(
                light.light_by_beam,
                shape,
                inputs=[
                    view.disparity,
                    view.reflectance,
                    setting.camera,
                    float(place),
                    beam,
                    levels,
                    seen,
                    setting.margin,
                    setting.power,
                ],  # fmt: skip
                outputs=[view.light, view.lit],
                device=device,
            )
    return left, right


def _form(part: rig.SideRig, surfaces: _Surfaces, side: str, draws: _Draws) -> tuple[Any, Any]:
    """Form an image: radiance (n, h, w), and its mean (n,)."""
    shape, device = surfaces.light.shape, surfaces.light.device
    n, h, w = shape
    levels = len(part.steps)
    blurred = wp.empty((levels, *shape), dtype=wp.vec2, device=device)
    for level in range(levels):
        arguments = [surfaces.light, part.weights, level, blurred]
        wp.launch(imaging.spread_rows, shape, inputs=arguments, device=device)
    normal = wp.empty((0, 0, 0), dtype=float, device=device)
    if len(part.quantiles):
        border = len(part.taps) - 1
        normal = wp.empty((n, h + border, w + border), dtype=float, device=device)
        seed = draws.stream("optics", f"speckle {side}", 0)
        arguments = [seed, draws.first, normal]
        wp.launch(imaging.draw_normal, normal.shape, inputs=arguments, device=device)
    radiance = wp.empty(shape, dtype=float, device=device)
    wp.launch(
        imaging.form,
        shape,
        inputs=[
            blurred,
            surfaces.disparity,
            part.weights,
            part.steps,
            part.spot,
            normal,
            part.taps,
            part.quantiles,
            part.shading,
        ],  # fmt: skip
        outputs=[radiance],
        device=device,
    )
    sums = wp.empty((n, h), dtype=wp.float64, device=device)
    means = wp.empty(n, dtype=float, device=device)
    wp.launch(imaging.sum_rows, (n, h), inputs=[radiance, sums], device=device)
    wp.launch(imaging.average, n, inputs=[sums, w, means], device=device)
    return radiance, means


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
    share = converter.variance_share(imager.smoothing_px)
    alone = imager.read_noise_e**2 + imager.dsnu_e**2
    along = imager.row_noise_e**2 + imager.column_noise_e**2
    outcome.shot = imager.shot_noise**2 * share * share
    step_e = 1 / imager.dn_per_electron
    outcome.steady = share * (share * alone + along) + step_e * step_e / 12
    outcome.saturation = float(imager.saturation_dn)
    return outcome
