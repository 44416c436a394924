"""Feature row of one scene in one pipeline segment, captured or simulated."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.features import observation as features
from starling.diagnosis.scenes.observation import SceneObservation
from starling.diagnosis.scenes.scene_model import SceneModel
from starling.diagnosis.which.candidates import Segment
from starling.patterns.errors import InputError
from starling.sim.effects.effect import Value

Row = NDArray[np.float64]  # (features,)

BITS = "dropped_bits"  # Effect: bits that the device's matcher reads and its images lack.


@dataclass(frozen=True, kw_only=True, slots=True)
class Columns:
    """Features of a table, the same for all scenes."""

    segment: Segment
    names: tuple[str, ...]
    ceiling: float  # Largest code [DN].


def base_features(scene: SceneModel, segment: Segment, ceiling: float) -> dict[str, float]:
    """Compute the features of one scene in a segment, simulated without effects."""
    return _features(segment, _simulate(scene, segment, {}, 0), scene, ceiling)


def simulated_row(
    scene: SceneModel, columns: Columns, settings: Mapping[str, Value], seed: int
) -> Row | None:
    """Simulate one scene; None if its sensor cannot have these values."""
    try:
        observation = _simulate(scene, columns.segment, settings, seed)
    except InputError:
        return None
    row = observation_row(observation, scene, columns)
    if columns.segment is Segment.DEPTH and BITS in settings:
        bits = {BITS: settings[BITS]}
        row += extra_bits_row(scene, columns, bits, seed) - extra_bits_row(scene, columns, {}, seed)
    return row


def device_row(
    scene: SceneModel, columns: Columns, settings: Mapping[str, Value], number: int
) -> Row | None:
    """Compute a row of `FeatureTable.simulate_device`."""
    return simulated_row(scene.with_device(number), columns, settings, number)


def estimate_row(scene: SceneModel, columns: Columns, number: int) -> Row | None:
    """Compute a row of `FeatureTable.estimate_changes`; the base's without such an estimate."""
    estimate = scene.with_estimate(number) if number < len(scene.estimates) else scene
    return simulated_row(estimate, columns, {}, 0)


def extra_bits_row(
    scene: SceneModel, columns: Columns, settings: Mapping[str, Value], seed: int
) -> Row:
    """Compute a row of `FeatureTable.extra_bits`."""
    return _less_rematched(scene.simulate_all(settings, seed=seed), scene, columns)


def reexposed_row(scene: SceneModel, columns: Columns, seed: int) -> Row:
    """Compute a row of `FeatureTable.reexposed`."""
    return observation_row(scene.reexpose(seed=seed), scene, columns)


def _simulate(
    scene: SceneModel, segment: Segment, settings: Mapping[str, Value], seed: int
) -> SceneObservation:
    """Simulate what a segment compares; the depth segment matches the captured images again."""
    if segment is Segment.DEPTH:
        return scene.rematch(settings)
    if segment is Segment.IMAGE:
        return scene.simulate(settings, seed=seed)
    return scene.simulate_depth(settings, seed=seed)


def observation_row(observation: SceneObservation, scene: SceneModel, columns: Columns) -> Row:
    """Compute the features of an observation, in the order of the columns."""
    return in_order(_features(columns.segment, observation, scene, columns.ceiling), columns)


def in_order(features: Mapping[str, float], columns: Columns) -> Row:
    """Arrange features in the order of the columns; NaN where a feature is missing."""
    return np.array([features.get(name, np.nan) for name in columns.names])


def against_row(observation: SceneObservation, scene: SceneModel, columns: Columns) -> Row:
    """Compute the row of a reference observation; in the depth segment less our matcher's."""
    if columns.segment is Segment.DEPTH:
        return _less_rematched(observation, scene, columns)
    return observation_row(observation, scene, columns)


def _less_rematched(observation: SceneObservation, scene: SceneModel, columns: Columns) -> Row:
    """Compute features of device depth less those of our matcher's depth of the same images."""
    device = dataclasses.replace(scene, real=observation)
    rematched = observation_row(device.rematch({}), device, columns)
    return observation_row(observation, device, columns) - rematched


def _features(
    segment: Segment, observation: SceneObservation, scene: SceneModel, ceiling: float
) -> dict[str, float]:
    if segment is Segment.IMAGE:
        return features.image_features(observation, scene.strata, ceiling=ceiling)
    device_px = scene.real.device_px if segment is Segment.DEPTH else None
    captured_px = None if device_px is None else device_px[0]
    return features.depth_features(observation, scene.strata, captured_px=captured_px)
