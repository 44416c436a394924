"""Where the gap lies: parts of the chain, places in three frames, bins of covariates, rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from starling.diagnosis.scenes.scene_model import Subject
from starling.diagnosis.scenes.strata import Ground, Image, Mask
from starling.diagnosis.where import covariates, maps, rules, swap
from starling.diagnosis.where.covariates import Row
from starling.diagnosis.where.maps import Map, OfBody
from starling.diagnosis.where.materials import materials
from starling.diagnosis.where.rules import Rule
from starling.diagnosis.where.swap import Part

OFF_PX = 1.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Where:
    """Answers to the first question."""

    parts: dict[str, Part]
    maps: tuple[Map, ...]
    bodies: tuple[OfBody, ...]
    rows: tuple[Row, ...]  # Of pixels without depth.
    off: tuple[Row, ...]  # Of those whose depth is off by more than `OFF_PX`.
    rules: tuple[Rule, ...]


def _off(disparity_px: Image, ground: Ground) -> Mask:
    """Where there is depth (h, w), and it is wrong."""
    return np.asarray(np.abs(disparity_px - ground.disparity_px) > OFF_PX)


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
    off = [
        [_off(one.depth_px[0], ground) for one, ground in zip(many, grounds, strict=True)]
        for many in (base, real)
    ]
    made_of = [materials(one.scene, one.ground) for one in subjects]
    several = len(set(rooms)) > 1
    # The surface of an estimated scene is one body, however many things it shows.
    parted = [number for number, one in enumerate(subjects) if not one.estimates]
    known = [(subjects[number].name, subjects[number].scene) for number in parted]
    return Where(
        parts=swap.swap(base, real, grounds, rooms),
        maps=tuple(maps.maps(base, real, grounds, rooms)) if several else (),
        bodies=tuple(
            maps.bodies(
                known,
                [base[number] for number in parted],
                [real[number] for number in parted],
                [grounds[number] for number in parted],
            )
        ),
        rows=tuple(covariates.table(first, second, grounds, rooms, made_of)),
        off=tuple(covariates.table(off[0], off[1], grounds, rooms, made_of)),
        rules=tuple(rules.rules(first, second, grounds, rooms)),
    )
