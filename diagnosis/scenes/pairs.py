"""Scenes that two capture sets have in common."""

from __future__ import annotations

from dataclasses import dataclass

from starling.patterns.errors import refuse
from starling.sim.captures.capture import CapturedScene, CaptureSet

_GEOMETRY = ("width", "height", "fx_px", "fy_px", "cx_px", "cy_px", "baseline_m")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ScenePairs:
    """Scenes of a capture set, each paired with the same scene of a second set."""

    pairs: tuple[tuple[CapturedScene, CapturedScene | None], ...]  # None without a second set.
    unpaired: tuple[str, ...]  # Names of scenes that only one of the two sets has.


def pair_scenes(captures: CaptureSet, against: CaptureSet | None) -> ScenePairs:
    """Pair scenes by name.

    Args:
        captures: capture set.
        against: capture set that it is compared with; None if there is none.

    Raises:
        InputError: if a set holds several cameras, or if the sets differ in size or geometry, or
            if they have no scene in common.
    """
    captures.refuse_mixed()
    if against is None:
        return ScenePairs(pairs=tuple((scene, None) for scene in captures.scenes), unpaired=())
    against.refuse_mixed()
    for name in _GEOMETRY:
        first, second = (getattr(captured.info, name) for captured in (captures, against))
        if first != second:
            raise refuse(
                "captures against others",
                f"must be of one {name}",
                (first, second),
                "Rectify both sets to the same geometry.",
            )
    partners = {scene.name: scene for scene in against.scenes}
    pairs = tuple(
        (scene, partners[scene.name]) for scene in captures.scenes if scene.name in partners
    )
    if not pairs:
        raise refuse(
            "captures against others",
            "must have a scene in common",
            f"{captures.path} and {against.path}",
            "Scenes are the same if their folders have one name.",
        )
    names = {scene.name for scene in captures.scenes}
    return ScenePairs(pairs=pairs, unpaired=tuple(sorted(names ^ {*partners})))
