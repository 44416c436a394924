"""Null distribution: scatter of the base's features, and the gain of the best effect by chance."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.request import REFERENCE, Request, Source
from starling.diagnosis.which.candidates import Segment
from starling.diagnosis.which.fit import Folds, fit
from starling.diagnosis.which.likelihood import TAU, Likelihood
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.table import FeatureTable, Rows
from starling.sim.arrays import mean_known
from starling.sim.effects.effect import Value

SEEDS = 8
FLOOR = 0.02  # Model error of the simulator in every feature, in the feature's unit.
_SPOT = "lens_blur"  # No model has the exact shape of the spot: its effect has a model error.
_FIRST_DEVICE = 10  # Number of the first device of the base; smaller ones belong to signatures.
_REFERENCE_SEED = 1000  # Offset from the seed of a capture to that of its reference.
LEAST_GAIN = 12.0  # Least threshold of the gain, also if all null gains are smaller.


@dataclass(frozen=True, slots=True, eq=False)
class BaseSamples:
    """Features of the base under several noise seeds."""

    tables: NDArray[np.float64]  # (seeds, scenes, features); the first has the signatures' seed.
    floor: Rows  # Model error of the simulator (standard deviation).
    against: Rows | None = None  # Captured reference; None: the reference is the mean of the base.

    @property
    def mean(self) -> Rows:
        """Mean over seeds."""
        return mean_known(self.tables, axis=0)

    @property
    def deviation(self) -> Rows:
        """Standard deviation of a capture less its reference, model error included."""
        seeds = len(self.tables)
        squares = mean_known((self.tables - self.mean) ** 2, axis=(0, 1))
        variance = squares * seeds / max(seeds - 1, 1)
        variance = variance * (1 + (1 / seeds if self.against is None else 1))
        return np.sqrt(np.nan_to_num(variance) + self.floor**2)

    def likelihood(self, real: Rows, weight: NDArray[np.float64]) -> Likelihood:
        """Build the likelihood of a capture's gap."""
        gap = real - (self.mean if self.against is None else self.against)
        return Likelihood(gap, self.deviation, weight)

    def without(self, number: int) -> BaseSamples:
        """Leave out one seed; if there is a captured reference, the next seed replaces it."""
        following = self.tables[(number + 1) % len(self.tables)]
        return dataclasses.replace(
            self,
            tables=np.delete(self.tables, number, axis=0),
            against=None if self.against is None else following,
        )

    def with_reference(self, simulated: Rows) -> BaseSamples:
        """Replace the captured reference, if there is one, by a simulated one."""
        return self if self.against is None else dataclasses.replace(self, against=simulated)


def simulate_base(table: FeatureTable, *, seeds: int = SEEDS) -> BaseSamples:
    """Simulate the base under several seeds.

    If captured images are the reference, noise is added to these: a simulation does not show how
    features of real images scatter. For example, features that look for the sensor's dots are pure
    chance if the device has other dots. In the depth segment the captured images are matched again,
    which has no random part except in bits that only the device's matcher reads.
    """
    segment, compared = table.segment, table.compared
    base = table.request({})
    if segment is Segment.DEPTH:
        rematched = table.rows(base)
        drawn = range(seeds if table.scene_models[0].sensor.left.dropped_bits else 0)
        tables = [rematched + table.rows(_extra_bits(number)) for number in drawn]
        against = rematched + table.rows(REFERENCE) if compared else None
        return _samples(tables or [rematched], against)
    if compared and segment is Segment.IMAGE:
        exposed = [table.rows(_reexposed(number)) for number in range(seeds)]
        return _samples(exposed, table.rows(REFERENCE))
    further = [table.request({}, seed=number) for number in range(1, seeds)]
    if not compared:  # The real device differs from all devices of the signatures.
        numbers = range(_FIRST_DEVICE + 1, _FIRST_DEVICE + seeds)
        further = [table.request({}, seed=number, device=number) for number in numbers]
    tables = [table.rows(request) for request in (base, *further)]
    samples = _samples(tables, table.rows(REFERENCE) if compared else None)
    spotless = table.change({_SPOT: 0.0})
    errors = [] if spotless is None else [TAU * spotless]
    if not compared:  # A captured reference shows the same scene, without error.
        errors += estimate_changes(table)
    floor = samples.floor
    for error in errors:
        floor = np.hypot(floor, np.nan_to_num(error))
    return dataclasses.replace(samples, floor=floor)


