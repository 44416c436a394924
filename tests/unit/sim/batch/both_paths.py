"""A batch and the compiled path on equal surfaces, light and noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from starling.sim import simulate
from starling.sim.batch import batch_scene, handoff, images, reading
from starling.sim.causes import geometric_causes, photometric_causes
from starling.sim.corrupt import Corruptor
from starling.sim.imaging import imager
from starling.sim.sensor.sensor import Sensor
from starling.sim.stereo.measurement import measure
from tests.unit.sim.batch import steps

wp: Any = handoff.import_warp()

_ROUNDING_PX = 1e-4  # Of depth in single precision [px].
EQUAL_SHARE = 0.999  # Least share of equal masks and reasons.


def build(sensor: Sensor, effects: dict[str, float] | None = None) -> tuple[Corruptor, Any]:
    """The corruptor and its constants on the processor."""
    corruptor = Corruptor(sensor, steps.MATRIX, effects=effects or {})
    return corruptor, reading.build(corruptor.sensor, corruptor._scene, wp.get_device("cpu"))


def batched(inputs: dict[str, Any], count: int = 1) -> dict[str, Any]:
    """Arguments of `Corruptor.batch`: images as arrays of environments, others as they are."""
    return {
        name: wp.array(np.repeat(value[None], count, axis=0))
        if isinstance(value, np.ndarray)
        else value
        for name, value in inputs.items()
    }


def views(rig: Any, depth: Any, **inputs: Any) -> Any:
    """Both lit views of a batch."""
    light = batch_scene.SceneArrays(**batched(inputs))
    clean = wp.array(depth[None], dtype=float)
    scene = batch_scene.build(clean, light, rig.ambient, rig.sensor)
    return images.light_views(scene, rig.light)


def equal_shares(sensor: Sensor, **inputs: Any) -> tuple[float, float, float]:
    """Match the noisy infrared pair of the batch by both paths.

    Returns:
        Shares of pixels with the same reason, and, among those with depth, of depth within its unit
        and of disparity within the device's step.
    """
    corruptor, rig = build(sensor)
    depth = steps.depth_image()
    draws = images.SliceDraws(0, 0, 0)
    lit = views(rig, depth, **inputs)
    formed_l = images.form(lit[0], "left", rig.left, draws)
    formed_r = images.form(lit[1], "right", rig.right, draws)
    seen = corruptor.batch(wp.array(depth[None], dtype=float), **batched(inputs))
    exposures = images.Exposures(seen.exposure_s, seen.gain)
    codes_l = images.read_out(formed_l, exposures, "left", rig.left, draws, seen.ir_left)
    codes_r = images.read_out(formed_r, exposures, "right", rig.right, draws, seen.ir_right)
    compiled = corruptor.light(depth, **inputs)
    pair = simulate.infrared(compiled.layers, compiled.scene, sensor)
    sensor = imager.at_gain(sensor, pair.exposure)
    causes = geometric_causes(compiled.layers.truth, sensor) | photometric_causes(
        sensor.left,
        pair.electrons,
        codes_l.delivered.numpy()[0],
        exposure_s=pair.exposure.exposure_s,
    )
    left, right = codes_l.matched.numpy()[0], codes_r.matched.numpy()[0]
    expected = measure(left, right, sensor, causes=causes)
    reason, depth_m = seen.reason.numpy()[0], seen.depth_m.numpy()[0]
    both = expected.valid & np.isfinite(depth_m)
    off_m = np.abs(depth_m - expected.depth_m)[both]
    off_px = np.abs(sensor.focal_baseline_px_m / depth_m - expected.disparity_px)[both]
    step_px = sensor.matcher.refinement.quantum_px + _ROUNDING_PX
    return (
        float((reason == expected.reason).mean()),
        float((off_m <= sensor.post.depth_unit_m).mean()),
        float((off_px <= step_px).mean()),
    )
