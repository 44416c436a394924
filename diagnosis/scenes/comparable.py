"""Scenes that hold alike: an arm asks all of its scenes for the same."""

from __future__ import annotations

from collections.abc import Sequence

from starling.diagnosis.scenes.scene_model import Subject

Held = tuple[bool, bool]  # Infrared pairs, depth of the device's own.


def complete(subjects: Sequence[Subject]) -> tuple[list[Subject], list[Subject]]:
    """Part scenes into those that hold all that the most frequent kind holds, and the others.

    Of kinds that are equally many the one with infrared counts. One incomplete scene would
    otherwise take from all others an arm that they have.

    Args:
        subjects: at least one.
    """
    kinds = [_held(one) for one in subjects]
    asked = max(set(kinds), key=lambda kind: (kinds.count(kind), kind))
    enough = [all(has >= must for has, must in zip(kind, asked, strict=True)) for kind in kinds]
    return (
        [one for one, told in zip(subjects, enough, strict=True) if told],
        [one for one, told in zip(subjects, enough, strict=True) if not told],
    )


def _held(of: Subject) -> Held:
    return of.real.left is not None, of.real.device_px is not None