def estimate_changes(table: FeatureTable) -> list[Rows]:
    """Compute the change by each alternative estimate of the scenes, with equal noise."""
    base = table.request({})
    count = max(len(scene.estimates) for scene in table.scene_models)
    estimates = [dataclasses.replace(base, estimate=number + 1) for number in range(count)]
    return [table.rows(request) - table.rows(base) for request in estimates]


def _extra_bits(seed: int) -> Request:
    """Request the bits that the device's matcher reads and its images lack."""
    return Request(source=Source.BOTH, seed=seed)


def _reexposed(seed: int) -> Request:
    return Request(source=Source.REEXPOSED, seed=seed)


def simulate_capture(
    table: FeatureTable, base: BaseSamples, settings: Mapping[str, Value], *, number: int
) -> tuple[BaseSamples, Rows]:
    """Simulate a capture with effects, and the base that it is compared with.

    The capture is of another device, because fixed-pattern noise and dead dots differ by device.
    Depth is compared within one device. If effects are transferred onto captured images, both sides
    get the noise of one more exposure.

    Args:
        table: feature table.
        base: samples of the base.
        settings: value by effect.
        number: number of the device, and seed of the noise.

    Raises:
        InputError: if the sensor cannot have these effects.
    """
    compared, segment = base.against is not None, table.segment
    of_device = segment is Segment.IMAGE or (segment is Segment.WHOLE and not compared)
    device = number if of_device else 0
    capture = table.rows(table.request(settings, seed=number, device=device))
    if segment is Segment.DEPTH and len(base.tables) > 1:
        capture = capture + table.rows(_extra_bits(number))
    reference = base.tables[-1]
    if segment is Segment.WHOLE and compared:
        reference = table.rows(table.request({}, seed=number + _REFERENCE_SEED))
    if segment is Segment.IMAGE and compared:
        without = table.rows(table.request({}, seed=number, device=device))
        capture = capture - without + table.rows(_reexposed(number))
        reference = table.rows(_reexposed(number + _REFERENCE_SEED))
    return base.with_reference(reference), capture


def _samples(tables: Sequence[Rows], against: Rows | None) -> BaseSamples:
    return BaseSamples(np.stack(tables), np.full(tables[0].shape, FLOOR), against)


def leave_one_out(samples: BaseSamples) -> list[tuple[BaseSamples, Rows]]:
    """List each sample with the base that the others make; a single sample is its own base."""
    if len(samples.tables) < 2:
        return [(samples, samples.tables[0])]
    return [
        (samples.without(number), samples.tables[number]) for number in range(len(samples.tables))
    ]


def null_gains(
    samples: BaseSamples,
    signatures: Sequence[Signature],
    weight: NDArray[np.float64],
    folds: Folds,
) -> NDArray[np.float64]:
    """Compute the held-out gain of the best effect where no effect acts, for each seed."""
    gains = []
    for base, capture in leave_one_out(samples) if len(samples.tables) > 1 else ():
        likelihood = base.likelihood(capture, weight)
        best = [fit(signature, likelihood, folds).gain.sum() for signature in signatures]
        gains.append(max(best, default=0.0))
    return np.array(gains)


def gain_threshold(gains: NDArray[np.float64]) -> float:
    """Return the largest null gain, but at least `LEAST_GAIN`."""
    return max([LEAST_GAIN, *gains.tolist()])


def noise_size(samples: BaseSamples, weight: NDArray[np.float64]) -> float:
    """Compute the largest size of a gap between seeds; 0 if nothing is random."""
    if len(samples.tables) < 2:
        return 0.0
    likelihoods = [base.likelihood(capture, weight) for base, capture in leave_one_out(samples)]
    return max(likelihood.size(likelihood.no_change) for likelihood in likelihoods)
