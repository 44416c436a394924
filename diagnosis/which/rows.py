"""What one scene gives of an arm's features, simulated or captured."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.features import observation as features
from starling.diagnosis.scenes.observation import Reading
from starling.diagnosis.scenes.scene_model import Subject
from starling.diagnosis.which.candidates import Arm
from starling.patterns.errors import InputError
from starling.sim.effects.effect import Value

Row = NDArray[np.float64]  # (features,)

BITS = "dropped_bits"  # What a device's own depth differs by from its images' matched again.


@dataclass(frozen=True, kw_only=True, slots=True)
class Columns:
    """What is told of each scene, the same for all."""

    arm: Arm
    names: tuple[str, ...]
    ceiling: float  # Largest code.


def base_features(of: Subject, arm: Arm, ceiling: float) -> dict[str, float]:
    """Features that one scene has in an arm, simulated without effects."""
    return _features(arm, _simulated(of, arm, {}, 0), of, ceiling)


def simulated_row(
    of: Subject, columns: Columns, settings: Mapping[str, Value], seed: int
) -> Row | None:
    """Simulate one scene; None where its sensor cannot have these values."""
    try:
        reading = _simulated(of, columns.arm, settings, seed)
    except InputError:
        return None
    row = row_of(reading, of, columns)
    if columns.arm is Arm.DEPTH and BITS in settings:
        bits = {BITS: settings[BITS]}
        row += finer_row(of, columns, bits, seed) - finer_row(of, columns, {}, seed)
    return row


def another_row(
    of: Subject, columns: Columns, settings: Mapping[str, Value], number: int
) -> Row | None:
    """One scene's row of `Bench.another`."""
    return simulated_row(of.another(number), columns, settings, number)


def otherwise_row(of: Subject, columns: Columns, number: int) -> Row | None:
    """One scene's row of `Bench.otherwise`; the base's where it has no such estimate."""
    scene = of.otherwise(number) if number < len(of.estimates) else of
    return simulated_row(scene, columns, {}, 0)


def finer_row(of: Subject, columns: Columns, settings: Mapping[str, Value], seed: int) -> Row:
    """One scene's row of `Bench.finer`."""
    return _beside_ours(of.capture(settings, seed=seed), of, columns)


def exposed_row(of: Subject, columns: Columns, seed: int) -> Row:
    """One scene's row of `Bench.exposed`."""
    return row_of(of.expose_again(seed=seed), of, columns)


def _simulated(of: Subject, arm: Arm, settings: Mapping[str, Value], seed: int) -> Reading:
    if arm is Arm.DEPTH:
        return of.rematch(settings)
    if arm is Arm.IMAGE:
        return of.simulate(settings, seed=seed)
    return of.measure(settings, seed=seed)


def row_of(reading: Reading, subject: Subject, columns: Columns) -> Row:
    return in_order(_features(columns.arm, reading, subject, columns.ceiling), columns)


def in_order(features: Mapping[str, float], columns: Columns) -> Row:
    return np.array([features.get(name, np.nan) for name in columns.names])


def other_row(reading: Reading, subject: Subject, columns: Columns) -> Row:
    if columns.arm is Arm.DEPTH:
        return _beside_ours(reading, subject, columns)
    return row_of(reading, subject, columns)


def _beside_ours(reading: Reading, subject: Subject, columns: Columns) -> Row:
    """A device's depth less what our matcher makes of its images."""
    device = dataclasses.replace(subject, real=reading)
    return row_of(reading, device, columns) - row_of(device.rematch({}), device, columns)


def _features(arm: Arm, reading: Reading, subject: Subject, ceiling: float) -> dict[str, float]:
    if arm is Arm.IMAGE:
        return features.of_image(reading, subject.ground, ceiling=ceiling)
    device_px = subject.real.device_px if arm is Arm.DEPTH else None
    captured_px = None if device_px is None else device_px[0]
    return features.of_depth(reading, subject.ground, captured_px=captured_px)
