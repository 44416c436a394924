"""Scenes that two capture sets have in common."""

from __future__ import annotations

from dataclasses import dataclass

from starling.patterns.errors import refuse
from starling.sim.captures.capture import CapturedScene, CaptureSet

_GEOMETRY = ("width", "height", "fx_px", "fy_px", "cx_px", "cy_px", "baseline_m")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ScenePairs:
    """Each scene of a capture set beside the same scene of another."""

    pairs: tuple[tuple[CapturedScene, CapturedScene | None], ...]  # None where there is no other.
    aside: tuple[str, ...]  # Scenes that one of the two sets has alone.


def scene_pairs(captures: CaptureSet, against: CaptureSet | None) -> ScenePairs:
    """Pair scenes by name.

    Args:
        captures: a capture set.
        against: the set that it is compared with; None: with nothing captured.

    Raises:
        InputError: if a set is of several cameras, or the sets differ in size or geometry or have
            no scene in common.
    """
    captures.refuse_mixed()
    if against is None:
        return ScenePairs(pairs=tuple((one, None) for one in captures.scenes), aside=())
    against.refuse_mixed()
    for name in _GEOMETRY:
        one, other = (getattr(each.info, name) for each in (captures, against))
        if one != other:
            raise refuse(
                "captures against others", f"must be of one {name}", (one, other), "Rectify alike."
            )
    others = {one.name: one for one in against.scenes}
    pairs = tuple((one, others[one.name]) for one in captures.scenes if one.name in others)
    if not pairs:
        raise refuse(
            "captures against others",
            "must have a scene in common",
            f"{captures.path} and {against.path}",
            "Scenes are the same if their folders have one name.",
        )
    names = {one.name for one in captures.scenes}
    return ScenePairs(pairs=pairs, aside=tuple(sorted(names ^ {*others})))
