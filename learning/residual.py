"""Learned residual of a simulated reading: pixels without depth that the physics misses."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from starling.learning.commands.train_captures import trained
from starling.learning.data.example import Example
from starling.learning.data.physics import missed_probability, physics_probability
from starling.learning.data.simulated import summary
from starling.learning.method import Predictor
from starling.learning.sampling.sampling import TYPICAL, ndp
from starling.patterns import errors
from starling.sim.captures import writer
from starling.sim.reason import Reason
from starling.sim.sensor.sensor import Sensor
from starling.sim.simulate import Shot
from starling.sim.stereo.depth import DepthMap

_SHIPPED = {"hybrid": Path("hybrid-varied")}


@dataclass(frozen=True, slots=True, eq=False)
class LearnedHoles:
    """Removes depth from simulated readings as a trained model predicts it.

    A model that ignores the physics predicts all holes of the device. Simulated holes stay, and
    further pixels lose depth where the model is above the physics.
    """

    predictor: Predictor

    def __call__(self, shot: Shot, sensor: Sensor, *, seed: int = 0, frame: int = 0) -> DepthMap:
        """Return the depth of a reading with further pixels without depth.

        Their reason is UNKNOWN, because the model gives none. No depth is added.

        Args:
            shot: reading of the sensor.
            sensor: its sensor.
            seed: seed of the pixels.
            frame: time; pixels of nearby frames are correlated.

        Raises:
            InputError: if the sensor shrinks its depth.
        """
        if sensor.post.decimation != 1:
            advice = "Decimate after the residual."
            raise errors.refuse(
                "post.decimation", "must be 1 with a residual", sensor.post.decimation, advice
            )
        physics = summary([shot], sensor)
        example = Example(
            scene="depth image",
            room="depth image",
            info=writer.info_of(sensor, source="corrupt", licence="as the image's", notes=""),
            depth_m=shot.layers.truth.depth_m,
            reflectance=np.clip(shot.layers.left.ambient * np.float32(np.pi), 0, 1),
            physics=physics,
        )
        probability = self.predictor.probability(example)
        missed = missed_probability(probability, physics_probability(physics))
        added = ndp(missed, TYPICAL, seed=seed, frame=frame) & shot.depth.valid
        return dataclasses.replace(
            shot.depth,
            disparity_px=np.where(added, np.float32(np.nan), shot.depth.disparity_px),
            depth_m=np.where(added, np.float32(np.nan), shot.depth.depth_m),
            valid=shot.depth.valid & ~added,
            reason=np.where(added, np.uint32(Reason.UNKNOWN), shot.depth.reason),
        )


def load(model: Path | str) -> LearnedHoles:
    """Load a residual.

    Args:
        model: `hybrid`, the shipped model, or a folder of `starling train`.

    Raises:
        InputError: if there is no such model.
    """
    return LearnedHoles(trained(_SHIPPED.get(str(model), Path(model)))[1])
