"""One half of the stage swap from its first screening to what it leaves unexplained."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.transfer import quantisation_step
from starling.diagnosis.which import null, residuals, search
from starling.diagnosis.which.candidates import Arm, Candidate, with_told
from starling.diagnosis.which.fit import fit, folds
from starling.diagnosis.which.likelihood import Likelihood, by_scene, total, weights
from starling.diagnosis.which.null import Base
from starling.diagnosis.which.response import Signature, signature
from starling.diagnosis.which.search import Search
from starling.diagnosis.which.strengths import coarse
from starling.diagnosis.which.table import Bench, Table
from starling.diagnosis.which.trial import Trial
from starling.sim.console import progress
from starling.sim.effects.effect import Value

# Size of what is left (`Likelihood.size`) above which something else is at work: what seeds alone
# make and this much, no more than the second or what seeds make; and a share of what there was, as
# no effect is simulated as it truly is.
BEYOND_NOISE, UNEXPLAINED = 0.35, 0.65
OF_BEFORE = {Arm.IMAGE: 0.04, Arm.DEPTH: 0.1, Arm.WHOLE: 0.04}  # Matchers are told of less well.
_TERRACED = "subpixel_steps"  # What leaves terraces in a device's own depth.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Screen:
    """What one arm's effects do to the scenes, whatever was captured of them."""

    base: Base
    rough: tuple[Signature, ...]  # Of few strengths.
    weight: NDArray[np.float64]  # (features,)
    folds: tuple[NDArray[np.bool_], ...]
    threshold: float  # Least gain of an effect.
    noise: float  # Largest size of a gap that seeds alone make.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Found:
    """What one arm says."""

    bench: Bench
    screen: Screen
    likelihood: Likelihood
    search: Search
    explained_below: float  # Size of what is left up to which nothing else is at work.
    lead: tuple[str, ...]  # Groups of features that stay unexplained, the worst first,
    varying: tuple[str, ...]  # and those that do in most scenes, but in each otherwise.

    @property
    def settings(self) -> dict[str, Value]:
        """Value by accepted effect."""
        return self.search.settings

    @property
    def sizes(self) -> tuple[float, float]:
        """Size of the gap, before and after."""
        before, after = (total(table, self.likelihood.weight) for table in self._tables())
        return before, after

    @property
    def beyond(self) -> float:
        """Size of what is left beyond what the accepted effects may be wrong by."""
        return total(self.search.beyond, self.likelihood.weight)

    @property
    def by_scene(self) -> dict[str, tuple[float, float]]:
        """Size of the gap in each scene, before and after."""
        names = [one.name for one in self.bench.subjects]
        sizes = [by_scene(table, self.likelihood.weight) for table in self._tables()]
        return {
            name: (float(before), float(after))
            for name, before, after in zip(names, *sizes, strict=True)
        }

    @property
    def by_group(self) -> dict[str, tuple[float, float]]:
        """What groups of features add to the gap's size, before and after; those first that add
        most before.
        """
        names, weight = self.bench.names, self.likelihood.weight
        before, after = (residuals.by_group(names, table, weight) for table in self._tables())
        return {name: (size, after[name]) for name, size in before.items()}

    @property
    def alike(self) -> dict[str, list[float]]:
        """What is left of features that are off the same way in every scene (see `left.alike`)."""
        return residuals.alike(self.bench.names, self.search.left, self.likelihood.weight)

    def _tables(self) -> tuple[Table, Table]:
        """The gap over its deviation (scenes, features), before and after."""
        return self.likelihood.left(self.likelihood.nothing), self.search.left

    @property
    def unexplained(self) -> bool:
        """Whether more is left than what is named leaves where it is true; not told where no effect
        was tried.
        """
        return bool(self.screen.rough) and self.beyond > self.explained_below


def screen(
    bench: Bench,
    candidates: Sequence[Candidate],
    *,
    always: bool = False,
    track: progress.Progress = progress.silent,
) -> Screen:
    """Simulate what may have acted.

    Args:
        bench: subjects and arm.
        candidates: all that may have acted.
        always: also matcher and filters where no feature is off, which cannot have acted.
        track: wraps loops that take long.
    """
    base = null.base(bench)
    if bench.arm is Arm.DEPTH and not always and _same(bench, base):
        candidates = ()
    candidates = told(candidates, bench)
    for one in candidates:
        for node in coarse(one):
            bench.begin({one.name: node})
    rough = tuple(
        made
        for one in track(candidates, f"effects on the {bench.arm.value}")
        if (made := signature(one, bench, coarse(one))) is not None
    )
    weight = weights(rough, base.deviation)
    held = folds([one.room for one in bench.subjects])
    return Screen(
        base=base,
        rough=rough,
        weight=weight,
        folds=tuple(held),
        threshold=null.threshold(null.gains(base, rough, weight, held)),
        noise=null.size(base, weight),
    )


def told(candidates: Sequence[Candidate], bench: Bench) -> list[Candidate]:
    """Candidates with what the captures tell of them by themselves, which is steps of disparity.

    Simulated terraces meet the device's own pixel by pixel nowhere but where their height is right
    to a thousandth.

    Args:
        candidates: of the bench's arm.
        bench: the subjects.
    """
    return [
        _with_step(one, bench) if one.name == _TERRACED and bench.arm is Arm.DEPTH else one
        for one in candidates
    ]


def _with_step(candidate: Candidate, bench: Bench) -> Candidate:
    own = [one.real.device_px for one in bench.subjects]
    step = quantisation_step.step_px([maps for maps in own if maps is not None])
    return candidate if step is None else with_told(candidate, step)


def of_families(screen: Screen, families: Collection[str]) -> Screen:
    """The same with fewer effects, as if no others were known: votes are shared by what these do.

    The threshold stays: what chance gains by the others, it might gain by these.

    Args:
        screen: of the whole table.
        families: that are tried.
    """
    kept = tuple(one for one in screen.rough if one.candidate.effect.family in families)
    if len(kept) == len(screen.rough):
        return screen
    weight = weights(kept, screen.base.deviation)
    noise = null.size(screen.base, weight)
    return dataclasses.replace(screen, rough=kept, weight=weight, noise=noise)


def _same(bench: Bench, base: Base) -> bool:
    """Whether no feature of any scene is off: then nothing has to be matched again."""
    likelihood = base.likelihood(bench.real(), np.ones(len(bench.names)))
    off = np.nan_to_num(likelihood.left(likelihood.nothing))
    return bool((np.abs(off) <= 1).all())


def diagnosed(bench: Bench, screen: Screen) -> Found:
    """Find the effects of one arm.

    Args:
        bench: subjects and arm.
        screen: of a bench with the same scenes, and in the arm of matcher and filters also the same
            captures.
    """
    likelihood = screen.base.likelihood(bench.real(), screen.weight)
    alone = sorted(
        (fit(one, likelihood, screen.folds) for one in screen.rough), key=lambda one: -one.total
    )
    closer = search.worth(alone, screen.threshold)
    before = likelihood.size(likelihood.nothing)
    most = max(screen.noise, min(screen.noise + BEYOND_NOISE, UNEXPLAINED))
    explained = most + OF_BEFORE[bench.arm] * before
    trial = Trial(
        bench=bench,
        likelihood=likelihood,
        folds=screen.folds,
        threshold=screen.threshold,
        explained_below=explained,
    )
    found = search.search(trial, closer if before > screen.noise else [], alone)
    alike, each = residuals.leads(bench.names, found.beyond)
    return Found(
        bench=bench,
        screen=screen,
        likelihood=likelihood,
        search=found,
        explained_below=explained,
        lead=alike,
        varying=each,
    )
