"""Tiers of the check: how far what made the captures is from what diagnoses them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from starling.diagnosis.validation.camera.catalogue import Kind
from starling.diagnosis.validation.camera.errors import refusal
from starling.diagnosis.validation.protocol.case import CaseKind
from starling.diagnosis.validation.protocol.verdict import Arm

Source = Literal["starling", "cycles", "real"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Tier:
    """What a tier's cases are made of."""

    number: int
    source: Source  # Renderer of the light, or real pairs, which have scenes and size of their own.
    matcher: Literal["starling", "own", "none"]  # Whose depth the device has.
    first: int = 0  # Number of the first builtin scene; what rules were set on has others.
    sets: int = 6  # Of scenes.
    scenes: int = 10  # Of a set; the diagnosis locks some of them away.
    width: int = 424  # [px]
    height: int = 240
    frames: int = 2
    counts: Mapping[CaseKind, int]
    left_out: int = 0  # Singles that are diagnosed again without their effect's family and twins.
    kinds: tuple[Kind, ...] = ("image", "post")
    # What is scored; None: all that is said. Another matcher differs in every case, null or not.
    arm: Arm | None = None
    # Cases, which are numbered by lot, that have depth by the own matcher, to tell whether it is
    # noticed. Each costs a search for what it does otherwise, and none of it is scored.
    measured: int = 0

    def names(self, number: int) -> list[str]:
        """Builtin scenes of a set."""
        begin = self.first + number * self.scenes
        return [
            f"tabletop:{n}" if n % 4 == 3 else f"clutter:{n}"
            for n in range(begin, begin + self.scenes)
        ]

    def measures(self, number: int) -> bool:
        """Whether the case of a number has depth by the own matcher."""
        return self.matcher == "own" and number < self.measured

    def drawn(self, singles: int | None) -> tuple[dict[CaseKind, int], int]:
        """Cases by kind and how many are left out, with another number of singles in proportion.

        A tier without singles is asked by its unknown cases.

        Raises:
            WithheldError: if the number is below 1.
        """
        if singles is None:
            return dict(self.counts), self.left_out
        if singles < 1:
            raise refusal("cases", "must be >= 1", singles, "Give how many singles.")
        own = self.counts.get("single") or self.counts["unknown"]

        def share(count: int) -> int:
            return -(-singles * count // own)  # In whole numbers, which round up exactly.

        counts: dict[CaseKind, int] = {kind: share(count) for kind, count in self.counts.items()}
        return counts, share(self.left_out)


TIERS = {
    1: Tier(
        number=1,
        source="starling",
        matcher="starling",
        # 2000 to 2059, 6000 to 6059, 7000 to 7059, 7200 to 7219 and 7300 to 7359 were opened,
        # 7220 to 7259 drawn; on 7100 to 7129 strengths were asked, rules tried.
        first=7400,
        counts={"single": 96, "null": 80, "pair": 48, "unknown": 36},
        left_out=64,
    ),
    2: Tier(
        number=2,
        source="cycles",
        matcher="own",
        # 3000 to 3047 were opened, and what they taught is in the rules; so were 3100 to 3147.
        first=3200,
        scenes=8,
        counts={"single": 24, "null": 20, "pair": 12, "unknown": 9},
        left_out=15,
        kinds=("image",),
        arm="image",
        measured=12,
    ),
    3: Tier(
        number=3,
        source="starling",
        matcher="starling",
        first=4000,
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
}
