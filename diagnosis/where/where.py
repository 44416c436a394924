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
    """Compare what was captured with the base without any effect, or with other captures of it.

    Holes are the device's own where it has depth, else our matcher's on the real images.

    Args:
        subjects: at least one.
    """
    base = [
        one.like_captured({}, seed=0) if one.against is None else one.against for one in subjects
    ]
    rooms = [one.room for one in subjects]
    real, grounds = [one.real for one in subjects], [one.ground for one in subjects]
    first, second = ([~np.isfinite(one.depth_px[0]) for one in many] for many in (base, real))
    several = len(subjects) > 1
    return Where(
        parts=swap.swap(base, real, grounds, rooms),
        maps=tuple(maps.maps(base, real, grounds, rooms)) if several else (),
        bodies=tuple(maps.bodies([(one.name, one.scene) for one in subjects], base, real, grounds)),
        rows=tuple(table.table(first, second, grounds, rooms)),
        rules=tuple(rules.rules(first, second, grounds, rooms)),
    )
