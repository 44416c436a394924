"""Tiers of the check: how different the source of the captures is from the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from starling.diagnosis.validation.camera.catalogue import Kind
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.protocol.case import CaseKind
from starling.diagnosis.validation.protocol.verdict import SegmentName

LightSource = Literal["starling", "cycles", "real"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Tier:
    """Sources, scenes and case counts of one tier."""

    number: int
    source: LightSource  # Renderer of the light, or real pairs with their own scenes and size.
    matcher: Literal["starling", "own", "none"]  # Matcher of the depth; `own` is the second one.
    first_scene: int = 0  # First builtin scene; the rules were developed on other scenes.
    sets: int = 6  # Number of scene sets.
    scenes: int = 10  # Scenes per set; the diagnosis holds some of them out.
    width: int = 424  # Width of the images [px].
    height: int = 240  # Height of the images [px].
    frames: int = 2  # Frames per scene.
    counts: Mapping[CaseKind, int]  # Number of cases by kind.
    left_out: int = 0  # Singles diagnosed again without their family and confusable effects.
    kinds: tuple[Kind, ...] = ("image", "post")  # Kinds of effects that are drawn.
    # Scored pipeline segment; None scores all. The second matcher differs in every case, also null.
    segment: SegmentName | None = None
    # Number of cases with depth of the second matcher. They test whether the diagnosis detects the
    # matcher. Each costs a search, and their depth is not scored.
    own_depth_cases: int = 0
    imperfect: bool = False  # Whether the base lacks what the captured world has.
    beyond: float = 0.0  # Share of strengths beyond the range of the table.

    def scene_names(self, number: int) -> list[str]:
        """Return the names of the builtin scenes of a set."""
        begin = self.first_scene + number * self.scenes
        return [
            f"tabletop:{n}" if n % 4 == 3 else f"clutter:{n}"
            for n in range(begin, begin + self.scenes)
        ]

    def has_own_depth(self, number: int) -> bool:
        """Return whether a case has depth of the second matcher."""
        return self.matcher == "own" and number < self.own_depth_cases

    def scaled_counts(self, singles: int | None) -> tuple[dict[CaseKind, int], int]:
        """Return the number of cases by kind and of left-out cases for a number of singles.

        The other kinds scale in proportion. In a tier without singles, `singles` is the number of
        unknown cases.

        Raises:
            WithheldError: if the number is below 1.
        """
        if singles is None:
            return dict(self.counts), self.left_out
        if singles < 1:
            raise refusal("cases", "must be >= 1", singles, "Give how many singles.")
        default = self.counts.get("single") or self.counts["unknown"]

        def scale(count: int) -> int:
            return -(-singles * count // default)  # Integer division that rounds up exactly.

        counts: dict[CaseKind, int] = {kind: scale(count) for kind, count in self.counts.items()}
        return counts, scale(self.left_out)


TIERS = {
    1: Tier(
        number=1,
        source="starling",
        matcher="starling",
        # Scenes 2000 to 2059, 6000 to 6059, 7000 to 7059, 7200 to 7259 and 7300 to 7479 were used
        # in earlier checks. Scenes 7100 to 7129 are for development.
        first_scene=7480,
        counts={"single": 96, "null": 80, "pair": 48, "unknown": 36},
        left_out=64,
    ),
    2: Tier(
        number=2,
        source="cycles",
        matcher="own",
        # Scenes 3000 to 3047 and 3100 to 3147 were used in earlier checks and to tune the rules.
        first_scene=3200,
        scenes=8,
        counts={"single": 24, "null": 20, "pair": 12, "unknown": 9},
        left_out=15,
        kinds=("image",),
        segment="image",
        own_depth_cases=12,
    ),
    3: Tier(
        number=3,
        source="starling",
        matcher="starling",
        first_scene=4000,
        counts={"null": 20, "unknown": 90},
    ),
    4: Tier(
        number=4,
        source="real",
        matcher="none",
        scenes=8,
        frames=1,
        counts={"single": 24, "null": 20, "pair": 12, "unknown": 9},
        left_out=15,
        kinds=("image",),
    ),
    5: Tier(
        number=5,
        source="starling",
        matcher="starling",
        # Development scenes of an imperfect base are 7110 to 7123. Scenes 8000 to 8047 and 8100 to
        # 8187 were used in earlier checks.
        first_scene=8188,
        scenes=8,
        width=320,
        height=180,
        counts={"single": 48, "null": 24, "pair": 16, "unknown": 18},
        imperfect=True,
        beyond=0.2,
    ),
}
