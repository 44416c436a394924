"""What the base itself scatters: its noise, and how far the best of all effects gains by chance."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.which.candidates import Arm
from starling.diagnosis.which.fit import fit
from starling.diagnosis.which.likelihood import TAU, Likelihood
from starling.diagnosis.which.response import Signature
from starling.diagnosis.which.table import Bench, Table
from starling.sim.effects.effect import Value
from starling.sim.statistics import mean_known

SEEDS = 8
FLOOR = 0.02  # What the simulator is taken to be wrong by in every feature, in its own unit.
_SPOT = "lens_blur"  # No model has its shape right: what it makes is wrong by a share.
_DEVICE = 10  # From which devices are counted.
_BESIDE = 1000  # From one seed to that of what it is compared with.
LEAST_GAIN = 12.0  # Below this no effect is believed, whatever the nulls say.


@dataclass(frozen=True, slots=True, eq=False)
class Base:
    """Features of the base under several seeds."""

    tables: NDArray[np.float64]  # (seeds, scenes, features); the first has the signatures' seed.
    floor: Table  # What the simulator is taken to be wrong by.
    # What a capture is compared with; None: the mean of the base.
    against: Table | None = None

    @property
    def mean(self) -> Table:
        """Mean over seeds."""
        return mean_known(self.tables, axis=0)

    @property
    def deviation(self) -> Table:
        """Deviation of a reading less what it is compared with, and of what the
        simulator misses.
        """
        seeds = len(self.tables)
        squares = mean_known((self.tables - self.mean) ** 2, axis=(0, 1))
        variance = squares * seeds / max(seeds - 1, 1)
        variance = variance * (1 + (1 / seeds if self.against is None else 1))
        return np.sqrt(np.nan_to_num(variance) + self.floor**2)

    def likelihood(self, real: Table, weight: NDArray[np.float64]) -> Likelihood:
        """Likelihood of a reading's gap."""
        gap = real - (self.mean if self.against is None else self.against)
        return Likelihood(gap, self.deviation, weight)

    def without(self, number: int) -> Base:
        """The base with one seed left out; where captures are compared the next stands for one."""
        following = self.tables[(number + 1) % len(self.tables)]
        return dataclasses.replace(
            self,
            tables=np.delete(self.tables, number, axis=0),
            against=None if self.against is None else following,
        )

    def drawn(self, simulated: Table) -> Base:
        """The base with a simulated reading for the captures that others are compared with."""
        return self if self.against is None else dataclasses.replace(self, against=simulated)


def base(bench: Bench, *, seeds: int = SEEDS) -> Base:
    """Simulate the base, or the noise of images that captures are compared with.

    How features of real images scatter no simulation tells: where the device has other dots than
    the sensor, one that looks for the sensor's is chance alone. Matching a real pair again draws
    nothing: there one table is all, unless the device's own matcher reads finer bits, which are
    drawn.
    """
    if bench.arm is Arm.DEPTH:
        again = bench.simulated({})
        assert again is not None
        drawn = range(seeds if bench.subjects[0].sensor.left.dropped_bits else 0)
        tables = [again + bench.finer(seed=number) for number in drawn] or [again]
        return _of(np.stack(tables), bench.against())
    against = bench.against()
    if against is not None and bench.arm is Arm.IMAGE:
        exposed = np.stack([bench.exposed(seed=number) for number in range(seeds)])
        return _of(exposed, against)
    if against is None:  # The real device is another one of the kind, and of none that effects had.
        others = [bench.another({}, number=_DEVICE + number) for number in range(1, seeds)]
    else:
        others = [bench.simulated({}, seed=number) for number in range(1, seeds)]
    found = [bench.simulated({}), *others]
    made = _of(np.stack([one for one in found if one is not None]), against)
    spotless = bench.change({_SPOT: 0.0})
    wrong = [] if spotless is None else [TAU * spotless]
    if against is None:  # Else both sides see the very scene.
        wrong += bench.otherwise()
    floor = made.floor
    for one in wrong:
        floor = np.hypot(floor, np.nan_to_num(one))
    return dataclasses.replace(made, floor=floor)


def another(
    bench: Bench, of: Base, settings: Mapping[str, Value], *, number: int
) -> tuple[Base, Table] | None:
    """What stands for a capture with effects in it, and the base that it is then compared with.

    It is another device's, as what is drawn by lot is each device's own; of one whose depth is
    compared with its own, that one's. What is laid onto captured images has their noise: both sides
    get one more exposure's. None where the effects cannot be set.

    Args:
        bench: scenes and arm.
        of: their base.
        settings: value by effect.
        number: of the device and of the noise's seed.
    """
    compared, arm = of.against is not None, bench.arm
    if arm is Arm.IMAGE or (arm is Arm.WHOLE and not compared):
        found = bench.another(settings, number=number)
    else:
        found = bench.simulated(settings, seed=number)
    if found is None:
        return None
    if arm is Arm.DEPTH and len(of.tables) > 1:
        found = found + bench.finer(seed=number)
    beside = of.tables[-1]
    if arm is Arm.WHOLE and compared:
        other = bench.simulated({}, seed=number + _BESIDE)
        assert other is not None
        beside = other
    if arm is Arm.IMAGE and of.against is not None:
        same = bench.another({}, number=number)
        assert same is not None
        found = found - same + bench.exposed(seed=number)
        beside = bench.exposed(seed=number + _BESIDE)
    return of.drawn(beside), found


def _of(tables: NDArray[np.float64], against: Table | None) -> Base:
    return Base(tables, np.full(tables.shape[1:], FLOOR), against)


def readings(of: Base) -> list[tuple[Base, Table]]:
    """Every reading of the base, and the base that others make; one that nothing scatters stands
    for both.
    """
    if len(of.tables) < 2:
        return [(of, of.tables[0])]
    return [(of.without(number), of.tables[number]) for number in range(len(of.tables))]


def gains(
    of: Base,
    signatures: Sequence[Signature],
    weight: NDArray[np.float64],
    folds: Sequence[NDArray[np.bool_]],
) -> NDArray[np.float64]:
    """Held-out gain of the best effect where there is none to find, for each seed left out."""
    found = []
    for base, reading in readings(of) if len(of.tables) > 1 else ():
        likelihood = base.likelihood(reading, weight)
        best = [fit(one, likelihood, folds).gain.sum() for one in signatures]
        found.append(max(best, default=0.0))
    return np.array(found)


def threshold(null_gains: NDArray[np.float64]) -> float:
    """The most that chance gained, at least `LEAST_GAIN`."""
    return max([LEAST_GAIN, *null_gains.tolist()])


def size(of: Base, weight: NDArray[np.float64]) -> float:
    """Largest size of a gap (`Likelihood.size`) that seeds alone make; 0 where nothing is drawn."""
    if len(of.tables) < 2:
        return 0.0
    each = [base.likelihood(reading, weight) for base, reading in readings(of)]
    return max(one.size(one.nothing) for one in each)
