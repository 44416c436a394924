"""A batch of depth images, corrupted on its device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from starling.sim.batch import batch_scene, handoff, images, matching, refusals, result, rig
from starling.sim.batch.batch_reading import BatchReading
from starling.sim.batch.batch_scene import BatchScene
from starling.sim.batch.dark_table import dark_table
from starling.sim.batch.handoff import launch
from starling.sim.geometry.pinhole import Pinhole
from starling.sim.imaging.imager import electrons_per_radiance, noise
from starling.sim.scene.scene import Ambient, Scene
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.depth import LARGEST_CODE
from starling.sim.stereo.matching import TEN_BITS
from starling.sim.warp import depth_input, suspicions

wp: Any = handoff.import_warp()

SLICE_BYTES = 2 * 2**30  # Memory of the environments that are computed together.
_PIXEL_BYTES = 276  # Of images, for each pixel of an environment.
_VOLUME_BYTES = 4  # Of both volumes, for each pixel and disparity.


@dataclass(frozen=True, slots=True, eq=False)
class BatchRig:
    """Constants of a sensor on a device."""

    sensor: Sensor
    ambient: Ambient
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
    matrix = Pinhole.from_camera(sensor).matrix
    camera = depth_input.InputCamera(matrix, (sensor.height, sensor.width))
    suspicions.warn_of_cameras(camera, sensor)
    bits = min(sensor.left.matched_bits, TEN_BITS.bit_length())
    return BatchRig(
        sensor=sensor,
        ambient=scene.ambient,
        device=device,
        light=rig.light_rig(sensor, scene, device),
        left=rig.side_rig(sensor, "left", device),
        right=rig.side_rig(sensor, "right", device),
        exposure=rig.exposure_rule(sensor),
        matching=matching.match_rig(sensor.matcher, bits, dark_table(sensor.left, bits), device),
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
        raise handoff.refusal("depth", rule, clean, "Reshape it.")
    camera = depth_input.InputCamera(camera_matrix, tuple(clean.shape[1:]))
    refusals.refuse_unsupported(sensor, camera)
    return clean


def corrupt(
    depth: Any, inputs: batch_scene.SceneArrays, constants: BatchRig, *, seed: int, frame: int
) -> BatchReading:
    """Corrupt depth images, slice by slice.

    Args:
        depth: torch tensor or Warp array that `admit` accepts.
        inputs: arguments without the depth; see `Corruptor.batch`.
        constants: those of the sensor on the device of `depth`.
        seed: seed of the capture.
        frame: number of the frame.
    """
    with handoff.stream_of(depth):
        clean = handoff.as_warp("depth", depth)
        shape, device = clean.shape, constants.device
        scene = batch_scene.build(clean, inputs, constants.ambient, constants.sensor)
        code = wp.uint8 if constants.sensor.left.bit_depth == 8 else wp.int32
        out = BatchReading(
            depth_m=wp.empty(shape, dtype=float, device=device),
            reason=wp.empty(shape, dtype=wp.uint8, device=device),
            ir_left=wp.empty(shape, dtype=code, device=device),
            ir_right=wp.empty(shape, dtype=code, device=device),
            exposure_s=wp.empty(shape[0], dtype=float, device=device),
            gain=wp.empty(shape[0], dtype=float, device=device),
        )
        step = constants.environments()
        for first in range(0, shape[0], step):
            part = slice(first, min(first + step, shape[0]))
            outputs = {name: getattr(out, name)[part] for name in BatchReading.__slots__}
            draws = images.SliceDraws(seed, frame, first)
            _corrupt_slice(scene.slice(part), constants, draws, BatchReading(**outputs))
        names = BatchReading.__slots__
        returned = {name: handoff.like(getattr(out, name), depth) for name in names}
    return BatchReading(**returned)


def _corrupt_slice(
    scene: BatchScene, constants: BatchRig, draws: images.SliceDraws, out: BatchReading
) -> None:
    """Corrupt a slice of the environments into a slice of the results."""
    left, right = images.light_views(scene, constants.light)
    formed_l = images.form(left, "left", constants.left, draws)
    formed_r = images.form(right, "right", constants.right, draws)
    exposures = images.Exposures(out.exposure_s, out.gain)
    images.expose(formed_l, constants.exposure, exposures)
    codes_l = images.read_out(formed_l, exposures, "left", constants.left, draws, out.ir_left)
    codes_r = images.read_out(formed_r, exposures, "right", constants.right, draws, out.ir_right)
    codes = (codes_l.matched, codes_r.matched)
    accepted, reason = matching.match(*codes, out.gain, constants.matching)
    wp.copy(out.reason, reason)
    surfaces = (accepted, left.disparity, right.disparity, left.lit)
    light = (formed_l.radiance, out.ir_left, out.exposure_s, out.gain)
    results = (constants.outcome, out.depth_m, out.reason)
    launch(result.conclude, scene.depth.shape, constants.device, *surfaces, *light, *results)


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
    outcome.shot, outcome.steady = noise.variances(imager)
    outcome.step, outcome.own_gain = 1 / (12 * imager.dn_per_electron**2), imager.gain
    outcome.saturation = float(imager.saturation_dn)
    return outcome
