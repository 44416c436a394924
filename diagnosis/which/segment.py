"""Diagnosis of one pipeline segment, from the screening of candidates to the unexplained rest."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from starling.diagnosis.scenes.observation import DepthObservation, expect
from starling.diagnosis.scenes.request import CAPTURED
from starling.diagnosis.scenes.shelf import Derived
from starling.diagnosis.transfer import quantisation_step
from starling.diagnosis.which import null, residuals
from starling.diagnosis.which.candidates import Candidate, Segment, with_measured_node
from starling.diagnosis.which.discrepancy import gains_beyond_makes
from starling.diagnosis.which.fit import Fit, fit, room_folds
from starling.diagnosis.which.likelihood import (
    Likelihood,
    feature_weights,
    size_by_scene,
    total_size,
)
from starling.diagnosis.which.model import SearchContext
from starling.diagnosis.which.null import BaseSamples
from starling.diagnosis.which.response import Signature, simulate_signature
from starling.diagnosis.which.scene_mixture import remains_beyond_scenes
from starling.diagnosis.which.search import SearchResult, search_effects
from starling.diagnosis.which.strengths import first_nodes, worth_refining
from starling.diagnosis.which.table import FeatureTable, Rows
from starling.sim.console import progress
from starling.sim.effects.effect import Value

# A gap is explained if its unexplained size is at most: noise size + allowance + a share of the
# initial size. The share is needed because no effect is simulated exactly.
NOISE_ALLOWANCE = 0.35  # Allowance on top of the noise size.
NOISE_LIMIT = 0.65  # Upper limit of noise size plus allowance, unless noise alone exceeds it.
# Share of the initial size, larger for matchers, which are simulated less exactly.
SHARE_OF_INITIAL = {Segment.IMAGE: 0.04, Segment.DEPTH: 0.1, Segment.WHOLE: 0.04}
_MOST_WEAK = 3  # Largest number of candidates that are reported as too weak to name.
_QUANTISED = "subpixel_steps"  # Effect that leaves terraces in device depth.
_TEXTURE = "texture"  # Effect that shows that the surfaces of a scene file are incomplete.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Screening:
    """Signatures of all candidates and null distribution, independent of the captured gap."""

    base: BaseSamples
    signatures: tuple[Signature, ...]  # Signatures at the candidates' first nodes.
    weight: NDArray[np.float64]  # (features,)
    folds: tuple[NDArray[np.bool_], ...]
    threshold: float  # Least held-out gain of an accepted effect.
    noise: float  # Largest size of a gap between seeds of the base.


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SegmentResult:
    """Diagnosis of one segment."""

    table: FeatureTable
    screening: Screening
    likelihood: Likelihood
    search: SearchResult
    explained_below: float  # Unexplained size up to which the gap counts as explained.
    lead: tuple[str, ...]  # Groups of features that stay unexplained in all scenes, worst first.
    varying: tuple[str, ...]  # Groups that stay unexplained in most scenes, differently in each.
    # Accepted effects that explain no more than a matcher of another make would.
    like_another_make: frozenset[str] = frozenset()
    # Whether the accepted effects leave a gap on the images that no effect on the scene explains.
    beyond_scenes: bool = False

    @property
    def settings(self) -> dict[str, Value]:
        """Value by accepted effect."""
        return self.search.settings

    @property
    def sizes(self) -> tuple[float, float]:
        """Size of the gap, before and after."""
        before, after = (total_size(rows, self.likelihood.weight) for rows in self._residuals())
        return before, after

    @property
    def unexplained_size(self) -> float:
        """Size of the remaining gap after the model error of the accepted effects."""
        return total_size(self.search.unexplained, self.likelihood.weight)

    @property
    def by_scene(self) -> dict[str, tuple[float, float]]:
        """Size of the gap in each scene, before and after."""
        names = [scene.name for scene in self.table.scene_models]
        sizes = [size_by_scene(rows, self.likelihood.weight) for rows in self._residuals()]
        return {
            name: (float(before), float(after))
            for name, before, after in zip(names, *sizes, strict=True)
        }

    @property
    def by_group(self) -> dict[str, tuple[float, float]]:
        """Contribution of each group of features to the size, before and after; largest first."""
        names, weight = self.table.names, self.likelihood.weight
        before, after = (residuals.by_group(names, rows, weight) for rows in self._residuals())
        return {name: (size, after[name]) for name, size in before.items()}

    @property
    def consistent(self) -> dict[str, list[float]]:
        """Residuals of features that are off in the same direction in every scene."""
        return residuals.consistent_features(
            self.table.names, self.search.residual, self.likelihood.weight
        )

    def _residuals(self) -> tuple[Rows, Rows]:
        """Return the gap over its deviation (scenes, features), before and after."""
        return self.likelihood.residual(self.likelihood.no_change), self.search.residual

    @property
    def unexplained(self) -> bool:
        """Whether the gap is not explained; False if no effect was tried."""
        return bool(self.screening.signatures) and self.unexplained_size > self.explained_below

    @property
    def weak(self) -> tuple[Fit, ...]:
        """The best candidates where a gap is evident and no effect is accepted."""
        if not self.unexplained or self.search.accepted:
            return ()
        return tuple(fitted for fitted in self.search.alone[:_MOST_WEAK] if fitted.total > 0)


def screen_effects(
    table: FeatureTable,
    candidates: Sequence[Candidate],
    *,
    always: bool = False,
    track: progress.Progress = progress.silent,
) -> Screening:
    """Simulate all candidates at their first nodes, and the null distribution.

    Args:
        table: feature table of the segment.
        candidates: effects that may act in the segment.
        always: screen matcher and filters even if no feature is off, so that they cannot act.
        track: wraps long loops to report progress.
    """
    base = null.simulate_base(table)
    if table.segment is Segment.DEPTH and not always and _no_feature_off(table, base):
        candidates = ()
    candidates = add_measured_values(candidates, table)
    nodes = _select_nodes(candidates, table, track)
    for name, values in nodes.items():
        for value in values:
            table.prefetch({name: value})
    signatures = tuple(
        signature
        for candidate in track(candidates, f"effects on the {table.segment.value}")
        if (signature := simulate_signature(candidate, table, nodes[candidate.name])) is not None
    )
    weight = feature_weights(signatures, base.deviation)
    folds = room_folds([scene.room for scene in table.scene_models])
    return Screening(
        base=base,
        signatures=signatures,
        weight=weight,
        folds=tuple(folds),
        threshold=null.gain_threshold(null.null_gains(base, signatures, weight, folds)),
        noise=null.noise_size(base, weight),
    )


def _select_nodes(
    candidates: Sequence[Candidate], table: FeatureTable, track: progress.Progress
) -> dict[str, list[Value]]:
    """Select the first nodes of each candidate, by name.

    A further parameter of an effect that is off does nothing, so its last node suffices.
    """
    nodes = {candidate.name: first_nodes(candidate) for candidate in candidates}
    further = [each.name for each in candidates if each.is_further]
    for name in further:
        table.prefetch({name: nodes[name][-1]})
    for name in track(further, f"further parameters on the {table.segment.value}"):
        change = table.change({name: nodes[name][-1]})
        if change is not None and not change.any():
            nodes[name] = nodes[name][-1:]
    return nodes


def add_measured_values(candidates: Sequence[Candidate], table: FeatureTable) -> list[Candidate]:
    """Add the disparity quantisation step measured from the depth maps to its candidate.

    Simulated terraces coincide with the device's only if their height is right to a thousandth.

    Args:
        candidates: candidates of the table's segment.
        table: feature table.
    """
    return [
        _with_measured_step(candidate, table)
        if candidate.name == _QUANTISED and table.segment is Segment.DEPTH
        else candidate
        for candidate in candidates
    ]


def _with_measured_step(candidate: Candidate, table: FeatureTable) -> Candidate:
    scenes = [scene for scene in table.scene_models if isinstance(scene.real, DepthObservation)]
    device_px = Derived(
        len(scenes), lambda number: expect(scenes[number].real, DepthObservation).device_px
    )
    step = quantisation_step.estimate_step_px(device_px)
    return candidate if step is None else with_measured_node(candidate, step)


def restrict_to_families(screening: Screening, families: Collection[str]) -> Screening:
    """Keep the effects of some families; feature weights follow from these alone.

    The threshold stays: the null gains of the removed effects could also occur for the others.

    Args:
        screening: screening of the whole effect table.
        families: families that are tried.
    """
    signatures = tuple(
        signature
        for signature in screening.signatures
        if signature.candidate.effect.family in families
    )
    if len(signatures) == len(screening.signatures):
        return screening
    weight = feature_weights(signatures, screening.base.deviation)
    noise = null.noise_size(screening.base, weight)
    return dataclasses.replace(screening, signatures=signatures, weight=weight, noise=noise)


def _no_feature_off(table: FeatureTable, base: BaseSamples) -> bool:
    """Whether no feature of any scene is off, so that nothing has to be matched again."""
    likelihood = base.likelihood(table.rows(CAPTURED), np.ones(len(table.names)))
    residual = np.nan_to_num(likelihood.residual(likelihood.no_change))
    return bool((np.abs(residual) <= 1).all())


def diagnose_segment(table: FeatureTable, screening: Screening) -> SegmentResult:
    """Search for the effects of one segment.

    Args:
        table: feature table of the segment.
        screening: screening of a table with the same scenes; in the depth segment also with the
            same captures.
    """
    likelihood = screening.base.likelihood(table.rows(CAPTURED), screening.weight)
    alone = sorted(
        (fit(signature, likelihood, screening.folds) for signature in screening.signatures),
        key=lambda fitted: -fitted.total,
    )
    promising = worth_refining(alone, screening.threshold)
    before = likelihood.size(likelihood.no_change)
    most = max(screening.noise, min(screening.noise + NOISE_ALLOWANCE, NOISE_LIMIT))
    explained_below = most + SHARE_OF_INITIAL[table.segment] * before
    context = SearchContext(
        table=table,
        likelihood=likelihood,
        folds=screening.folds,
        threshold=screening.threshold,
        explained_below=explained_below,
    )
    search = search_effects(context, promising if before > screening.noise else [], alone)
    lead, varying = residuals.leads(table.names, search.unexplained)
    result = SegmentResult(
        table=table,
        screening=screening,
        likelihood=likelihood,
        search=search,
        explained_below=explained_below,
        lead=lead,
        varying=varying,
    )
    return dataclasses.replace(
        result,
        like_another_make=_like_another_make(result),
        beyond_scenes=_is_beyond_scenes(result),
    )


def _like_another_make(result: SegmentResult) -> frozenset[str]:
    """List accepted effects that explain no more than a matcher of another make would.

    Another make is assumed only where the effects leave a gap, and not between two captures.
    """
    table, screening, search = result.table, result.screening, result.search
    of_matcher = table.segment is Segment.DEPTH and bool(search.accepted)
    if not (of_matcher and result.unexplained) or table.compared:
        return frozenset()
    gains, threshold = gains_beyond_makes(
        table,
        screening.base.mean,
        result.likelihood,
        screening.folds,
        [effect.fit.signature for effect in search.accepted],
        screening.signatures,
    )
    return frozenset(name for name, gain in gains.items() if gain < threshold)


def _is_beyond_scenes(result: SegmentResult) -> bool:
    """Whether a gap remains on the images that the scenes do not account for.

    Estimated scenes are incomplete. So are described ones on which the search finds texture.
    """
    table, search = result.table, result.search
    if table.segment is not Segment.IMAGE or not search.accepted or _TEXTURE in result.settings:
        return False
    if not table.compared and any(scene.estimates for scene in table.scene_models):
        return False
    return remains_beyond_scenes(
        result.screening.signatures, result.screening.base, result.likelihood, search.unexplained
    )
