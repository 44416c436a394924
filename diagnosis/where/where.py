"""Where the gap lies: parts of the chain, places in three frames, bins of covariates, rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from diagnosis.subject import Subject
from diagnosis.where import maps, rules, swap, table
from diagnosis.where.maps import Map, OfBody
from diagnosis.where.rules import Rule
from diagnosis.where.swap import Part
from diagnosis.where.table import Row


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Where:
    """Answers to the first question."""

    parts: dict[str, Part]
    maps: tuple[Map, ...]
    bodies: tuple[OfBody, ...]
    rows: tuple[Row, ...]
    rules: tuple[Rule, ...]


def where(subjects: Sequence[Subject]) -> Where:
    """Compare the base with what was captured, without any effect.

    Holes are the device's own where it has depth, else our matcher's on the real images.

    Args:
        subjects: at least one.
    """
    simulated = [one.simulate({}, seed=0) for one in subjects]
    real, grounds = [one.real for one in subjects], [one.ground for one in subjects]
    ours = [one.ours_px for one in simulated if one.ours_px is not None]
    device = [one.device_px if one.device_px is not None else one.ours_px for one in real]
    first = [~np.isfinite(one[0]) for one in ours]
    second = [~np.isfinite(one[0]) for one in device if one is not None]
    several = len(subjects) > 1
    return Where(
        parts=swap.swap(simulated, real, grounds),
        maps=tuple(maps.maps(simulated, real, grounds)) if several else (),
        bodies=tuple(maps.bodies([one.name for one in subjects], simulated, real, grounds)),
        rows=tuple(table.table(first, second, grounds)),
        rules=tuple(rules.rules(first, second, grounds)) if several else (),
    )
