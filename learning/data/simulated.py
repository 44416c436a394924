"""Simulation of a scene's holes: repeated draws of noise for one rendering."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from starling.learning.data.example import Image, Physics
from starling.patterns import errors
from starling.sim import simulate
from starling.sim.randomness import generator
from starling.sim.reason import Reason
from starling.sim.render.mitsuba_scene import MitsubaScene
from starling.sim.scene.scene import Scene
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot

_SAMPLES = 16  # Paths per coarse pixel of indirect light, if the scene has any.
_WINDOW_PX = 9  # Side of a matching window [px].
_DARKEST = 1e-3  # Least local mean in the contrast, relative to full scale.


def physics(
    scene: Scene | MitsubaScene,
    sensor: Sensor,
    *,
    draws: int,
    seed: int = 0,
    samples: int = _SAMPLES,
) -> Physics:
    """Simulate a scene with independent draws of noise and speckle.

    Args:
        scene: surfaces and reflectance as far as known.
        sensor: sensor with a projector and a matcher.
        draws: number of draws.
        seed: random seed, from which the seeds of the draws follow.
        samples: paths per coarse pixel of indirect light, which all draws share.

    Raises:
        InputError: see `starling.sim.simulate.simulate`; or if there is no draw.
    """
    errors.in_interval("draws", draws, 1, 10_000, "Simulate at least once.")
    stage = scene if isinstance(scene, MitsubaScene) else MitsubaScene(scene)
    seeds = generator(seed, 0, "learning", "draws").integers(2**53, size=draws).tolist()
    first = simulate.simulate(stage, sensor, seed=seeds[0], samples=samples)
    further = [
        simulate.expose(first.layers, stage.scene, sensor, seed=number) for number in seeds[1:]
    ]
    return summary([first, *further], sensor)


def summary(shots: Sequence[Shot], sensor: Sensor) -> Physics:
    """Summarise simulated shots of one scene with independent noise.

    Args:
        shots: at least one.
        sensor: sensor of the shots.
    """
    valid = np.stack([shot.depth.valid for shot in shots])
    matched = np.maximum(valid.sum(axis=0), 1)
    disparity = np.stack([shot.depth.disparity_px for shot in shots])
    total = np.where(valid, disparity, 0).sum(axis=0)
    first = np.take_along_axis(disparity, valid.argmax(axis=0)[None], axis=0)[0]
    black, ceiling = sensor.left.black_level_dn, sensor.left.ceiling_dn
    level = np.mean([shot.ir_left.astype(np.float32) for shot in shots], axis=0)
    infrared = np.clip((level - black) / (ceiling - black), 0, 1).astype(np.float32)
    return Physics(
        ndp=(1 - valid.mean(axis=0)).astype(np.float32),
        draws=len(shots),
        infrared=infrared,
        contrast=_contrast(infrared),
        disparity_px=np.where(valid.any(axis=0), total / matched, np.nan).astype(np.float32),
        one_draw_px=np.where(valid.any(axis=0), first, np.nan).astype(np.float32),
        one_draw_ndp=~valid[0],
        reason=_most_frequent(np.stack([shot.depth.reason for shot in shots])),
    )


def _contrast(infrared: Image) -> Image:
    """Local standard deviation over local mean, (h, w)."""
    window = (_WINDOW_PX, _WINDOW_PX)
    mean = cv2.blur(infrared, window)
    variance = cv2.sqrBoxFilter(infrared, cv2.CV_32F, window) - mean**2
    deviation = np.sqrt(np.maximum(variance, 0))
    return (deviation / np.maximum(mean, _DARKEST)).astype(np.float32)


def _most_frequent(reason: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Return the most frequent reason of no depth of (n, h, w); for ties, the first one."""
    winner = np.zeros(reason.shape[1:], np.uint32)
    most = np.zeros(reason.shape[1:], np.int64)
    for code in list(Reason)[1:]:  # The first reason means depth.
        times = np.count_nonzero(reason == code.value, axis=0)
        more = times > most
        winner[more], most[more] = code.value, times[more]
    return winner
