"""Level of captured images over that of the base, before any effect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from starling.diagnosis.scenes.observation import SceneObservation, StereoObservation
from starling.diagnosis.scenes.scene_model import SceneModel

_LEAST_DN = 2.0  # Least level above black that counts in the base [DN].
_FEWEST = 100  # Least number of pixels of a scene.


def level_ratios(
    scenes: Sequence[SceneModel], base: Sequence[SceneObservation]
) -> dict[str, float]:
    """Compute the median ratio of captured to simulated level in each room.

    Levels count above black. Saturated pixels of either image do not count. Rooms without infrared
    or with too few pixels are left out.

    Args:
        scenes: scenes with their captures.
        base: simulated observations, or other captures of the scenes.
    """
    ratios: dict[str, list[float]] = {}
    for scene, simulated in zip(scenes, base, strict=True):
        if not isinstance(scene.real, StereoObservation):
            continue
        if not isinstance(simulated, StereoObservation):
            continue
        imager = scene.sensor.left
        ceiling = 2.0**imager.bit_depth - 1
        real_dn, base_dn = (
            pair.left.astype(np.float64).mean(axis=0) - imager.black_level_dn
            for pair in (scene.real, simulated)
        )
        unsaturated = np.maximum(real_dn, base_dn) + imager.black_level_dn < ceiling
        where = scene.strata.counted & unsaturated & (base_dn >= _LEAST_DN)
        if np.count_nonzero(where) >= _FEWEST:
            ratio = float(np.median(real_dn[where] / base_dn[where]))
            ratios.setdefault(scene.room, []).append(ratio)
    return {room: float(np.median(values)) for room, values in ratios.items()}
