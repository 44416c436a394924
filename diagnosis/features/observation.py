"""All features of an observation, by pipeline segment."""

from __future__ import annotations

import numpy as np

from starling.diagnosis.features import (
    disparity,
    levels,
    rematched,
    repeats,
    residual,
    shifts,
    surface,
    texture,
)
from starling.diagnosis.scenes.observation import SceneObservation
from starling.diagnosis.scenes.strata import Image, Strata

Features = dict[str, float]


def image_features(observation: SceneObservation, strata: Strata, *, ceiling: float) -> Features:
    """Compute features of infrared images and of our matcher's disparity from them.

    Only features in time use all repeats; all others use the first one.

    Args:
        observation: observation with infrared images.
        strata: reference and bins of the scene.
        ceiling: largest code.
    """
    assert observation.left is not None and observation.right is not None
    assert observation.ours_px is not None
    left, right = (images[0].astype(np.float32) for images in (observation.left, observation.right))
    warped = shifts.warp_to_left(right, strata.disparity_px)
    features = levels.level_features(np.rint(left), strata, ceiling)
    features |= levels.code_features(left, strata.counted, ceiling)
    features |= _prefixed("right", levels.level_features(warped, strata, ceiling))
    features |= _prefixed("right", levels.code_features(right, np.ones(right.shape, bool), ceiling))
    features |= texture.texture_features(left, strata)
    features |= _prefixed("right", texture.texture_features(warped, strata, ("radius",)))
    features |= residual.residual_features(left, strata)
    features |= shifts.pair_shift_features(left, right, strata)
    features |= shifts.dot_shift_features(left, strata)
    features |= disparity.disparity_features(observation.ours_px[0], strata)
    if len(observation.left) > 1:
        features |= repeats.infrared_repeat_features(observation.left, strata)
    return features


def depth_features(
    observation: SceneObservation, strata: Strata, *, captured_px: Image | None
) -> Features:
    """Compute features of device depth; with images also relative to our matcher's depth.

    Args:
        observation: observation with device depth.
        strata: reference and bins of the scene.
        captured_px: (h, w) captured device disparity of these images; None without images.
    """
    assert observation.device_px is not None
    device = observation.device_px[0]
    features = disparity.disparity_features(device, strata)
    features |= surface.surface_features(device, strata)
    if captured_px is not None:
        assert observation.ours_px is not None
        features |= rematched.bias_features(device, observation.ours_px[0], strata)
        features |= rematched.difference_features(device, captured_px, strata)
    if len(observation.device_px) > 1:
        features |= repeats.depth_repeat_features(observation.device_px, strata)
    return features


def _prefixed(prefix: str, features: Features) -> Features:
    return {f"{prefix} {name}": value for name, value in features.items()}
