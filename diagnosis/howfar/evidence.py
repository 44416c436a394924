"""Evidence for each accepted effect on scenes that were not used to select it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from starling.diagnosis.which.likelihood import LARGEST, Likelihood, clipped_squares, total_size
from starling.diagnosis.which.residuals import by_group
from starling.diagnosis.which.response import PredictedChange
from starling.diagnosis.which.segment import SegmentResult
from starling.diagnosis.which.table import FeatureTable


@dataclass(frozen=True, kw_only=True, slots=True)
class Evidence:
    gain: float
    gain_scenes: list[float]
    before: float
    after: float
    worse: float
    better: float
    own: float
    own_norm: float
    cosine: float


def evidence(
    segment: SegmentResult, table: FeatureTable, likelihood: Likelihood
) -> dict[str, Evidence]:
    settings, names = segment.settings, table.names
    whole = table.change(settings)
    assert whole is not None
    found = {}
    for name in settings:
        rest = {other: value for other, value in settings.items() if other != name}
        others = table.change(rest) if rest else np.zeros_like(whole)
        if others is None:
            continue
        change_before, change_after = PredictedChange(others), PredictedChange(whole)
        before, after = likelihood.residual(change_before), likelihood.residual(change_after)
        groups_before = by_group(names, before, likelihood.weight)
        groups_after = by_group(names, after, likelihood.weight)
        steps = [groups_after[g] - groups_before[g] for g in groups_before]
        response = (whole - others) / likelihood.deviation
        known = np.isfinite(likelihood.gap)
        moved = likelihood.weight * np.where(known, np.minimum(response**2, LARGEST), 0.0)
        gap = np.nan_to_num(before)
        dot = float((likelihood.weight * gap * np.where(known, response, 0.0)).sum())
        norm = np.sqrt(
            (likelihood.weight * gap**2).sum()
            * (likelihood.weight * np.where(known, response, 0.0) ** 2).sum()
        )
        gains = likelihood.cost(change_before) - likelihood.cost(change_after)
        found[name] = Evidence(
            gain=float(gains.sum()),
            gain_scenes=gains.tolist(),
            before=total_size(before, likelihood.weight),
            after=total_size(after, likelihood.weight),
            worse=float(sum(max(step, 0.0) for step in steps)),
            better=float(sum(max(-step, 0.0) for step in steps)),
            own=1
            - float(
                (moved * clipped_squares(after)).sum()
                / max((moved * clipped_squares(before)).sum(), 1e-9)
            ),
            own_norm=float((moved * clipped_squares(after)).sum() / max(moved.sum(), 1e-9)),
            cosine=dot / max(float(norm), 1e-9),
        )
    return found
