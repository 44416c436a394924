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
from starling.diagnosis.scenes.observation import (
    DepthObservation,
    FullObservation,
    StereoObservation,
)
from starling.diagnosis.scenes.strata import Image, Strata

Features = dict[str, float]


def image_features(pairs: StereoObservation, strata: Strata, *, ceiling: float) -> Features:
    """Compute features of infrared images and of our matcher's disparity from them.

    Only features in time use all repeats; all others use the first one.

    Args:
        pairs: infrared images.
        strata: reference and bins of the scene.
        ceiling: largest code.
    """
    left, right = (images[0].astype(np.float32) for images in (pairs.left, pairs.right))
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
    features |= disparity.disparity_features(pairs.ours_px[0], strata)
    if len(pairs.left) > 1:
        features |= repeats.infrared_repeat_features(pairs.left, strata)
    return features


def depth_features(depth: DepthObservation, strata: Strata) -> Features:
    """Compute features of device depth.

    Args:
        depth: device depth.
        strata: reference and bins of the scene.
    """
    features = disparity.disparity_features(depth.device_px[0], strata)
    features |= surface.surface_features(depth.device_px[0], strata)
    if len(depth.device_px) > 1:
        features |= repeats.depth_repeat_features(depth.device_px, strata)
    return features


def matched_depth_features(full: FullObservation, strata: Strata, captured_px: Image) -> Features:
    """Compute features of device depth, also relative to our matcher's depth of the same images.

    Args:
        full: infrared images and device depth.
        strata: reference and bins of the scene.
        captured_px: (h, w) captured device disparity of these images.
    """
    device = full.device_px[0]
    features = depth_features(full, strata)
    features |= rematched.bias_features(device, full.ours_px[0], strata)
    return features | rematched.difference_features(device, captured_px, strata)


def _prefixed(prefix: str, features: Features) -> Features:
    return {f"{prefix} {name}": value for name, value in features.items()}
